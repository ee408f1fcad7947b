# make bin, test, pdf, watch, check
MAP := noweb map MASTER --

bin:
    $(MAP) cargo build
test:
    $(MAP) cargo test
# This needs latexmk and the style noweb.sty, of Debian's package noweb.
pdf:
    mkdir -p build
    noweb noweave -delay -index \
      -backend 'noweb split_scope -delay -o build' \
      MASTER chapters/greeting.nw chapters/command.nw
    cd build && latexmk -pdf -interaction=nonstopmode book.tex
watch:
    while sleep 1; do make -s pdf; done
# What cargo fmt did goes back to the chapters; nothing may be left over.
check:
    cargo fmt
    noweb untangle --record src/.tangled MASTER
    noweb tangle --check --record src/.tangled MASTER
    $(MAP) cargo clippy -- -D warnings

.PHONY: bin test pdf watch check
