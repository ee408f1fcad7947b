# make bin, test, html, watch, untangle, check
MAP := noweb map MASTER --

bin:
    $(MAP) cargo build
test:
    $(MAP) cargo test
# The pages are in build/book.
html watch:
    @command -v mdbook > /dev/null || { \
      echo 'error: make $@ needs mdBook: cargo install mdbook' >&2; exit 1; }
    mdbook $(if $(filter html,$@),build,serve --open)
# What was edited in src/, or by cargo fmt, goes back to the chapters.
untangle:
    noweb untangle --record src/.tangled MASTER
# Nothing may be left over.
check:
    cargo fmt
    $(MAKE) untangle
    noweb tangle --check --record src/.tangled MASTER
    $(MAP) cargo clippy -- -D warnings

.PHONY: bin test html watch untangle check
