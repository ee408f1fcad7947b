# make bin, test, pdf, watch, untangle, check
MAP := noweb map MASTER --

bin:
    $(MAP) cargo build
test:
    $(MAP) cargo test
pdf:
    @kpsewhich noweb.sty > /dev/null && command -v latexmk > /dev/null || { \
      echo 'error: make pdf needs LaTeX and noweb.sty; install them by' >&2; \
      echo 'apt-get install latexmk texlive-latex-recommended noweb' >&2; \
      exit 1; }
    mkdir -p build
    noweb noweave -delay -index \
      -backend 'noweb split_scope -delay -o build' \
      MASTER chapters/greeting.nw chapters/command.nw
    cd build && latexmk -pdf -interaction=nonstopmode book.tex
watch:
    while sleep 1; do make -s pdf; done
# What was edited in src/, or by cargo fmt, goes back to the chapters.
untangle:
    noweb untangle --record src/.tangled MASTER
# Nothing may be left over.
check:
    cargo fmt
    $(MAKE) untangle
    noweb tangle --check --record src/.tangled MASTER
    $(MAP) cargo clippy -- -D warnings

.PHONY: bin test pdf watch untangle check
