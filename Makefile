# `make demo` and `make test` do everything, from a bare clone on.
BIN := .venv/bin
SEED ?= 0

.PHONY: demo test tools slow lint gate core bench site notebooks setup clean
.PHONY: pictures pictures-code pictures-scenes pictures-simulator pictures-methods pictures-baselines tables
.PHONY: measurements faults studies paper
.DEFAULT_GOAL := demo

demo: .venv/demo
	$(BIN)/eventsweep run desk --seed $(SEED) --out demo --force
	@echo "Open demo/report.html"

# Tests of one file stay with one process: they share what its fixtures simulate and map.
test: setup
	$(BIN)/python -m pytest -n auto --dist loadfile

# What measures, counts and writes tables for the documentation.
tools: setup
	$(BIN)/python -m pytest -n auto --dist loadfile tests/benchmarks

slow: setup
	HYPOTHESIS_RANDOM=1 HYPOTHESIS_EXAMPLES=100 $(BIN)/python -m pytest --run-slow -n auto --dist loadfile tests plugins

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Whether maps and scores are as good as in the committed baseline.
gate: setup
	$(BIN)/eventsweep gate --baseline reports/baseline.json --strict

# What stays without the plug-ins: the core's tests, and the part of the baseline that needs none but
# the one that draws its sequences, in a clone without the folder.
CORE_CASES := planes desk boxes low-texture oblique plain
core: setup
	rm -rf out/core && git clone --quiet . out/core && rm -rf out/core/plugins
	cd out/core && PYTHONPATH=. $(CURDIR)/$(BIN)/python -m pytest -n auto --dist loadfile
	git -C out/core checkout --quiet -- plugins/__init__.py plugins/raster
	cd out/core && PYTHONPATH=. $(CURDIR)/$(BIN)/python -m eventsweep gate --baseline reports/baseline.json \
		--strict $(CORE_CASES:%=--case %)

bench: setup
	$(BIN)/python -m pytest tests/benchmarks/speed/bench_*.py --benchmark-only -p no:xdist

# The documentation as a site, in out/site: opened as files, or served from anywhere. Warnings are errors.
site: .venv/docs
	$(BIN)/mkdocs build --quiet
	@echo "Open out/site/index.html"

# Runs the notebooks and stores what they show: minutes.
notebooks: .venv/docs
	$(BIN)/python tests/benchmarks run_notebooks

.venv/docs: .venv/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	touch .venv/docs

# The pictures in the documentation, all but those of the measurements below. A line that draws under
# fixed names has them behind it. SLIDER=FOLDER: slider_depth of the Event Camera Dataset.
pictures: pictures-code pictures-scenes pictures-simulator pictures-methods

pictures-code: setup
	$(BIN)/python docs/figures/draw_layers.py # docs/images/architecture.png

pictures-scenes: setup
	$(BIN)/python docs/figures/draw_demo.py docs/images/demo.webp
	for case in desk boxes planes; do \
		$(BIN)/eventsweep run $$case --out out/$$case --force --quiet || exit; \
	done
	cp out/desk/overview.png docs/images/desk.png
	cp out/boxes/overview.png docs/images/boxes.png
	cp out/planes/overview.png docs/images/planes.png
	$(BIN)/python docs/figures/scene_sheet.py docs/images/twins.png
	$(BIN)/python docs/figures/scene_sheet.py docs/images/twins_outdoor.png tumvie-skate tumvie-run tumvie-bike \
		dsec-street moving-objects low-texture repetitive thin-structures reflective

pictures-simulator: setup
	$(BIN)/python docs/figures/draw_sensor.py # docs/images/sensor_*.png
	$(BIN)/python docs/figures/draw_motion.py docs/images # docs/images/motion-*.png
	$(BIN)/python docs/figures/draw_lenses_and_light.py # docs/images/lenses.png docs/images/light.png
	$(BIN)/python docs/figures/draw_truth.py # docs/images/truth.png
	$(BIN)/python docs/figures/draw_align.py docs/images/align.png # docs/images/align.png
	$(BIN)/python docs/figures/draw_video.py # docs/images/video.png
	$(BIN)/python docs/figures/draw_model.py # docs/images/howto_model.png docs/images/howto_robot.png

pictures-baselines: setup
	$(BIN)/eventsweep run desk --seconds 0.5 --sim.frames.rate-hz 20 --method Alg1/H \
		--method EMVS/cam0 --method Late/union --method baselines --method Frames/sgm \
		--out out/baselines/desk --force --quiet
	$(BIN)/eventsweep run hdr-window --seconds 0.6 --sim.frames.rate-hz 20 --method Alg1/H \
		--method EMVS/cam0 --method baselines --method Frames/sgm --out out/baselines/hdr --force --quiet
	$(BIN)/eventsweep run mvsec-flying --seconds 1.2 --map.threshold-c 14 --map.median-px 9 \
		--method Alg1/H --method EMVS/cam0 --method EMVS/cam1 --method baselines \
		--out out/baselines/mvsec --force --quiet
	$(BIN)/python docs/figures/draw_baselines.py out/baselines/desk out/baselines/hdr \
		out/baselines/mvsec # docs/images/baselines-*.png

pictures-methods: pictures-scenes pictures-baselines
	$(BIN)/eventsweep map out/desk/desk/sequence --out out/windows --map.window-s 0.2 \
		--map.stride-s 0.02 --method Alg1/H --force --quiet
	$(BIN)/eventsweep fuse out/windows --mesh --min-windows 2
	$(BIN)/python docs/figures/draw_clouds.py out/windows Alg1/H docs/images/clouds_desk.png
ifdef SLIDER
	$(BIN)/eventsweep map $(SLIDER) --out out/slider --method EMVS/cam0 --map.window-s 0.8 \
		--map.stride-s 0.1 --map.min-depth-m 0.3 --map.max-depth-m 4 --map.hot-pixels 3 --force --quiet
	$(BIN)/eventsweep fuse out/slider --mesh --min-windows 2
	$(BIN)/python docs/figures/draw_clouds.py out/slider EMVS/cam0 docs/images/slider_depth.png --zoom 0.7
	$(BIN)/eventsweep map $(SLIDER) --out out/slider-learned --method EMVS/cam0 --method Focus/cam0 \
		--method Learned/cam0 --map.start-s 1 --map.duration-s 0.8 --map.min-depth-m 0.3 \
		--map.max-depth-m 4 --map.hot-pixels 3 --force --quiet
	$(BIN)/python docs/figures/draw_learned.py out/slider-learned docs/images/learned_slider_depth.png
	$(BIN)/python tests/benchmarks real_check --slider $(SLIDER) --page plugins/learned/learned.md \
		--picture docs/images/real_check.png
endif

# Tables in the documentation: of the code, in seconds; and measured, in hours on a quiet machine.
tables: setup
	$(BIN)/python tests/benchmarks install_page --page docs/install.md --commands-only
	$(BIN)/python tests/benchmarks settings_table
	$(BIN)/python tests/benchmarks readme_table
	$(BIN)/python tests/benchmarks ranking_table
	$(BIN)/python tests/benchmarks format_table docs/formats.md
	$(BIN)/python tests/benchmarks stale_tables

# What is older than its code, one part after the other; PLAN=--plan only prints them.
measurements: setup
	$(BIN)/python tests/benchmarks measurements $(PLAN) # docs/images/fidelity.png
	$(BIN)/python tests/benchmarks stale_tables

# Whether the gate's recipe, and `quick` with the unit tests, find planted faults.
faults: setup
	$(BIN)/python tests/benchmarks recipe_runs --work out/recipe
	$(BIN)/python tests/benchmarks mutation_runs --work out/mutations

# The figures and tables of docs/studies.md: see there what they cost. Jobs are kept in the cache.
STUDY = $(BIN)/eventsweep study $$name --out out/studies --seeds 0,1 --quiet
# The paper's page: 41 CPU minutes for one seed.
paper: setup
	$(BIN)/eventsweep paper --out out/paper --force
	$(BIN)/python tests/benchmarks paper_page out/paper docs/paper.md # docs/images/paper-*.webp

studies: setup
	for name in pose-drift pose-walk window-length; do \
		$(STUDY) --case boxes --case planes || exit; \
	done
	for name in pose-noise pose-rate pose-delay camera-delay focal-length principal-point \
			stereo-yaw stereo-pitch baseline-error event-share planes; do \
		$(STUDY) --case boxes --case planes --seconds 0.3 || exit; \
	done
	for name in baseline heading contrast-threshold sensor-noise illumination; do \
		$(STUDY) --case planes --seconds 0.3 || exit; \
	done
	$(BIN)/python tests/benchmarks study_pages out/studies docs/studies.md # docs/images/study_*.png

setup: .venv/installed

.venv/demo: pyproject.toml constraints.txt .ci/setup
	.ci/setup demo

.venv/installed: pyproject.toml constraints.txt .ci/setup
	.ci/setup

clean:
	rm -rf .venv demo out .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
