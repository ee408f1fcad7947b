# Makefile -- the verbs of litpt: "make help" lists them
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.

include config.mk
export BUILD_DIR CARGO CARGO_TARGET_DIR

# The chapters of each book are listed in its master, and nowhere else.
INCLUDED = $(shell sed -n 's,^\\include{\(.*\)}.*,$(dir $(1))chapters/\1.nw,p' $(1))
CHAPTERS := $(patsubst ./%,%,$(call INCLUDED,litpt.nw))
WEB := litpt.nw $(CHAPTERS)
TOOL_CHAPTERS := $(call INCLUDED,noweb/noweb.nw)
TOOL_WEB := noweb/noweb.nw $(TOOL_CHAPTERS)
LOST := $(filter-out $(WEB) $(TOOL_WEB),$(wildcard chapters/*.nw noweb/chapters/*.nw))

# Every build and test selects the same packages: so cargo unites the features
# of what they depend on in one way, and compiles nothing twice. The program on
# many processes needs an MPI library, which WITH_MPI=1 says is there.
PACKAGES := --workspace $(if $(WITH_MPI),,--exclude litpt-mpi)

# What is measured or installed is a Release, unless the command line says
# otherwise.
ifneq ($(filter measure stability% ablation bench% calibration mixtures install \
  efficiency picture-peer choice parts places peers rates mpi, \
  $(MAKECMDGOALS)),)
BUILD_TYPE = Release
endif
PROFILE_Fast = fast
PROFILE_Release = release
PROFILE_Debug = dev
ifeq ($(filter $(BUILD_TYPE),Fast Release Debug),)
$(error BUILD_TYPE is "$(BUILD_TYPE)" in config.mk: it must be Fast, Release or Debug)
endif
COMPILED := $(CARGO_TARGET_DIR)/$(patsubst dev,debug,$(PROFILE_$(BUILD_TYPE)))

NOWEB := $(CARGO_TARGET_DIR)/tool/noweb
NOWEB_SOURCES := Cargo.toml noweb/Cargo.toml noweb/core/Cargo.toml \
  $(wildcard noweb/src/*.rs noweb/core/src/*.rs noweb/new/*)
# What cargo, the compiler and the tests say is shown at the chapters. The tool
# runs the command, translates what it says, and ends with its status.
MAP = $(NOWEB) map litpt.nw noweb/noweb.nw --

SOURCES := src/.tangled $(NOWEB_SOURCES) config.mk build.rs \
  $(wildcard Cargo.lock src/*.rs src/*/*.rs src/*/*/*.rs view/Cargo.toml view/src/*)

# The view of the courtyard.
CAMERA = -p 12.2,2.4,1.3 -t -12.6,6,-1.2 -u 0,1,0 -F 70

TEX_NEEDS = memoir.cls lmodern.sty microtype.sty booktabs.sty pgfplots.sty \
  bookmark.sty colorprofiles.tex
TEX_INSTALL = apt-get install --no-install-recommends texlive-latex-base \
  texlive-latex-recommended texlive-pictures lmodern latexmk

.PHONY: help bin view mpi test-mpi python test-python test-python-full install uninstall demo test clippy pdf html check prose boot chunk untangle watch \
  clean check-tex
.DELETE_ON_ERROR:

help:
	@echo 'make demo    build the program, render the courtyard, say where it is'
	@echo 'make test    run all tests (needs Rust and make only; WITH_MPI=1: of pt-mpi too)'
	@echo 'cargo test NAME  run those of the renderer with NAME in their names'
	@echo 'make pdf     make the books, $(BUILD_DIR)/*.pdf (needs LaTeX)'
	@echo 'make html    make the books for browsers, $(BUILD_DIR)/html (needs pandoc and lunr)'
	@echo 'make bin     build the programs pt, ptimg and ptview in $(BUILD_DIR)'
	@echo 'make view    turn the courtyard in the browser'
	@echo 'make mpi     build build/pt-mpi for clusters (needs MPI); make test-mpi'
	@echo 'make python  build a wheel for pip in $(BUILD_DIR); make test-python[-full]'
	@echo 'make install put them, man pages and completions below PREFIX=/usr/local'
	@echo 'make uninstall  remove what install has put there'
	@echo 'make clippy  lints alone'
	@echo 'make check   formatting, lints, and whether src/ is what the book says'
	@echo 'make prose   spelling of the chapters, sizes of chunks (needs hunspell)'
	@echo 'make boot    rebuild the tool noweb from its own chapters'
	@echo 'make untangle  carry edits made under src/ back into the chapters'
	@echo 'make watch   tangle and check whenever a chapter is saved (needs entr)'
	@echo 'make chunk   list the root chunks; CHUNK="..." shows one chunk, expanded'
	@echo 'make measure repeat how long the tool translates places'
	@echo 'make stability  stiff and extreme cases, ten minutes; stability-full: hours'
	@echo 'make ablation  what is saved by leaving out what a scene does not need'
	@echo 'make calibration  how often the truth lies within so many errors'
	@echo 'make bench   measure pt beside Embree; BENCH_SCENES="..." restricts it'
	@echo 'make mixtures  mixtures of scales beside Embree'
	@echo 'make efficiency  in which time pt reaches the error of Embree, some hours'
	@echo 'make picture-peer  pictures beside Embree and OIDN in equal time, 20 minutes'
	@echo 'make choice  what each method gains, and what a pilot foresees'
	@echo 'make parts   what each part of a gather is worth, half an hour'
	@echo 'make places  values of places, three minutes'
	@echo 'make peers   view factors and daylight beside peers, forty minutes'
	@echo 'make rates   images a second of ptview, a minute (needs chromium)'
	@echo 'make fuzz    random scenes and cameras, a minute'
	@echo 'make clean   remove what was built'

# ---- the program

# The chapters are tangled first, by the tool, which writes only files that
# change; cargo (whose build.rs would tangle as well) is called only if one did,
# and its programs are copied only when they differ. So a sentence that is
# mended costs no compilation, and a comment no rendering.
$(BUILD_DIR)/tangled.stamp: $(WEB) $(NOWEB) $(LOST)
	$(if $(LOST),$(error no master includes $(LOST)))
	@mkdir -p $(BUILD_DIR)
	$(NOWEB) tangle --record src/.tangled litpt.nw
	@touch $@

src/.tangled: $(BUILD_DIR)/tangled.stamp
	@true

# $(call BUILD,PROGRAMS,STAMP): compiles programs and copies those that
# differ. The stamp STAMP.BUILD_TYPE has a checksum of the sources. A program
# that differs from the one before in its BUILD_TYPE alone gets its time as
# well: figures are the same whichever makes them.
define BUILD
$(MAP) $(CARGO) build --profile $(PROFILE_$(BUILD_TYPE)) $(PACKAGES) \
  $(1:%=--bin %)
@sources=$$(cat $(filter-out config.mk,$^) | cksum); \
before=$$(cat $(filter-out $@,$(wildcard $(2).*)) /dev/null); \
for program in $(1); do \
  from=$(COMPILED)/$$program to=$(BUILD_DIR)/$$program; \
  cmp -s $$from $$to || { cp $$from $$to.new && \
    { test ! -e $$to || test "$$sources" != "$$before" || touch -r $$to $$to.new; } && \
    mv $$to.new $$to; } || exit 1; \
done; rm -f $(2).*; echo "$$sources" > $@
endef

PROGRAMS := $(BUILD_DIR)/programs.$(BUILD_TYPE)
$(PROGRAMS): $(SOURCES)
	$(call BUILD,pt ptimg ptview,$(basename $@))

$(BUILD_DIR)/pt $(BUILD_DIR)/ptimg $(BUILD_DIR)/ptview: $(PROGRAMS)
	@test -x $@ || { rm -f $<; \
	  $(MAKE) --no-print-directory BUILD_TYPE=$(BUILD_TYPE) $<; }

bin: $(BUILD_DIR)/pt $(BUILD_DIR)/ptimg $(BUILD_DIR)/ptview

# The program on many processes. It needs an MPI library, and libclang to read
# its headers: apt-get install libopenmpi-dev openmpi-bin libclang-dev.
$(BUILD_DIR)/pt-mpi: $(SOURCES)
	$(MAP) $(CARGO) build --profile $(PROFILE_$(BUILD_TYPE)) --workspace \
	  --bin pt-mpi
	@cp $(COMPILED)/pt-mpi $@.new && mv $@.new $@

mpi: $(BUILD_DIR)/pt-mpi

test-mpi:
	$(MAKE) clippy test WITH_MPI=1

# The program of the book's own crate, which is not installed.
BOOK := $(BUILD_DIR)/litpt-book
$(BOOK).$(BUILD_TYPE): $(SOURCES) book/Cargo.toml \
  $(wildcard book/src/*.rs book/src/programs/*.rs book/src/programs/*/*.rs)
	$(call BUILD,litpt-book,$(BOOK))

$(BOOK): $(BOOK).$(BUILD_TYPE)
	@test -x $@ || { rm -f $<; \
	  $(MAKE) --no-print-directory BUILD_TYPE=$(BUILD_TYPE) $<; }

# What is installed below PREFIX: the programs, their manual pages, and
# completions for three shells. DESTDIR goes before it, for packagers.
PREFIX = /usr/local
PAGES = pt ptimg ptview $(addprefix ptimg-,daylight info tonemap rgb diff merge stderr)
INSTALLED = $(PAGES:%=share/man/man1/%.1) $(foreach name,pt ptimg ptview,bin/$(name) \
  share/bash-completion/completions/$(name) share/zsh/site-functions/_$(name) \
  share/fish/vendor_completions.d/$(name).fish)

$(BUILD_DIR)/share: $(BOOK)
	rm -rf $@
	$(BOOK) manuals $@
	@touch $@

install: bin $(BUILD_DIR)/share
	@for name in $(INSTALLED); do case $$name in \
	  bin/*) install -D -m 755 $(BUILD_DIR)/$${name#bin/} \
	    "$(DESTDIR)$(PREFIX)/$$name" ;; \
	  *) install -D -m 644 $(BUILD_DIR)/$$name \
	    "$(DESTDIR)$(PREFIX)/$$name" ;; esac || exit 1; done
	@echo 'pt, ptimg and ptview lie in $(DESTDIR)$(PREFIX)/bin.'

uninstall:
	cd '$(DESTDIR)$(PREFIX)' && rm -f $(INSTALLED)

# ---- the package for Python

# An environment of its own, with what builds and tests the package.
PYTHON = python3
PYTHON_ENV = $(BUILD_DIR)/python
PYTHON_RUN = SLOW=10 PATH=$(abspath $(PYTHON_ENV))/bin:$$PATH $(if $(wildcard \
  $(BUILD_DIR)/pt),PT=$(abspath $(BUILD_DIR)/pt)) $(PYTHON_ENV)/bin/python
NOTEBOOK = $(PYTHON_RUN) -m nbconvert --to notebook --execute \
  --output-dir $(BUILD_DIR)/notebooks

$(PYTHON_ENV)/bin/maturin:
	$(PYTHON) -m venv $(PYTHON_ENV)
	$(PYTHON_ENV)/bin/pip install -q 'maturin>=1.9,<2'

WHEEL := $(PYTHON_ENV)/wheel.$(BUILD_TYPE)
$(WHEEL): $(SOURCES) $(PYTHON_ENV)/bin/maturin $(wildcard python/*.toml \
  python/README.md python/src/*.rs python/litpt/*.py*)
	@rm -f $(PYTHON_ENV)/wheel.* $(BUILD_DIR)/litpt-*.whl
	$(MAP) $(PYTHON_ENV)/bin/maturin build -q -m python/Cargo.toml \
	  --profile $(PROFILE_$(BUILD_TYPE)) -o $(BUILD_DIR)
	@touch $@

python: $(WHEEL)
	@echo "The package: pip install $$(ls $(BUILD_DIR)/litpt-*.whl)"

$(PYTHON_ENV)/installed: $(WHEEL)
	$(PYTHON_ENV)/bin/pip install -q pytest xarray nbconvert ipykernel matplotlib numpy
	$(PYTHON_ENV)/bin/pip install -q --force-reinstall --no-deps $(BUILD_DIR)/litpt-*.whl
	@touch $@

test-python: $(PYTHON_ENV)/installed
	$(PYTHON_RUN) -m pytest -q -p no:cacheprovider python/tests --ignore=python/tests/full
	$(NOTEBOOK) python/examples/daylight.ipynb

# The types, the other notebooks, and what other programs find: ten minutes.
test-python-full: test-python
	$(PYTHON_ENV)/bin/pip install -q mypy trimesh pyvista rtree scipy embreex mitsuba
	cd $(BUILD_DIR) && $(abspath $(PYTHON_ENV))/bin/python -m mypy.stubtest litpt
	$(NOTEBOOK) python/examples/*.ipynb
	$(PYTHON_RUN) -m pytest -q -p no:cacheprovider python/tests/full
	$(PYTHON_RUN) python/tests/full/rates.py --pt $(BUILD_DIR)/pt -o doc/measured/python.csv

# ---- the courtyard

$(BUILD_DIR)/courtyard.obj: $(BOOK)
	$(BOOK) courtyard > $@

demo: $(BUILD_DIR)/pt $(BUILD_DIR)/courtyard.obj
	$(BUILD_DIR)/pt $(CAMERA) -d 800x600 -n 48 -r 0.8 \
	  -i $(BUILD_DIR)/courtyard.obj \
	  -o $(BUILD_DIR)/courtyard.pgm -o $(BUILD_DIR)/courtyard.png -f
	@echo 'The image lies in $(BUILD_DIR)/courtyard.png,'
	@echo 'and as PGM in $(BUILD_DIR)/courtyard.pgm.'

view: $(BUILD_DIR)/pt $(BUILD_DIR)/ptview $(BUILD_DIR)/courtyard.obj
	$(BUILD_DIR)/ptview $(BUILD_DIR)/courtyard.obj $(CAMERA) -r 0.8

# ---- the book

# If there is a tool that can, it shows the errors of its own next version.
$(NOWEB): $(NOWEB_SOURCES)
	@echo '$(CARGO) build --profile tool -p noweb'
	@if $(MAP) true > /dev/null 2>&1; \
	then $(MAP) $(CARGO) build --profile tool -p noweb; \
	else $(CARGO) build --profile tool -p noweb; fi
	@touch $@

# Figures, tables and measurements.
include book/book.mk

check-tex:
	@command -v latexmk > /dev/null && command -v pdflatex > /dev/null && \
	  kpsewhich $(TEX_NEEDS) > /dev/null || { \
	  echo 'error: the book needs LaTeX, and some of it is missing; install it by' >&2; \
	  echo '$(TEX_INSTALL)' >&2; exit 1; }

# A book: its chapters are woven, and LaTeX is run as often as it needs. The
# volumes of a book refer to each other's pages: each is set three times, which costs
# nothing if it has not changed.
# $(call MAKE_BOOK,MASTER,WEB,DIRECTORY,VOLUMES)
define MAKE_BOOK
@mkdir -p $(3)
$(NOWEB) noweave $(NOWEAVE_OPTS) -backend '$(NOWEB) split_scope -o $(3)' $(2)
@echo 'latexmk $(3)/$(1).tex'
@for volume in $(4) $(4) $(4); do \
  TEX_DIR=$(3) latexmk -silent -r doc/latexmkrc -jobname=$$volume $(3)/$(1).tex \
  > $(3)/latexmk.log 2>&1 || { \
  grep -A 4 -E '^[^ ]+:[0-9]+: |^!' $(3)/$$volume.log | \
  sed "$$PLACES" | grep . || tail $(3)/latexmk.log; exit 1; }; done
@cat $(4:%=$(3)/%.log) | awk -v web='$(2)' -f book/scripts/warnings.awk
@cp $(4:%=$(3)/%.pdf) $(BUILD_DIR)
@echo 'The book lies in $(4:%=$(BUILD_DIR)/%.pdf).'
endef
BOOK_NEEDS = $(NOWEB) config.mk \
  $(addprefix doc/,litpt.sty litpt.bib litpt-mono.enc latexmkrc)

VOLUMES = litpt litpt-geometry litpt-program
$(VOLUMES:%=$(BUILD_DIR)/%.pdf) &: $(WEB) $(BOOK_NEEDS) $(FIGURES) $(TABLES)
	$(call MAKE_BOOK,litpt,$(WEB),$(BUILD_DIR)/tex,$(VOLUMES))

$(BUILD_DIR)/noweb.pdf: $(TOOL_WEB) $(BOOK_NEEDS) $(TOOL_TABLES)
	$(call MAKE_BOOK,noweb,$(TOOL_WEB),$(BUILD_DIR)/tex-noweb,noweb)

# Line n of build/tex/NAME.tex is line n of chapters/NAME.nw.
PLACES = s,^\(\./\)*$(BUILD_DIR)/tex/\([^ /:]*\)\.tex:\([0-9]*\):,chapters/\2.nw:\3:,; \
  s,^\(\./\)*$(BUILD_DIR)/tex-noweb/\([^ /:]*\)\.tex:\([0-9]*\):,noweb/chapters/\2.nw:\3:,; \
  s,^chapters/litpt\.nw:,litpt.nw:,; s,^noweb/chapters/noweb\.nw:,noweb/noweb.nw:,
export PLACES

pdf: check-tex $(VOLUMES:%=$(BUILD_DIR)/%.pdf) $(BUILD_DIR)/noweb.pdf

# The books on the web, from what has been woven for the PDF.
LUNR = /usr/share/javascript/lunr/lunr.min.js
WEB_SCRIPTS := $(addprefix $(SCRIPTS)/,web.py web_play.py web_program.py \
  web_reader.py)
# $(call MAKE_SITE,WEB,RECORD,TEX_DIRECTORY,SITE)
define MAKE_SITE
@mkdir -p $(4) && cp doc/web.css doc/web.js $(LUNR) $(4)
@cp /usr/share/doc/libjs-lunr/copyright $(4)/lunr.txt
@echo 'web.py $(4)'
@TEXINPUTS="$(3):$(BUILD_DIR)/figures:$(BUILT):$(BUILD_DIR)/examples:$(BUILD_DIR):doc:doc/examples:doc/figures:" \
  ENCFONTS=doc: python3 $(SCRIPTS)/web.py $(NOWEB) $(1) $(2) $(3) $(4)
endef

html: pdf $(WEB_SCRIPTS) doc/web.css doc/web.js
	@command -v pandoc > /dev/null && command -v pdftocairo > /dev/null && \
	  test -e $(LUNR) || { \
	  echo 'error: make html needs pandoc, pdftocairo and lunr; install them by' >&2; \
	  echo 'apt-get install pandoc poppler-utils libjs-lunr' >&2; exit 1; }
	$(call MAKE_SITE,noweb/noweb.nw,noweb/.tangled,$(BUILD_DIR)/tex-noweb,$(BUILD_DIR)/html/noweb)
	$(call MAKE_SITE,litpt.nw,src/.tangled,$(BUILD_DIR)/tex,$(BUILD_DIR)/html)
	@echo 'The books lie in $(BUILD_DIR)/html/index.html.'

# ---- is everything as it should be?

test: $(NOWEB)
	$(MAP) $(CARGO) test $(PACKAGES)

CLIPPY = $(CARGO) clippy $(PACKAGES) --all-targets -- -D warnings
clippy: $(NOWEB)
	$(MAP) $(CLIPPY)

# What is to be checked of a book: its PDFs if they are there, else its floats.
# $(call CHECK_BOOK,VOLUMES,WEB,CHAPTERS)
define CHECK_BOOK
@if ! command -v python3 > /dev/null; then \
  echo 'the book $(firstword $(1)) is not checked, for lack of python3'; \
elif ! test -e $(BUILD_DIR)/$(lastword $(1)).pdf; then \
  python3 book/scripts/check-floats.py $(2); \
else \
  python3 book/scripts/check-floats.py --build $(BUILD_DIR) $(2) && \
  for volume in $(1); do \
    python3 book/scripts/check-archive.py $(BUILD_DIR)/$$volume.pdf || exit 1; done && \
  { ! command -v pdftotext > /dev/null || \
    python3 book/scripts/check-pdf.py $(1:%=$(BUILD_DIR)/%.pdf) $(3); }; fi
endef

# Compiling has tangled. If a tangled file differs from the index now, and no
# chapter does, the one in the index is not what the chapters there say.
# $(call CHECK_INDEX,TANGLED,CHAPTERS)
CHANGED = git diff --name-only 2> /dev/null --
define CHECK_INDEX
@stale=$$($(CHANGED) $(1)); \
if test "$$stale" && test -z "$$($(CHANGED) $(2))"; then \
  echo 'error: the index has these files otherwise than its chapters say:' >&2; \
  echo "$$stale" >&2; \
  echo 'Here they are tangled: git add $(1)' >&2; exit 1; fi
endef

check: $(NOWEB)
	$(MAP) $(CARGO) fmt --all --check
	$(MAP) $(CLIPPY)
	$(NOWEB) tangle --check --record src/.tangled litpt.nw
	$(NOWEB) tangle --check --record noweb/.tangled noweb/noweb.nw
	$(call CHECK_INDEX,src,litpt.nw chapters)
	$(call CHECK_INDEX,noweb/src noweb/core/src,noweb/noweb.nw noweb/chapters)
	@if command -v python3 > /dev/null; then \
	  python3 book/scripts/prose --sizes $(CHAPTERS) $(TOOL_CHAPTERS); fi
	@if command -v python3 > /dev/null && command -v hunspell > /dev/null; \
	then sh book/scripts/prose-test.sh; \
	else echo 'make prose is not tested, for lack of hunspell'; fi
	@if command -v vim > /dev/null; then sh noweb/vim/test.sh; \
	else echo 'vim is not tested, for lack of it'; fi
	$(call CHECK_BOOK,$(VOLUMES),$(WEB),$(CHAPTERS))
	$(call CHECK_BOOK,noweb,$(TOOL_WEB),$(TOOL_CHAPTERS))
	@changed=$$($(CHANGED) . | tr '\n' ' '); \
	echo "All is well$${changed:+; not in the index yet: $$changed}"

# Spelling, slips and sizes of chunks, over all chapters.
prose:
	@book/scripts/prose

# ---- editing

# Edits of tangled files go home; make boot then builds the tool from its own.
untangle: $(NOWEB)
	$(NOWEB) untangle --record src/.tangled litpt.nw
	$(NOWEB) untangle --record noweb/.tangled noweb/noweb.nw

# Cargo's build script tangles what was saved.
watch: $(NOWEB)
	@command -v entr > /dev/null || { \
	  echo 'error: make watch needs entr (apt-get install entr)' >&2; exit 1; }
	@printf '%s\n' $(WEB) | entr -n $(MAP) $(CARGO) check --bins

# ---- the tool

boot:
	sh noweb/boot.sh $(TOOL_WEB)

export CHUNK
chunk: $(NOWEB)
	@if test -n "$$CHUNK"; \
	then $(NOWEB) notangle $(NOTANGLE_OPTS) -R"$$CHUNK" $(WEB); \
	else $(NOWEB) noroots $(WEB); fi

clean:
	rm -rf $(BUILD_DIR)
	$(CARGO) clean
