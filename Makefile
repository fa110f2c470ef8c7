# `make demo` and `make test` do everything, from a bare clone on.
BIN := .venv/bin
SEED ?= 0

.PHONY: demo test slow lint gate bench pictures setup clean
.DEFAULT_GOAL := demo

demo: setup
	$(BIN)/eventsweep run desk --seed $(SEED) --out demo --force
	@echo "Open demo/report.html"

test: setup
	$(BIN)/python -m pytest -n auto

slow: setup
	$(BIN)/python -m pytest --run-slow

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Whether maps and scores are as good as in the committed baseline.
gate: setup
	$(BIN)/eventsweep gate --baseline reports/baseline.json --strict

bench: setup
	$(BIN)/python -m pytest tests/bench_*.py --benchmark-only -p no:xdist

# The pictures in the documentation.
pictures: setup
	for case in desk boxes planes; do \
		$(BIN)/eventsweep run $$case --out out/$$case --force --quiet || exit; \
		cp out/$$case/overview.png docs/images/$$case.png; \
	done
	$(BIN)/python -m scenes._sheet docs/images/twins.png
	$(BIN)/python -m scenes._sheet docs/images/twins_outdoor.png tumvie-skate tumvie-run tumvie-bike \
		dsec-street moving-objects low-texture repetitive thin-structures reflective
	$(BIN)/python -m sim.sensor_pictures
	$(BIN)/python -m sim.motion_figures docs/images
	$(BIN)/python docs/draw_lenses_and_light.py

setup: .venv/installed

.venv/installed: pyproject.toml constraints.txt .ci/setup
	.ci/setup

clean:
	rm -rf .venv demo out .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
