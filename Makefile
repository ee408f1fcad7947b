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

PROFILE_Release = --release
PROFILE_Debug =
ifeq ($(filter $(BUILD_TYPE),Release Debug),)
$(error BUILD_TYPE is "$(BUILD_TYPE)" in config.mk: it must be Release or Debug)
endif
COMPILED := $(CARGO_TARGET_DIR)/$(if $(PROFILE_$(BUILD_TYPE)),release,debug)

NOWEB := $(CARGO_TARGET_DIR)/release/noweb
NOWEB_SOURCES := Cargo.toml noweb/Cargo.toml $(wildcard noweb/src/*.rs)
# What cargo, the compiler and the tests say is shown at the chapters. The tool
# runs the command, translates what it says, and ends with its status.
MAP = $(NOWEB) map --master litpt.nw --
JSON = --message-format=json-diagnostic-rendered-ansi

SOURCES := src/.tangled $(NOWEB_SOURCES) config.mk build.rs \
  $(wildcard Cargo.lock src/*.rs src/*/*.rs)

# The view of the courtyard; its size and samples per pixel as a figure of the
# book (seconds) and in the demonstration (about a minute on two cores).
CAMERA = -p 12.2,2.4,1.3 -t -12.6,6,-1.2 -u 0,1,0 -F 70
FIGURE = -d 480x360 -n 64
DEMO = -d 800x600 -n 48

TEX_NEEDS = memoir.cls lmodern.sty microtype.sty booktabs.sty pgfplots.sty \
  bookmark.sty colorprofiles.tex
TEX_INSTALL = apt-get install --no-install-recommends texlive-latex-base \
  texlive-latex-recommended texlive-pictures lmodern latexmk

.PHONY: help bin demo test clippy pdf check prose boot chunk untangle watch \
  measure stability stability-full clean check-tex
.DELETE_ON_ERROR:

help:
	@echo 'make demo    build the program, render the courtyard, say where it is'
	@echo 'make test    run all tests (needs Rust and make only)'
	@echo 'make pdf     make the book, $(BUILD_DIR)/litpt.pdf (needs LaTeX)'
	@echo 'make bin     build the programs, $(BUILD_DIR)/pt and $(BUILD_DIR)/ptimg'
	@echo 'make clippy  lints alone'
	@echo 'make check   formatting, lints, and whether src/ is what the book says'
	@echo 'make prose   spelling of the chapters, sizes of chunks (needs hunspell)'
	@echo 'make boot    rebuild the tool noweb from its own chapters'
	@echo 'make untangle  carry edits made under src/ back into the chapters'
	@echo 'make watch   tangle and compile whenever a chapter is saved'
	@echo 'make chunk   list the root chunks; CHUNK="..." shows one chunk, expanded'
	@echo 'make measure repeat the measurements that the book prints'
	@echo 'make stability  stiff and extreme cases, ten minutes; stability-full: hours'
	@echo 'make ablation  what is saved by leaving out what a scene does not need'
	@echo 'make bench   measure pt beside Embree; BENCH_SCENES="..." restricts it'
	@echo 'make clean   remove what was built'

# ---- the program

# The chapters are tangled first, by the tool, which writes only files that
# change; cargo (whose build.rs would tangle as well) is called only if one did,
# and its programs are copied only when they differ. So a sentence that is
# mended costs no compilation, and a comment no rendering.
$(BUILD_DIR)/tangled.stamp: $(WEB) $(NOWEB)
	@mkdir -p $(BUILD_DIR)
	$(NOWEB) tangle --record src/.tangled $(WEB)
	@touch $@

src/.tangled: $(BUILD_DIR)/tangled.stamp
	@true

NAMES = pt ptimg courtyard closed_forms calibration anatomy
PROGRAMS := $(BUILD_DIR)/$(BUILD_TYPE).stamp
$(PROGRAMS): $(SOURCES)
	$(MAP) $(CARGO) build $(PROFILE_$(BUILD_TYPE)) --bins $(JSON)
	@mkdir -p $(BUILD_DIR)
	@rm -f $(BUILD_DIR)/Release.stamp $(BUILD_DIR)/Debug.stamp
	@for program in $(NAMES); do \
	  cmp -s $(COMPILED)/$$program $(BUILD_DIR)/$$program || \
	  { cp $(COMPILED)/$$program $(BUILD_DIR)/$$program.new && \
	    mv $(BUILD_DIR)/$$program.new $(BUILD_DIR)/$$program; } || exit 1; \
	done
	@touch $@

$(addprefix $(BUILD_DIR)/,$(NAMES)): $(PROGRAMS)
	@test -x $@ || { rm -f $<; $(MAKE) --no-print-directory $<; }

bin: $(BUILD_DIR)/pt $(BUILD_DIR)/ptimg

# ---- the courtyard

$(BUILD_DIR)/courtyard.obj: $(BUILD_DIR)/courtyard
	$(BUILD_DIR)/courtyard > $@

$(BUILD_DIR)/figures/courtyard.png: $(BUILD_DIR)/pt $(BUILD_DIR)/courtyard.obj
	@mkdir -p $(@D)
	$(BUILD_DIR)/pt $(CAMERA) $(FIGURE) -r 0.8 \
	  -i $(BUILD_DIR)/courtyard.obj -o $@ -f --report $(@:png=json)

$(BUILD_DIR)/figures/courtyard.json: $(BUILD_DIR)/figures/courtyard.png
	@test -e $@ || { rm -f $<; $(MAKE) --no-print-directory $<; }

demo: $(BUILD_DIR)/pt $(BUILD_DIR)/courtyard.obj
	$(BUILD_DIR)/pt $(CAMERA) $(DEMO) -r 0.8 \
	  -i $(BUILD_DIR)/courtyard.obj \
	  -o $(BUILD_DIR)/courtyard.pgm -o $(BUILD_DIR)/courtyard.png -f
	@echo 'The picture lies in $(BUILD_DIR)/courtyard.png,'
	@echo 'and as PGM in $(BUILD_DIR)/courtyard.pgm.'

# ---- the book

# If there is a tool that can, it shows the errors of its own next version.
$(NOWEB): $(NOWEB_SOURCES)
	@echo '$(CARGO) build --release -p noweb'
	@if $(NOWEB) map --master litpt.nw < /dev/null > /dev/null 2>&1; \
	then $(MAP) $(CARGO) build --release -p noweb $(JSON); \
	else $(CARGO) build --release -p noweb; fi
	@touch $@

# Known answers and those of the program, for the chapter on tests.
$(BUILD_DIR)/tables/closed-forms.tex: $(BUILD_DIR)/closed_forms
	@mkdir -p $(@D)
	$(BUILD_DIR)/closed_forms > $@

# A node, a leaf and the steps of one walk, for the chapter on the walk.
$(BUILD_DIR)/tables/anatomy.stamp: $(BUILD_DIR)/anatomy
	@mkdir -p $(@D)
	$(BUILD_DIR)/anatomy $(@D)
	@touch $@

# Whether the errors are honest, and the curve of one run with its true error.
# The first step has no error yet, and pgfplots no use for empty fields.
$(BUILD_DIR)/tables/calibration.stamp: $(BUILD_DIR)/calibration
	@mkdir -p $(@D)
	$(BUILD_DIR)/calibration $(@D)
	@touch $@

$(BUILD_DIR)/tables/curve.csv: $(BUILD_DIR)/pt $(BUILD_DIR)/courtyard.obj
	@mkdir -p $(@D) $(BUILD_DIR)/figures
	$(BUILD_DIR)/pt $(CAMERA) -d 96x72 -n 800 -s 1 -r 0.8 -q -f \
	  -i $(BUILD_DIR)/courtyard.obj -o $(BUILD_DIR)/figures/truth.exr
	$(BUILD_DIR)/pt $(CAMERA) -d 96x72 -n 125 -r 0.8 -q -f \
	  -i $(BUILD_DIR)/courtyard.obj -o $(BUILD_DIR)/figures/curve.exr \
	  --reference $(BUILD_DIR)/figures/truth.exr --report $@.full.csv
	grep -v ',,' $@.full.csv > $@

# Measurements are recorded, not repeated at each build: the machine must be
# idle for them. A line of comment names the date and the machine.
$(BUILD_DIR)/tables/%.tex: doc/measured/%.csv
	@mkdir -p $(@D)
	awk -F, -v OFS=' & ' -v most=$(or $(COLUMNS_$*),99) ' \
	  /^#/ { sub(/^# */, ""); print $$0 "%" > "$(@D)/$*-machine.tex"; next } \
	  !head++ { next } \
	  { if (NF > most) NF = most; $$1 = $$1; print $$0 " \\\\" }' $< > $@

# All entries of these files by name, for the numbers in the text. A row is named
# by its first field, or by those named here, with a slash between them; an empty
# field repeats the one above.
ROWS_ablation = scene shortcut
ROWS_bench = scene threads
ROWS_leaks = surface rays number
ROWS_loading = text reader threads
ROWS_qualities = quality instructions
ROWS_roulettes = scene rule
ROWS_shapes = width realisations
ROWS_shortcuts = scene shortcut
ROWS_traversal = scene contender threads
MEASURED_FILES := $(sort $(wildcard doc/measured/*.csv))
$(BUILD_DIR)/tables/measured.tex: $(MEASURED_FILES) Makefile
	@mkdir -p $(@D)
	@{ $(foreach file,$(MEASURED_FILES),awk -F, \
	  -v table=$(basename $(notdir $(file))) \
	  -v rows='$(ROWS_$(basename $(notdir $(file))))' "$$MEASURED_VALUES" \
	  $(file) &&) true; } > $@

define MEASURED_VALUES
/^#/ { next }
!head++ {
  for (i = 1; i <= NF; i++) { name[i] = $$i; column[$$i] = i }
  parts = split(rows ? rows : $$1, part, " ")
  if (!rows) { parts = 1; part[1] = $$1 }
  next
}
{
  key = ""
  for (i = 1; i <= parts; i++) {
    c = column[part[i]]
    if ($$c == "" && i == 1) $$c = above
    if (i == 1) above = $$c
    key = key (i > 1 ? "/" : "") $$c
  }
  for (i = 1; i <= NF; i++)
    printf "\\nwmeasured{%s}{%s}{%s}{%s}%%\n", table, key, name[i], $$i
}
endef
export MEASURED_VALUES

# What the text says about the courtyard and the picture of it.
COUNT = { wc -lc | awk '{ \
  printf "\\nwmeasured{file}{$(1)}{lines}{%d}%%\n", $$1; \
  printf "\\nwmeasured{file}{$(1)}{megabytes}{%f}%%\n", $$2 / 1e6 }'; }
define COUNT_SOLIDS
BEGIN {
  split("cornice rail string coping gallery parapet step wall", course)
  for (i in course) kind[course[i]] = "course"
  kind["abacus"] = kind["plinth"] = "abacus and plinth"
  kind["basin"] = kind["fountain"] = "fountain and basin"
}
/^o / {
  solid = $$2
  sub(/[.].*/, "", solid)
  if (solid in kind) solid = kind[solid]
  number[solid]++
}
/^f / { triangles[solid]++ }
END {
  for (solid in number) {
    printf "\\nwmeasured{solids}{%s}{number}{%d}%%\n", solid, number[solid]
    printf "\\nwmeasured{solids}{%s}{triangles}{%d}%%\n", solid,
      triangles[solid]
  }
}
endef
export COUNT_SOLIDS
$(BUILD_DIR)/tables/counted.tex: Makefile \
  $(BUILD_DIR)/figures/courtyard.json
	@mkdir -p $(@D)
	@{ grep '^f' $(BUILD_DIR)/courtyard.obj | $(call COUNT,triangles) && \
	  grep '^o' $(BUILD_DIR)/courtyard.obj | $(call COUNT,solids) && \
	  cat $(BUILD_DIR)/courtyard.obj | $(call COUNT,courtyard) && \
	  awk "$$COUNT_SOLIDS" $(BUILD_DIR)/courtyard.obj && \
	  sed -n -E 's/^  "(rays|mean|mean_stderr|pixels)": (.*),/\\nwmeasured{picture}{report}{\1}{\2}%/p' \
	    $(BUILD_DIR)/figures/courtyard.json; } > $@

# What the programs have said, for the same purpose.
SAID = info same other seeds few single pair joined long white files
$(BUILD_DIR)/tables/said.tex: doc/said.awk Makefile $(BUILD_DIR)/examples.stamp \
  $(BUILD_DIR)/tables/calibration.stamp
	awk -f $< $(SAID:%=$(BUILD_DIR)/examples/%.txt) $(@D)/stopping.tex \
	  $(@D)/unseen.tex > $@

# Tables that are wider than the page.
COLUMNS_bench = 8
COLUMNS_traversal = 6

$(BUILD_DIR)/tables/%.csv: doc/measured/%.csv
	@mkdir -p $(@D)
	grep -v '^#' $< > $@

# What the book says of itself: how much of what is in it, and what the weaving
# pipeline makes of it.
STREAMS = $(addprefix $(BUILD_DIR)/,plain.stream resolved.stream)
$(BUILD_DIR)/tables/numbers.stamp: $(WEB) $(NOWEB) src/.tangled
	@mkdir -p $(@D)
	@$(NOWEB) markup $(WEB) > $(BUILD_DIR)/plain.stream
	@$(NOWEB) finduses < $(BUILD_DIR)/plain.stream | $(NOWEB) noidx -delay \
	  > $(BUILD_DIR)/resolved.stream
	@LC_ALL=C awk -v parts=$(@D)/parts.tex -f doc/numbers.awk $(WEB) \
	  $(STREAMS) $(wildcard src/*.rs src/*/*.rs noweb/src/*.rs tests/*.rs \
	    tests/*/*.rs noweb/tests/*.rs) > $(@D)/numbers.tex
	@touch $@

# What the history of the chapters says of them, and how long one waits for
# what: recorded like the measurements above, on an idle machine.
.PHONY: history turnaround
history:
	{ echo "$(MACHINE)" && python3 doc/history.py; } \
	  > doc/measured/history.csv.new
	mv doc/measured/history.csv.new doc/measured/history.csv

turnaround: $(NOWEB) pdf
	{ echo "$(MACHINE)" && python3 doc/turnaround.py $(NOWEB) $(WEB); } \
	  > doc/measured/turnaround.csv.new
	mv doc/measured/turnaround.csv.new doc/measured/turnaround.csv

# A virtual machine's processor has a name that several generations share.
PROCESSOR = awk -F '[\t ]*: ' '{ value[$$1] = $$2 } \
  END { print value["model name"] (value["cpu family"] == "" ? "" : \
    " (family " value["cpu family"] ", model " value["model"] ")") }' \
  /proc/cpuinfo
MACHINE = \# $(shell $(PROCESSOR)), \
  $(shell nproc) cores, on $(shell date +%Y-%m-%d)

EXAMPLES = $(CARGO_TARGET_DIR)/release/examples
MEASURED = qualities repeats leaks origins roulettes accumulators accounting \
  alarms loading thresholds
measure: $(BUILD_DIR)/courtyard.obj
	$(CARGO) build --release $(addprefix --example ,$(MEASURED))
	@mkdir -p doc/measured
	for name in $(MEASURED); do \
	  { echo "$(MACHINE)" && \
	    $(CARGO_TARGET_DIR)/release/examples/$$name $<; } \
	    > doc/measured/$$name.csv.new && \
	  mv doc/measured/$$name.csv.new doc/measured/$$name.csv || exit 1; \
	done
	{ echo "$(MACHINE)" && $(CARGO) run --release -p noweb \
	  --example positions litpt.nw; } > doc/measured/translation.csv.new
	mv doc/measured/translation.csv.new doc/measured/translation.csv

# ---- stiff and extreme cases

# The tests concerned, optimised, and then one table of what is exact, what pt
# gives and what the reference's method gives. The table is written even if a
# case fails; then the target fails. The full run counts the escapes of 10^9
# paths of four rays from each closed surface.
RAYS = 4e9
STABLE = leaks extremes stiff sampling exact walk
STABILITY = $(CARGO_TARGET_DIR)/release/examples/stability

stability:
	$(CARGO) test --release $(addprefix --test ,$(STABLE))
	$(CARGO) build --release --example stability
	@mkdir -p doc/measured
	{ echo "$(MACHINE)" && $(STABILITY) 3e7; } \
	  > doc/measured/stability.csv.new; status=$$?; \
	mv doc/measured/stability.csv.new doc/measured/stability.csv; \
	exit $$status

# It takes hours, and can be continued: the rows of RAYS that are there stay,
# under the date at which they were begun; those of another number go.
DONE = $$(grep -c ',0 of $(RAYS),' doc/measured/stability-full.csv)
stability-full:
	$(CARGO) build --release --example stability
	@mkdir -p doc/measured
	@grep -q ',0 of $(RAYS),' doc/measured/stability-full.csv 2> /dev/null || \
	  echo "$(MACHINE)" > doc/measured/stability-full.csv
	@sed -i '/^#/b;/^case/b;/,0 of $(RAYS),/!d' doc/measured/stability-full.csv
	$(STABILITY) $(RAYS) leaks $(DONE) >> doc/measured/stability-full.csv

# ---- what a scene does not need

# What each shortcut saves, scene by scene: five minutes on an idle machine.
.PHONY: ablation
ablation:
	$(CARGO) build --release --example ablation
	@mkdir -p doc/measured
	{ echo "$(MACHINE)" && $(EXAMPLES)/ablation 5; } \
	  > doc/measured/ablation.csv.new
	mv doc/measured/ablation.csv.new doc/measured/ablation.csv

# ---- pt beside Embree

# What is measured: traversal alone, whole renders, one scene in several
# sizes, and images of several sizes. "make bench" does all four in a quarter
# of an hour, and each has a target of its own. KITCHEN=FILE adds the scene of
# that OBJ (or .obj.zst), which is not ours to give away, BENCH_LARGE=1 ten
# million triangles. A run that is restricted replaces the tables of a whole
# one.
BENCH = $(BUILD_DIR)/bench
BENCH_SCENES = courtyard statue field $(if $(KITCHEN),kitchen)
BENCH_SIZES = 1000 10000 100000 1000000 $(if $(BENCH_LARGE),10000000)

COMPARED = $(BENCH_SCENES:%=$(BENCH)/%)
SIZED = $(BENCH_SIZES:%=$(BENCH)/field-%)
AND_VIEWS = $(foreach scene,$(1),$(scene).obj $(scene).view)

# The peer, a path tracer on Embree, is no part of this project.
PEER ?= ../shared/peers/embree_pt.cpp
EMBREE = /usr/include/embree3/rtcore.h

.PHONY: bench bench-traversal bench-peer bench-sizes bench-shapes bench-tools
bench:
	@for part in traversal peer sizes shapes; do \
	  $(MAKE) --no-print-directory bench-$$part || exit 1; done
	@python3 bench/measure.py show \
	  $(patsubst %,doc/measured/%.csv,traversal bench sizes shapes)

$(BENCH)/examples.stamp: $(PROGRAMS) examples/scenes.rs examples/traversal.rs \
  examples/paths/mod.rs
	$(CARGO) build --release --example scenes --example traversal
	@mkdir -p $(BENCH)
	@touch $@

# field-1000 is the field with 1000 triangles.
$(BENCH)/%.obj $(BENCH)/%.view: examples/scenes.rs | $(BENCH)/examples.stamp
	$(EXAMPLES)/scenes $(subst -, ,$*) > $(BENCH)/$*.obj
	$(EXAMPLES)/scenes --view $(firstword $(subst -, ,$*)) > $(BENCH)/$*.view

$(BENCH)/courtyard.obj: $(BUILD_DIR)/courtyard.obj
	@mkdir -p $(BENCH)
	cp $< $@

$(BENCH)/courtyard.view: Makefile
	@mkdir -p $(BENCH)
	@echo '$(CAMERA)' > $@

$(BENCH)/kitchen.obj: $(KITCHEN)
	@mkdir -p $(BENCH)
	case '$<' in \
	*.zst) zstd -dqf -o $@ '$<' ;; \
	*) cp '$<' $@ ;; esac

$(BENCH)/kitchen.view: Makefile
	@mkdir -p $(BENCH)
	@echo '-p 3.0,1.5,1.4 -t -3.9438584,1.5,-1.7303504 -u 0,1,0 -F 70' > $@

# Without the peer its columns stay empty.
bench-tools: $(BUILD_DIR)/pt
	@test '$(BUILD_TYPE)' = Release || \
	  { echo 'error: only a Release is worth measuring' >&2; exit 1; }
	@command -v python3 > /dev/null || \
	  { echo 'error: make bench needs python3' >&2; exit 1; }
	@mkdir -p $(BENCH) doc/measured
	@if ! test -e '$(PEER)'; then lacks='the source $(PEER) (set PEER=)'; \
	elif ! command -v g++ > /dev/null; then lacks='the package g++'; \
	elif ! test -e $(EMBREE); then lacks='the package libembree-dev'; \
	else lacks=; fi; \
	if test "$$lacks"; then \
	  echo "bench: the peer is left out, for lack of $$lacks" >&2; \
	  rm -f $(BENCH)/embree_pt; \
	elif ! test $(BENCH)/embree_pt -nt '$(PEER)'; then \
	  g++ -O3 -march=native -fopenmp '$(PEER)' -o $(BENCH)/embree_pt \
	    -lembree3; \
	fi

bench-traversal: bench-tools $(BENCH)/examples.stamp \
  $(call AND_VIEWS,$(COMPARED))
	@{ echo '$(MACHINE)' && for scene in $(COMPARED); do \
	  echo "bench: $$scene, traversal alone" >&2 && \
	  $(EXAMPLES)/traversal -i $$scene.obj $$(cat $$scene.view) -r 0.8 \
	    -d 400x300 > $(BENCH)/rows && cat $(BENCH)/rows || exit 1; \
	done; } > $(BENCH)/traversal.csv
	@awk '!/^scene,/ || !head++' $(BENCH)/traversal.csv \
	  > doc/measured/traversal.csv

MEASURE = python3 bench/measure.py $(1) $(BUILD_DIR)/pt \
  $$(ls $(BENCH)/embree_pt 2> /dev/null) $(2)

bench-peer: bench-tools $(call AND_VIEWS,$(COMPARED))
	@{ echo '$(MACHINE)' && $(call MEASURE,peer,$(COMPARED)); } \
	  > $(BENCH)/bench.csv
	@cp $(BENCH)/bench.csv doc/measured/bench.csv

bench-sizes: bench-tools $(call AND_VIEWS,$(SIZED))
	@{ echo '$(MACHINE)' && $(call MEASURE,sizes,$(SIZED)); } \
	  > $(BENCH)/sizes.csv
	@cp $(BENCH)/sizes.csv doc/measured/sizes.csv

bench-shapes: bench-tools $(call AND_VIEWS,$(BENCH)/courtyard)
	@{ echo '$(MACHINE)' && $(call MEASURE,shapes,$(BENCH)/courtyard); } \
	  > $(BENCH)/shapes.csv
	@cp $(BENCH)/shapes.csv doc/measured/shapes.csv

# What the program weighs before it does anything, and what a triangle and a
# pixel add.
.PHONY: start
start: bench-tools $(BENCH)/examples.stamp
	@{ echo '$(MACHINE)' && python3 bench/start.py $(BUILD_DIR)/pt \
	  $(EXAMPLES)/scenes $$(ls $(BENCH)/embree_pt 2> /dev/null); } \
	  > $(BENCH)/start.csv
	@cp $(BENCH)/start.csv doc/measured/start.csv

# What opening the largest chapter costs vim.
.PHONY: bench-vim
bench-vim:
	@mkdir -p $(BENCH)
	@{ echo '$(MACHINE)' && \
	  python3 bench/vim.py chapters/markup.nw chapters/totex.nw; } \
	  > $(BENCH)/editor.csv
	@cp $(BENCH)/editor.csv doc/measured/editor.csv

# What the tool and the program say, for the chapters on them.
$(BUILD_DIR)/examples.stamp: $(NOWEB) $(BUILD_DIR)/pt $(BUILD_DIR)/ptimg \
  $(BUILD_DIR)/courtyard.obj $(wildcard doc/examples/*)
	@sh doc/examples/messages.sh $(NOWEB) $(BUILD_DIR)/examples
	@sh doc/examples/pt.sh $(BUILD_DIR)/pt $(BUILD_DIR)/examples
	@sh doc/examples/ptimg.sh $(BUILD_DIR) $(BUILD_DIR)/examples
	@touch $@

check-tex:
	@command -v latexmk > /dev/null && command -v pdflatex > /dev/null && \
	  kpsewhich $(TEX_NEEDS) > /dev/null || { \
	  echo 'error: the book needs LaTeX, and some of it is missing; install it by' >&2; \
	  echo '$(TEX_INSTALL)' >&2; exit 1; }

# A book: its chapters are woven, and LaTeX is run as often as it needs.
# $(call MAKE_BOOK,MASTER,WEB,DIRECTORY)
define MAKE_BOOK
@mkdir -p $(3)
$(NOWEB) noweave $(NOWEAVE_OPTS) -backend '$(NOWEB) split_scope -o $(3)' $(2)
@echo 'latexmk $(3)/$(1).tex'
@TEX_DIR=$(3) latexmk -silent -r doc/latexmkrc $(3)/$(1).tex \
  > $(3)/latexmk.log 2>&1 || { \
  grep -A 4 -E '^[^ ]+:[0-9]+: |^!' $(3)/$(1).log | \
  sed "$$PLACES" | grep . || tail $(3)/latexmk.log; exit 1; }
@cp $(3)/$(1).pdf $@
@awk -v web='$(2)' "$$LIST_WARNINGS" $(3)/$(1).log
@echo 'The book lies in $@.'
endef
BOOK_NEEDS = $(NOWEB) config.mk $(BUILD_DIR)/examples.stamp \
  $(addprefix doc/,litpt.sty litpt.bib litpt-mono.enc latexmkrc) \
  $(addprefix $(BUILD_DIR)/tables/,numbers.stamp measured.tex editor.tex \
    translation.tex turnaround.tex history.tex)

$(BUILD_DIR)/litpt.pdf: $(WEB) $(BOOK_NEEDS) \
  $(BUILD_DIR)/figures/courtyard.png \
  $(addprefix $(BUILD_DIR)/tables/,closed-forms.tex qualities.tex \
    leaks.tex origins.tex roulettes.tex stability.tex stability-full.tex robustness.tex \
    $(if $(wildcard doc/measured/ablation.csv),ablation.tex) shortcuts.tex layouts.tex habits.tex abreast.tex traversal.tex \
    bench.tex generations.tex sizes.csv shapes.tex start.tex repeats.csv \
    accumulators.tex accounting.tex alarms.tex thresholds.tex \
    calibration.stamp anatomy.stamp curve.csv counted.tex said.tex)
	$(call MAKE_BOOK,litpt,$(WEB),$(BUILD_DIR)/tex)

$(BUILD_DIR)/noweb.pdf: $(TOOL_WEB) $(BOOK_NEEDS)
	$(call MAKE_BOOK,noweb,$(TOOL_WEB),$(BUILD_DIR)/tex-noweb)

# Line n of build/tex/NAME.tex is line n of chapters/NAME.nw.
PLACES = s,^\(\./\)*$(BUILD_DIR)/tex/\([^ /:]*\)\.tex:\([0-9]*\):,chapters/\2.nw:\3:,; \
  s,^\(\./\)*$(BUILD_DIR)/tex-noweb/\([^ /:]*\)\.tex:\([0-9]*\):,noweb/chapters/\2.nw:\3:,; \
  s,^chapters/litpt\.nw:,litpt.nw:,; s,^noweb/chapters/noweb\.nw:,noweb/noweb.nw:,
export PLACES

# The warnings in the log of LaTeX, each with the chapter that was open and
# the line that the warning names, or the first.
define LIST_WARNINGS
BEGIN {
  count = split(web, files, " ")
  for (i = 1; i <= count; i++) {
    name = files[i]; sub(/.*\//, "", name); sub(/[.]nw$$/, "", name)
    source[name] = files[i]
  }
  count = 0
}
match($$0, /\/tex(-noweb)?\/[^ ()\/]+\.tex/) {
  name = substr($$0, RSTART, RLENGTH); sub(/.*\//, "", name)
  sub(/[.]tex$$/, "", name)
  if (name in source) file = source[name]
}
/(LaTeX|Package|Class|pdfTeX)[^:]*[Ww]arning|^(Over|Under)full/ {
  line = match($$0, /lines? [0-9]+/) ? substr($$0, RSTART, RLENGTH) : 1
  sub(/[^0-9]*/, "", line)
  print file ":" line ": warning: " $$0; count++
}
END { print count + 0 " warnings are left in the book" }
endef
export LIST_WARNINGS

pdf: check-tex $(BUILD_DIR)/litpt.pdf $(BUILD_DIR)/noweb.pdf

# ---- is everything as it should be?

test: $(NOWEB)
	$(MAP) $(CARGO) test --workspace $(JSON)

CLIPPY = $(CARGO) clippy --workspace --all-targets $(JSON) -- -D warnings
clippy: $(NOWEB)
	$(MAP) $(CLIPPY)

check: $(NOWEB)
	$(MAP) $(CARGO) fmt --all --check
	$(MAP) $(CLIPPY)
	$(NOWEB) tangle --check --record src/.tangled $(WEB)
	$(NOWEB) tangle --check --record noweb/.tangled $(TOOL_WEB)
	git diff --exit-code -- src noweb
	@if command -v python3 > /dev/null; then \
	  python3 doc/prose --sizes $(CHAPTERS); fi
	@if command -v python3 > /dev/null && command -v hunspell > /dev/null; \
	then sh doc/prose-test.sh; \
	else echo 'make prose is not tested, for lack of hunspell'; fi
	@if command -v vim > /dev/null; then sh noweb/vim/test.sh; \
	else echo 'vim is not tested, for lack of it'; fi
	@if ! command -v python3 > /dev/null; then \
	  echo 'the book is not checked, for lack of python3'; \
	elif ! test -e $(BUILD_DIR)/litpt.pdf; then \
	  python3 doc/check-floats.py $(WEB); \
	else \
	  python3 doc/check-floats.py --build $(BUILD_DIR) $(WEB) && \
	  python3 doc/check-archive.py $(BUILD_DIR)/litpt.pdf && \
	  { ! command -v pdftotext > /dev/null || \
	    python3 doc/check-pdf.py $(BUILD_DIR)/litpt.pdf $(CHAPTERS); }; fi

# Spelling, slips and sizes of chunks, over all chapters.
prose:
	@doc/prose

# ---- editing

# Edits of tangled files go home; make boot then builds the tool from its own.
untangle: $(NOWEB)
	$(NOWEB) untangle --record src/.tangled $(WEB)
	$(NOWEB) untangle --record noweb/.tangled $(TOOL_WEB)

# The list of chapters is read from the master on each save.
watch: $(NOWEB)
	$(NOWEB) watch --record src/.tangled \
	  --master litpt.nw -- $(MAP) $(CARGO) check --bins $(JSON)

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
