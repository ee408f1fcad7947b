# book.mk -- figures, tables and measurements of the book, for the Makefile
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.

SCRIPTS := book/scripts
MEASURED := doc/measured
BUILT := $(BUILD_DIR)/tables
RECORD := sh $(SCRIPTS)/record

# The figures and tables that the books read.
LEARNT := $(addprefix $(BUILD_DIR)/figures/learnt-,$(addsuffix .png, \
  cache truth wrong claimed light guide cosine guided gather paths))
LEARNT_TABLES := $(BUILT)/learnt.tex
SUNS := $(addprefix $(BUILD_DIR)/figures/sun-,morning.png noon.png room.png)
FIGURES := $(BUILD_DIR)/figures/courtyard.png $(LEARNT) $(SUNS)
# The tool's book needs no program but the tool.
TOOL_TABLES := $(addprefix $(BUILT)/,measured.tex translation.tex)
TABLES := $(BUILD_DIR)/examples.stamp \
  $(BUILD_DIR)/examples/session.txt $(addprefix $(BUILT)/,measured.tex \
  turnaround.tex closed-forms.tex \
  coverage.tex expectations.tex curve.csv said.tex layers.tex \
  nets.stamp stability.tex \
  ablation.tex traversal.tex bench.tex efficiency.tex worth.tex gains.tex sizes.csv \
  mixtures.tex rates.tex \
  mixtures-ball.csv room.tex street.tex street-factors.tex room-year.tex)

# ---- made with the book

$(BUILD_DIR)/figures $(BUILT):
	@mkdir -p $@

$(BUILD_DIR)/figures/courtyard.png $(BUILD_DIR)/figures/courtyard.json &: \
  $(BUILD_DIR)/pt $(BUILD_DIR)/courtyard.obj | $(BUILD_DIR)/figures
	$(BUILD_DIR)/pt $(CAMERA) -d 480x360 -n 64 -r 0.8 -f \
	  -i $(BUILD_DIR)/courtyard.obj -o $(BUILD_DIR)/figures/courtyard.png \
	  --report $(BUILD_DIR)/figures/courtyard.json

# The courtyard at nine and at noon of an equinox at 45 degrees north, and the
# room of the examples, whose window has a pane, at five of a summer's day.
SUN = $(BUILD_DIR)/pt -d 400x300 -r 0.7 --ground 0.3 --sky cie:12 --direct 4 \
  -qf -o $@ -n
$(BUILD_DIR)/figures/sun-morning.png: $(BUILD_DIR)/pt \
  $(BUILD_DIR)/courtyard.obj | $(BUILD_DIR)/figures
	$(SUN) 24 $(CAMERA) --sun 125.3,30 $(BUILD_DIR)/courtyard.obj
$(BUILD_DIR)/figures/sun-noon.png: $(BUILD_DIR)/pt \
  $(BUILD_DIR)/courtyard.obj | $(BUILD_DIR)/figures
	$(SUN) 24 $(CAMERA) --sun 180,45 $(BUILD_DIR)/courtyard.obj
$(BUILD_DIR)/figures/sun-room.png: $(BUILD_DIR)/pt \
  $(addprefix doc/examples/,glazed.obj room.mtl) | $(BUILD_DIR)/figures
	$(SUN) 32 --materials --glass pane=0.88 --sun 265,20 -p 5.5,2,1.6 \
	  -t 0,2,1.4 doc/examples/glazed.obj

# The daylight of a room, and the sky above a street, as tables and as tones
# between 0 and 1, which LaTeX draws faster than pgfplots does.
TONE = t = t < 0 ? 0 : t; t = t > 1 ? 1 : t; \
  printf "\\tone{%s}{%s}{%.3f}\n", $$1, $$2, t
$(addprefix $(BUILT)/room,.csv .tex) &: $(BUILD_DIR)/pt doc/examples/grid.sh doc/examples/room.obj \
  doc/examples/room.mtl | $(BUILT)
	sh doc/examples/grid.sh 0 0 6 4 40 25 0.85 | $(BUILD_DIR)/pt \
	  doc/examples/room.obj --points - --materials --sky overcast \
	  --ground 0.2 -n 4096 -qf -o $(BUILT)/room.csv
	awk -F, 'NR > 1 { t = (log($$7) / log(10) + 2.3) / 1.6; $(TONE) }' \
	  $(BUILT)/room.csv > $(BUILT)/room.tex

$(addprefix $(BUILT)/street,.csv .tex) &: $(BUILD_DIR)/pt doc/examples/grid.sh \
  doc/examples/street.sh | $(BUILT)
	sh doc/examples/street.sh > $(BUILT)/street.obj
	sh doc/examples/grid.sh -6 -10 200 134 103 72 0.01 | $(BUILD_DIR)/pt \
	  $(BUILT)/street.obj --points - -r 0 -n 256 -qf -o $(BUILT)/street.csv
	awk -F, 'NR > 1 { t = $$7; $(TONE) }' $(BUILT)/street.csv > $(BUILT)/street.tex

# Who sees whom in the street, and the light of a year in the room.
$(addprefix $(BUILT)/street-factors,.csv .tex .txt) &: $(BUILD_DIR)/pt \
  doc/examples/street.sh | $(BUILT)
	sh doc/examples/street.sh > $(BUILT)/street-factors.obj
	$(BUILD_DIR)/pt $(BUILT)/street-factors.obj --faces \
	  --view-factors faces --closed -n 4096 -f \
	  -o $(BUILT)/street-factors.csv 2> $(BUILT)/street-factors.log
	sed -n '/^> matrix/ { s/; /;\n          /; s/^> //; p; }' \
	  $(BUILT)/street-factors.log > $(BUILT)/street-factors.txt
	awk -F, '$$2 ~ /^[0-9]+$$/ { t = -log($$3) / log(10) / 4; $(TONE) }' \
	  $(BUILT)/street-factors.csv > $(BUILT)/street-factors.tex

$(addprefix $(BUILT)/room-year,.csv .tex .txt) &: $(BUILD_DIR)/pt \
  $(BUILD_DIR)/ptimg doc/examples/grid.sh doc/examples/year.sh \
  doc/examples/room.obj doc/examples/room.mtl | $(BUILT)
	sh doc/examples/grid.sh 0 0 6 4 24 16 0.85 > $(BUILT)/room-year.grid
	$(BUILD_DIR)/pt doc/examples/room.obj --points $(BUILT)/room-year.grid \
	  --materials --ground 0.2 --sky-patches 1 -n 4096 -qf \
	  -o $(BUILT)/room-year.litpt
	sh doc/examples/year.sh > $(BUILT)/room-year.smx
	$(BUILD_DIR)/ptimg daylight $(BUILT)/room-year.litpt \
	  $(BUILT)/room-year.smx -f -o $(BUILT)/room-year.csv 2>&1 | \
	  sed 's/^> //; s/, have/,\nhave/' > $(BUILT)/room-year.txt
	awk 'NR == FNR { x[FNR] = $$1; y[FNR] = $$2; next } FNR > 1 { \
	  split($$0, a, ","); $$1 = x[a[1]]; $$2 = y[a[1]]; t = a[2]; $(TONE) }' \
	  $(BUILT)/room-year.grid $(BUILT)/room-year.csv > $(BUILT)/room-year.tex
	rm $(BUILT)/room-year.litpt $(BUILT)/room-year.smx

$(BUILT)/closed-forms.tex: $(BOOK) | $(BUILT)
	$(BOOK) closed_forms > $@

$(BUILT)/nets.stamp: $(BOOK) | $(BUILT)
	$(BOOK) nets $(@D)
	@touch $@

$(LEARNT) $(LEARNT_TABLES) &: $(BOOK) | $(BUILD_DIR)/figures $(BUILT)
	$(BOOK) learnt $(BUILD_DIR)/figures $(BUILT)

# The curve of one run with its true error. The first step has no error yet,
# and pgfplots no use for empty fields.
$(BUILT)/curve.csv: $(BUILD_DIR)/pt $(BUILD_DIR)/courtyard.obj \
  | $(BUILT) $(BUILD_DIR)/figures
	$(BUILD_DIR)/pt $(CAMERA) -d 96x72 -n 256 -s 1 -r 0.8 -q -f \
	  --integrator gather \
	  -i $(BUILD_DIR)/courtyard.obj -o $(BUILD_DIR)/figures/truth.exr
	$(BUILD_DIR)/pt $(CAMERA) -d 96x72 -n 125 -r 0.8 -q -f \
	  --integrator reference \
	  -i $(BUILD_DIR)/courtyard.obj -o $(BUILD_DIR)/figures/curve.exr \
	  --reference $(BUILD_DIR)/figures/truth.exr --report $@.full.csv
	grep -v ',,' $@.full.csv > $@

# What the tool and the program say, for the chapters on them.
$(BUILD_DIR)/examples.stamp: $(NOWEB) $(BUILD_DIR)/pt $(BUILD_DIR)/ptimg \
  $(BUILD_DIR)/courtyard.obj $(wildcard doc/examples/*) \
  $(SCRIPTS)/messages.sh $(SCRIPTS)/pt.sh $(SCRIPTS)/ptimg.sh
	@sh $(SCRIPTS)/messages.sh $(NOWEB) $(BUILD_DIR)/examples
	@sh $(SCRIPTS)/pt.sh $(BUILD_DIR)/pt $(BUILD_DIR)/examples
	@sh $(SCRIPTS)/ptimg.sh $(BUILD_DIR) $(BUILD_DIR)/examples
	@touch $@

# A terminal session.
$(BUILD_DIR)/examples/session.txt: $(SCRIPTS)/session.sh $(BUILD_DIR)/pt
	sh $< $(@D) $(BUILD_DIR)

# The numbers in what they have said.
SAID = info same other seeds few single pair white files
$(BUILT)/said.tex: $(SCRIPTS)/said.awk $(BUILD_DIR)/examples.stamp \
  | $(BUILT)
	awk -f $< $(SAID:%=$(BUILD_DIR)/examples/%.txt) > $@

# The layers of the modules, as the test of imports has them.
$(BUILT)/layers.tex: $(SCRIPTS)/layers.awk tests/layers.txt | $(BUILT)
	awk -f $^ > $@

# ---- recorded

# Measurements are not repeated at each build, since the machine must be idle
# for them. All entries have names, for the numbers in the text; COLUMNS are
# those that fit on the page.
$(BUILT)/measured.tex: $(SCRIPTS)/measured.awk $(wildcard $(MEASURED)/*.csv) \
  | $(BUILT)
	awk -f $^ > $@

COLUMNS_bench = 8
COLUMNS_mixtures = 8
$(BUILT)/%.tex: $(MEASURED)/%.csv $(SCRIPTS)/table.awk | $(BUILT)
	awk -v most=$(COLUMNS_$*) -v machine=$(@D)/$*-machine.tex \
	  -f $(SCRIPTS)/table.awk $< > $@

# The curves of efficiency-curves.tex come with it.
$(BUILT)/efficiency.tex: $(MEASURED)/efficiency.csv $(SCRIPTS)/efficiency.awk \
  | $(BUILT)
	awk -v machine=$(@D)/efficiency-machine.tex \
	  -v curves=$(@D)/efficiency-curves.tex -f $(SCRIPTS)/efficiency.awk $< > $@

$(BUILT)/worth.tex: $(MEASURED)/parts.csv $(SCRIPTS)/parts.awk
	awk -v machine=$(@D)/worth-machine.tex -f $(SCRIPTS)/parts.awk $< > $@

$(BUILT)/%.csv: $(MEASURED)/%.csv | $(BUILT)
	grep -v '^#' $< > $@

.PHONY: measure stability stability-full ablation fuzz
measure:
	$(RECORD) translation $(CARGO) run --release -p noweb --example positions \
	  litpt.nw

# The tests concerned, optimised, and then one table of what is exact, what pt
# gives and what single precision gives. It is written even if a case fails;
# then the target fails.
stability: $(BOOK)
	$(CARGO) test --release --test all leaks:: extremes:: mixtures:: stiff:: \
	  sampler:: exact:: traversal:: random::
	$(RECORD) stability $(BOOK) stability 3e7

# The escapes of 10^9 paths of four rays from each closed surface. It takes
# hours, and can be continued: the rows of RAYS that are there stay, under the
# date at which they were begun; those of another number go.
RAYS = 4e9
FULL := $(MEASURED)/stability-full.csv
stability-full: $(BOOK)
	@grep -q ',0 of $(RAYS),' $(FULL) 2> /dev/null || \
	  $(RECORD) stability-full true
	@sed -i '/^#/b;/^case/b;/,0 of $(RAYS),/!d' $(FULL)
	$(BOOK) stability $(RAYS) leaks $$(grep -c ',0 of $(RAYS),' $(FULL)) \
	  >> $(FULL)

# What each shortcut saves, scene by scene: five minutes on an idle machine.
ablation: $(BOOK)
	$(RECORD) ablation $(BOOK) ablation 5

# The test of random scenes and cameras, with more seeds, from FUZZ_SEED on.
FUZZ_SECONDS = 60
fuzz:
	FUZZ_SECONDS=$(FUZZ_SECONDS) $(CARGO) test $(PACKAGES) --test all random:: -- --nocapture

# ---- pt beside Embree

# What is measured: traversal alone, whole renders, and one scene in several
# sizes. "make bench" does all three in half an hour, and each has a target of its own. KITCHEN=FILE adds the scene of
# that OBJ (or .obj.zst), which is not ours to give away, BENCH_LARGE=1 ten
# million triangles. A run that is restricted replaces the tables of a whole
# one.
BENCH := $(BUILD_DIR)/bench
BENCH_SCENES = courtyard statue field corridor backroom room \
  $(if $(KITCHEN),kitchen)
BENCH_SIZES = 1000 10000 100000 1000000 $(if $(BENCH_LARGE),10000000)

COMPARED = $(BENCH_SCENES:%=$(BENCH)/%)
SIZED = $(BENCH_SIZES:%=$(BENCH)/field-%)
AND_VIEWS = $(foreach scene,$(1),$(scene).obj $(scene).view)

# The peer, a path tracer on Embree, is no part of this project. Without it its
# columns stay empty.
PEER ?= ../shared/peers/embree_pt.cpp
EMBREE = /usr/include/embree3/rtcore.h

.PHONY: bench bench-traversal bench-peer bench-sizes bench-tools
bench:
	@for part in traversal peer sizes; do \
	  $(MAKE) --no-print-directory bench-$$part || exit 1; done
	@python3 $(SCRIPTS)/measure.py show \
	  $(patsubst %,$(MEASURED)/%.csv,traversal bench sizes)

# field-1000 is the field with 1000 triangles.
$(BENCH)/%.obj $(BENCH)/%.view: $(addprefix book/src/,programs/scenes.rs \
  interiors.rs mixtures.rs room.rs sweep.rs) | $(BOOK)
	@mkdir -p $(BENCH)
	$(BOOK) scenes $(subst -, ,$*) > $(BENCH)/$*.obj
	$(BOOK) scenes --view $(subst -, ,$*) > $(BENCH)/$*.view

$(BENCH)/courtyard.obj $(BENCH)/courtyard.view &: $(BUILD_DIR)/courtyard.obj
	@mkdir -p $(BENCH)
	cp $< $(BENCH)/courtyard.obj
	@echo '$(CAMERA)' > $(BENCH)/courtyard.view

$(BENCH)/kitchen.obj $(BENCH)/kitchen.view &: $(KITCHEN)
	@mkdir -p $(BENCH)
	case '$<' in *.zst) zstd -dqf -o $(BENCH)/kitchen.obj '$<' ;; \
	  *) cp '$<' $(BENCH)/kitchen.obj ;; esac
	@echo '-p 3.0,1.5,1.4 -t -3.9438584,1.5,-1.7303504 -u 0,1,0 -F 70' \
	  > $(BENCH)/kitchen.view

bench-tools: $(BUILD_DIR)/pt
	@command -v python3 > /dev/null || \
	  { echo 'error: make bench needs python3' >&2; exit 1; }
	@mkdir -p $(BENCH)
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

# One row of names serves for all scenes.
bench-traversal: bench-tools $(BOOK) $(call AND_VIEWS,$(COMPARED))
	$(RECORD) traversal sh -c 'for scene in $(COMPARED); do \
	  $(BOOK) traversal -i $$scene.obj $$(cat $$scene.view) -r 0.8 \
	    -d 400x300 || exit 1; done | awk "!/^scene,/ || !head++"'

BESIDE_PEER = python3 $(SCRIPTS)/measure.py $(1) $(BUILD_DIR)/pt \
  $$(ls $(BENCH)/embree_pt 2> /dev/null) $(2)

bench-peer: bench-tools $(call AND_VIEWS,$(COMPARED))
	$(RECORD) bench $(call BESIDE_PEER,peer,$(COMPARED))

bench-sizes: bench-tools $(call AND_VIEWS,$(SIZED))
	$(RECORD) sizes $(call BESIDE_PEER,sizes,$(SIZED))

# In which time pt reaches the error of the peer. After the @ stands the albedo
# if it is not 0.8. The references take some four hours on an idle machine and
# stay in $(BENCH); those of REFERENCE=4096 take one, and serve almost as well.
EFFICIENCY = courtyard statue field corridor backroom backroom@0.5 \
  room room@0.5 \
  $(if $(KITCHEN),kitchen kitchen@0.5)
ROUNDS = 5
BUDGETS = 4,16,64,256
REFERENCE = 16384
CHALLENGED = $(foreach scene,$(EFFICIENCY),$(firstword $(subst @, ,$(scene))))

.PHONY: efficiency
efficiency: bench-tools $(call AND_VIEWS,$(addprefix $(BENCH)/,$(sort $(CHALLENGED))))
	$(RECORD) efficiency python3 $(SCRIPTS)/efficiency.py \
	  --rounds $(ROUNDS) --budgets $(BUDGETS) --reference $(REFERENCE) \
	  $(if $(INTEGRATOR),--integrator $(INTEGRATOR)) \
	  $(BUILD_DIR)/pt $(BENCH)/embree_pt $(EFFICIENCY:%=$(BENCH)/%)

# How wrong filtered pictures are, and say they are: five minutes. After the @
# stands the method if it is not a gather.
FILTERED = $(if $(KITCHEN),kitchen) room courtyard backroom corridor \
  statue statue@sobol
SHOWN = $(foreach scene,$(FILTERED),$(firstword $(subst @, ,$(scene))))
.PHONY: picture
picture: bench-tools $(call AND_VIEWS,$(addprefix $(BENCH)/,$(sort $(SHOWN))))
	$(RECORD) picture sh $(SCRIPTS)/picture.sh $(BUILD_DIR) \
	  $(FILTERED:%=$(BENCH)/%)

# Pictures in equal time with those of the peer, which OIDN denoises: twenty
# minutes on an idle machine. The denoiser and FLIP come from PyPI, into an
# environment of their own. The references, two of REF seconds for a scene, stay
# in $(BENCH).
REF = 60
ENVIRONMENT := $(BENCH)/python
$(ENVIRONMENT)/stamp:
	python3 -m venv $(@D)
	$(@D)/bin/pip install -q numpy OpenEXR mitsuba-oidn flip-evaluator
	@touch $@

.PHONY: picture-peer
picture-peer: bench-tools $(ENVIRONMENT)/stamp \
  $(call AND_VIEWS,$(addprefix $(BENCH)/,$(sort $(SHOWN))))
	$(RECORD) peer-picture $(ENVIRONMENT)/bin/python $(SCRIPTS)/picture.py \
	  --rounds $(ROUNDS) --reference $(REF) $(BUILD_DIR)/pt \
	  $(BENCH)/embree_pt $(addprefix $(BENCH)/,$(sort $(SHOWN)))

# How often the truth lies within so many errors: a minute.
.PHONY: calibration
calibration: $(BOOK)
	$(RECORD) coverage $(BOOK) calibration

# What each method gains, beside what a pilot foresees: ten minutes on an idle
# machine.
CHOSEN = $(if $(KITCHEN),kitchen kitchen@0.5) room room@0.5 \
  courtyard courtyard@0.2 \
  backroom corridor statue field
POSED = $(foreach scene,$(CHOSEN),$(firstword $(subst @, ,$(scene))))

.PHONY: choice
choice: bench-tools $(call AND_VIEWS,$(addprefix $(BENCH)/,$(sort $(POSED))))
	$(RECORD) gains python3 $(SCRIPTS)/choice.py $(BUILD_DIR)/pt \
	  $(CHOSEN:%=$(BENCH)/%)

# What each part of the gather is worth: half an hour, on a machine that may be
# busy, since nothing is timed.
WEIGHED = courtyard backroom statue room $(if $(KITCHEN),kitchen)

.PHONY: parts
parts: $(BOOK) $(call AND_VIEWS,$(WEIGHED:%=$(BENCH)/%))
	$(RECORD) parts sh -c 'for scene in $(WEIGHED:%=$(BENCH)/%); do \
	  $(BOOK) parts -i $$scene.obj $$(cat $$scene.view) -r 0.8 -n 64 \
	    -d 200x150 || exit 1; done | awk "!/^scene,/ || !head++"'

# How fast images of ptview come, on an idle machine.
RATED = courtyard room kitchen field
.PHONY: rates
rates: bench-tools $(BUILD_DIR)/ptview \
  $(call AND_VIEWS,$(addprefix $(BENCH)/,$(filter-out kitchen,$(RATED))))
	$(RECORD) rates python3 view/tests/browser.py --rates $(BUILD_DIR)/ptview \
	  $(basename $(wildcard $(RATED:%=$(BENCH)/%.obj)))

# Values of places, and how long they take: three minutes on an idle machine.
.PHONY: places
places: $(BUILD_DIR)/pt $(call AND_VIEWS,$(BENCH)/statue-100000)
	$(CARGO) build --profile $(PROFILE_$(BUILD_TYPE)) --example occlusion
	$(RECORD) places sh $(SCRIPTS)/places.sh $(BUILD_DIR)/pt \
	  $(COMPILED)/examples/occlusion $(BENCH)/statue-100000.obj

# The analytic daylight cases of CIE 171: eight minutes on two idle cores.
.PHONY: cie171
cie171: $(BUILD_DIR)/pt
	$(RECORD) cie171 python3 $(SCRIPTS)/cie171.py check $(BUILD_DIR)/pt

# View factors beside pyviewfactor and raystrack, and daylight coefficients
# beside Radiance, which PyPI has: forty minutes.
PEERS := $(BUILD_DIR)/peers
$(PEERS)/installed:
	python3 -m venv $(PEERS)
	$(PEERS)/bin/pip install -q numpy scipy pyviewfactor==1.1.* raystrack==2.* \
	  pyradiance==1.3.*
	@touch $@

.PHONY: peers
peers: $(BUILD_DIR)/pt $(BUILD_DIR)/ptimg $(PEERS)/installed
	$(RECORD) view-factors $(PEERS)/bin/python $(SCRIPTS)/view_factor_peers.py \
	  $(BUILD_DIR)/pt polygons raystrack town
	$(RECORD) daylight $(PEERS)/bin/python $(SCRIPTS)/daylight_peers.py \
	  --folder $(PEERS) all $(BUILD_DIR)/pt
	$(RECORD) autonomy python3 $(SCRIPTS)/autonomy_coverage.py \
	  $(BUILD_DIR)/pt $(BUILD_DIR)/ptimg $(PEERS)
	$(RECORD) sun-room $(PEERS)/bin/python $(SCRIPTS)/sun_room.py \
	  $(BUILD_DIR)/pt

# What panes transmit, beside Radiance: seconds.
.PHONY: pane
pane: $(BUILD_DIR)/pt $(PEERS)/installed
	$(RECORD) pane $(PEERS)/bin/python $(SCRIPTS)/pane.py $(BUILD_DIR)/pt

# ---- the pictures of the README

.PHONY: readme screens
# Pictures of the page of ptview and of a report, which stay as they are.
screens: $(BUILD_DIR)/ptview $(BUILD_DIR)/examples/session.txt
	cd $(BUILD_DIR) && python3 ../view/tests/browser.py --screen \
	  ../doc/figures/ptview.png ./ptview courtyard.obj $(CAMERA) -r 0.8
	chromium --headless --no-sandbox --hide-scrollbars --window-size=900,850 \
	  --screenshot=doc/figures/report.png \
	  file://$(abspath $(BUILD_DIR))/examples/session/scene.html

doc/figures/error.svg: $(MEASURED)/efficiency.csv $(SCRIPTS)/curve.py
	python3 $(SCRIPTS)/curve.py corridor statue < $< > $@

# A strip of a room: few samples, the same filtered, its error, and the truth.
# Some minutes; the pictures are not made again by each build.
STRIP = $(BUILD_DIR)/pt $$(cat $(BENCH)/room.view) -d 240x180 -r 0.8 -qf \
  --ground 0.3 --exposure 4 -i $(BENCH)/room.obj -o
STRIPS := doc/figures/readme
readme: $(BUILD_DIR)/pt $(BUILD_DIR)/ptimg $(BENCH)/room.obj $(BENCH)/room.view \
  doc/figures/error.svg
	$(STRIP) $(STRIPS)-4.png -n 4 --integrator reference --no-filter
	$(STRIP) $(STRIPS)-filtered.png --time 2
	$(STRIP) $(BUILD_DIR)/figures/readme.exr --time 2
	$(BUILD_DIR)/ptimg stderr -f $(BUILD_DIR)/figures/readme.exr \
	  -o $(STRIPS)-error.png
	$(STRIP) $(STRIPS)-truth.png -n 512

# The README's pictures of the sun: the courtyard as in the book, and the
# kitchen, if KITCHEN names its OBJ.
.PHONY: suns
suns: $(SUNS) $(if $(KITCHEN),doc/figures/sun-kitchen.png)
	cp $(filter %ing.png %on.png,$(SUNS)) doc/figures

doc/figures/sun-kitchen.png: $(BUILD_DIR)/pt $(BENCH)/kitchen.obj
	$(SUN) 64 $$(cat $(BENCH)/kitchen.view) --sun 340,30 $(BENCH)/kitchen.obj

# ---- mixtures of scales

# The scenes of book/src/mixtures.rs, the smallest of each name first, to which
# the rates of the others are relative. Some seven minutes on an idle machine.
MIXED = $(addprefix ball-,10 100 1e3 1e4 1e5 1e6 1e7 1e8 1e9 1e10 1e11 1e12) \
  $(addprefix aside-,10 1e3 1e5 1e7 1e9 1e10) $(addprefix rim-,10 1e5 1e9) \
  $(addprefix sunk-,10 1e5 1e9) $(addprefix cube-,10 1e5 1e9) \
  split-10 split-1e6 $(addprefix hair-,10 1e4 1e7) \
  $(addprefix grass-,10 1e3 5e4) utm-0 utm-5.6e6 \
  two-10 two-1e9 other-10 other-1e9

.PHONY: mixtures
mixtures: bench-tools $(call AND_VIEWS,$(MIXED:%=$(BENCH)/%))
	$(RECORD) mixtures $(call BESIDE_PEER,mixtures,$(MIXED:%=$(BENCH)/%))

# The ball alone, with the differences from our mean at 1e6, of which less than
# 1e-6 is not printed. pgfplots has no use for what is not a number but nan.
$(BUILT)/mixtures-ball.csv: $(MEASURED)/mixtures.csv | $(BUILT)
	awk -F , -v OFS=, ' \
	  function off(m) { if (m == "") return "nan"; m -= mean; \
	    if (m < 0) m = -m; return m < 1e-6 ? 1e-6 : m } \
	  FNR == NR { if ($$1 == "ball" && $$2 == "1e6") mean = $$6; next } \
	  $$1 == "mixture" { print "number,ours_mrays,peer_mrays,ours_off,peer_off" } \
	  $$1 == "ball" { print $$2, $$3 + 0 ? $$3 : "nan", $$5 + 0 ? $$5 : "nan", \
	    off($$6), off($$8) }' $< $< > $@

# ---- a filtered picture

FIGURES += $(BUILD_DIR)/figures/picture-plain.png \
  $(BUILD_DIR)/figures/picture-filtered.png
TABLES += $(BUILT)/filtered.tex $(BUILT)/peer-picture.tex

$(BUILD_DIR)/figures/picture-plain.png: NO_FILTER = --no-filter
$(BUILD_DIR)/figures/picture-%.png: $(BUILD_DIR)/pt \
  $(BUILD_DIR)/courtyard.obj | $(BUILD_DIR)/figures
	$(BUILD_DIR)/pt $(CAMERA) -d 360x270 -n 4 -r 0.8 -q -f $(NO_FILTER) \
	  --integrator gather -i $(BUILD_DIR)/courtyard.obj -o $@

# The first row of a scene has its name, and eleven columns are enough.
$(BUILT)/filtered.tex: $(MEASURED)/picture.csv
$(BUILT)/peer-picture.tex: $(MEASURED)/peer-picture.csv
$(BUILT)/filtered.tex $(BUILT)/peer-picture.tex: | $(BUILT)
	awk -F '[,/]' -v OFS=' & ' -v machine=$(basename $@)-machine.tex \
	  '/^#/ { sub(/^# */, ""); print $$0 "%" > machine } \
	  /^[^#].*\// { sub("@sobol", " by nets"); sub("backroom", "back room"); \
	  if (NF > 11) NF = 11; scene = $$1; $$1 = scene == last ? "" : scene; last = scene; \
	  print $$0 " \\\\" }' $< > $@

# ---- samples and errors

# The courtyard by two methods, with few and many samples. The white of all
# images of errors is the error WHITE.
SAMPLED = $(foreach method,reference gather,$(addprefix $(method)-,1 16 256))
ERRORS = $(filter-out %-1,$(SAMPLED))
WHITE = 0.3
FIGURES += $(SAMPLED:%=$(BUILD_DIR)/figures/samples-%.png) \
  $(ERRORS:%=$(BUILD_DIR)/figures/errors-%.png)
TABLES += $(ERRORS:%=$(BUILT)/rmse-%.tex)

$(patsubst %,$(BUILD_DIR)/figures/samples-%.exr,$(SAMPLED)): \
  $(BUILD_DIR)/figures/samples-%.exr: $(BUILD_DIR)/pt \
  $(BUILD_DIR)/courtyard.obj | $(BUILD_DIR)/figures
	$(BUILD_DIR)/pt $(CAMERA) -d 128x96 -r 0.8 -q -f \
	  --integrator $(subst -, -n ,$*) -i $(BUILD_DIR)/courtyard.obj -o $@

$(patsubst %,$(BUILD_DIR)/figures/samples-%.png,$(SAMPLED)): \
  %.png: %.exr $(BUILD_DIR)/ptimg
	$(BUILD_DIR)/ptimg tonemap -f -o $@ $<

# ptimg says what error its own white is. It warns of the grey that it reads.
$(ERRORS:%=$(BUILD_DIR)/figures/errors-%.png): $(BUILD_DIR)/figures/errors-%.png: \
  $(BUILD_DIR)/figures/samples-%.exr $(BUILD_DIR)/ptimg
	said=$$($(BUILD_DIR)/ptimg stderr -f -o $@ $< 2>&1) && \
	stops=$$(echo $$said | awk '{ print log($$NF / $(WHITE)) / log(2) }') && \
	$(BUILD_DIR)/ptimg tonemap -f -e $$stops -o $@ $@ 2> /dev/null

$(patsubst %,$(BUILT)/rmse-%.tex,$(ERRORS)): $(BUILT)/rmse-%.tex: \
  $(BUILD_DIR)/figures/samples-%.exr $(BUILD_DIR)/ptimg | $(BUILT)
	$(BUILD_DIR)/ptimg info $< | awk '/^ *rmse:/ { printf "%.4f%%\n", $$2 }' > $@

# A room by three methods, with the samples of about the same time.
EQUAL_reference = 16
EQUAL_sobol = 16
EQUAL_gather = 8
FIGURES += $(patsubst %,$(BUILD_DIR)/figures/equal-%.png,reference sobol gather)

$(BUILD_DIR)/figures/equal-%.png: $(BUILD_DIR)/pt $(BENCH)/room.obj \
  $(BENCH)/room.view | $(BUILD_DIR)/figures
	$(BUILD_DIR)/pt -r 0.8 $$(cat $(BENCH)/room.view) -d 200x150 -q -f \
	  --integrator $* -n $(EQUAL_$*) --no-filter --exposure 4 \
	  -i $(BENCH)/room.obj -o $@

# The scenes of which the chapters measure the times, with the stops by which
# the interiors are brighter on paper.
PICTURED = courtyard statue corridor backroom room
STOPS_corridor = 7
STOPS_backroom = 6
STOPS_room = 4
SIZE_room = 480x360
FIGURES += $(PICTURED:%=$(BUILD_DIR)/figures/scene-%.png)

$(PICTURED:%=$(BUILD_DIR)/figures/scene-%.png): $(BUILD_DIR)/figures/scene-%.png: \
  $(BENCH)/%.obj $(BENCH)/%.view $(BUILD_DIR)/pt $(BUILD_DIR)/ptimg \
  | $(BUILD_DIR)/figures
	$(BUILD_DIR)/pt -r 0.8 $$(cat $(BENCH)/$*.view) -d $(or $(SIZE_$*),160x120) -n 64 -q -f \
	  --integrator auto -i $(BENCH)/$*.obj -o $(@:.png=.exr)
	$(BUILD_DIR)/ptimg tonemap -f -e $(or $(STOPS_$*),0) -o $@ $(@:.png=.exr)

# Skies of the CIE as a camera sees them that looks up.
SKIES = 1 4 8 12 15
FIGURES += $(SKIES:%=$(BUILD_DIR)/figures/sky-%.png)

$(SKIES:%=$(BUILD_DIR)/figures/sky-%.png): $(BUILD_DIR)/figures/sky-%.png: \
  $(BUILD_DIR)/pt doc/examples/room.obj | $(BUILD_DIR)/figures
	$(BUILD_DIR)/pt doc/examples/room.obj -qf -p 3,2,50 -t 3,2,60 -u 0,1,0 \
	  --zenith z --sky cie:$* --sun 180,40 -F 120 -d 160x160 -n 4 \
	  --exposure=-2 -o $@

# The same as glances.
FIGURES += $(PICTURED:%=$(BUILD_DIR)/figures/glance-%.png)

$(PICTURED:%=$(BUILD_DIR)/figures/glance-%.png): $(BUILD_DIR)/figures/glance-%.png: \
  $(BENCH)/%.obj $(BENCH)/%.view $(BUILD_DIR)/pt | $(BUILD_DIR)/figures
	$(BUILD_DIR)/pt -r 0.8 $$(cat $(BENCH)/$*.view) -d 320x240 -n 1 -q -f \
	  --exposure auto -i $(BENCH)/$*.obj -o $@

# ---- a path tracer in ten pages

# What it is called with, and the part of it that each of some chapters replaces.
TERRACE = doc/examples/terrace.obj 5,0.2,2.6 2.2,2.5,0.55
FIGURES += $(BUILD_DIR)/figures/tiny.png
TABLES += $(BUILT)/tiny-faults.tex $(BUILD_DIR)/examples/gallery.txt \
  $(addprefix $(BUILD_DIR)/examples/tiny-,hit.txt random.txt reflect.txt \
  mean.txt render.txt)
REPLACED_hit = Find the first triangle that a ray meets
FROM_hit = /The nearest/
REPLACED_random = Draw random numbers
REPLACED_reflect = Reflect the ray on its own side of the triangle
REPLACED_mean = Average samples
REPLACED_render = Render an image

$(BUILD_DIR)/examples/tiny-%.txt: chapters/tiny.nw $(NOWEB)
	@mkdir -p $(@D)
	$(NOWEB) notangle -R'$(REPLACED_$*)' $< | sed -n '$(or $(FROM_$*),1),$$p' > $@

$(BUILD_DIR)/examples/gallery.txt $(BUILD_DIR)/figures/tiny.pgm &: \
  examples/gallery.rs examples/tiny.rs doc/examples/terrace.obj \
  | $(BUILD_DIR)/figures
	@mkdir -p $(BUILD_DIR)/examples
	$(CARGO) run -q --release --example gallery > $(BUILD_DIR)/examples/gallery.txt
	echo '$$ cargo run --release --example tiny -- \' > $(BUILD_DIR)/examples/tiny.txt
	echo '    $(TERRACE) 256 > tiny.pgm' >> $(BUILD_DIR)/examples/tiny.txt
	$(CARGO) run -q --release --example tiny -- $(TERRACE) 256 \
	  > $(BUILD_DIR)/figures/tiny.pgm 2>> $(BUILD_DIR)/examples/tiny.txt

$(BUILD_DIR)/figures/tiny.png: $(BUILD_DIR)/figures/tiny.pgm $(BUILD_DIR)/ptimg
	$(BUILD_DIR)/ptimg tonemap -f -o $@ $< 2> /dev/null

# How weak it is: a minute on an idle machine.
.PHONY: tiny
tiny: $(BOOK)
	$(RECORD) tiny-faults $(BOOK) tiny doc/examples/terrace.obj

# ---- geometry: figures

# Vertices, tiles and closed forms.
GEOMETRY := $(addprefix $(BUILD_DIR)/figures/geometry-,$(addsuffix .png, \
  vertex-single vertex-ours tiles-statue tiles-field))
GEOMETRY_TABLES := $(BUILT)/geometry.tex
FIGURES += $(GEOMETRY)
TABLES += $(GEOMETRY_TABLES)

$(GEOMETRY) $(GEOMETRY_TABLES) &: $(BOOK) | $(BUILD_DIR)/figures $(BUILT)
	$(BOOK) geometry $(BUILD_DIR)/figures $(BUILT)

# Rows of recorded tables that the book does not print: those whose fields,
# with the name of the group in front, match.
LEFT_OUT_stability = ^(icosphere [1-5]|all.*10.[36]|cavity.*scaled.*200|plane.*(e-30|e30),)
LEFT_OUT_mixtures = ^(ball,(100|1e4|1e8|1e10|1e11)|aside,(1e3|1e7|1e10)|(rim|sunk|cube),1e5|hair,1e4),
LEFT_OUT_traversal = ,(litpt|Embree|Embree robust),1,
SHORTENED = stability mixtures traversal
$(SHORTENED:%=$(BUILT)/%.tex): $(BUILT)/%.tex: $(MEASURED)/%.csv \
  $(SCRIPTS)/table.awk | $(BUILT)
	awk -F , -v out='$(LEFT_OUT_$*)' '/^#/ { print; next } \
	  $$1 != "" { group = $$1 } \
	  !head++ || group substr($$0, index($$0, ",")) !~ out' $< | \
	awk -v most=$(COLUMNS_$*) -v machine=$(@D)/$*-machine.tex \
	  -f $(SCRIPTS)/table.awk > $@

# ---- light by chance: figures

# Directions, running means and the errors of two pixels; the courtyard by the
# number of reflections; and the numbers of the text.
FIGURES += $(foreach kind,term sum,$(foreach k,1 2 3 4, \
  $(BUILD_DIR)/figures/bounces-$(kind)-$(k).png))
TABLES += $(addprefix $(BUILT)/,chance.tex lobe.csv spread.csv covered.csv)

$(addprefix $(BUILT)/,chance.tex lobe.csv spread.csv covered.csv) &: \
  $(BOOK) | $(BUILT)
	$(BOOK) chance $(@D) > $(BUILT)/chance.tex

$(BUILT)/bounces.tex $(filter $(BUILD_DIR)/figures/bounces-%,$(FIGURES)) &: \
  $(BOOK) | $(BUILT) $(BUILD_DIR)/figures
	$(BOOK) bounces $(BUILD_DIR)/figures > $(BUILT)/bounces.tex
TABLES += $(BUILT)/bounces.tex

# ---- the gather: figures

# The gains of the methods, drawn; the tables of what is learnt are read.
TABLES += $(BUILT)/gains.csv $(LEARNT_TABLES)
