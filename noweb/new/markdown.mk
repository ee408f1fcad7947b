# make bin, test, html, watch, check
MAP := noweb map MASTER --

bin:
    $(MAP) cargo build
test:
    $(MAP) cargo test
# The pages are in build/book; this needs mdBook.
html:
    mdbook build
watch:
    mdbook serve --open
# What cargo fmt did goes back to the chapters; nothing may be left over.
check:
    cargo fmt
    noweb untangle --record src/.tangled MASTER
    noweb tangle --check --record src/.tangled MASTER
    $(MAP) cargo clippy -- -D warnings

.PHONY: bin test html watch check
