# Variables: PYTHON (interpreter that makes .venv), UV (empty: use venv and pip even where uv is
# present), OUT (where the demo writes), ARGS (passed on to the demo or to pytest), DIST (wheels).
PYTHON ?= python3
OUT ?= build/demo
DIST ?= dist
ARGS ?=

BIN := .venv/bin
READY := .venv/.ready

# One thread in the numeric libraries: times stay comparable between machines and between runs,
# and two processes on two cores do not fight over them.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

.DEFAULT_GOAL := help
.PHONY: help demo test fuzz lint bench-loading bench-geometry bench-classify bench-calibration bench-live bench-viewer soak gallery wheel lock clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo: $(READY)  ## touches named on the iCub's body, written to build/demo (or OUT=folder)
	$(BIN)/skinmap demo --out "$(OUT)" $(ARGS)

test: $(READY)  ## the test suite (ARGS="-k flat" for a part of it)
	@$(BIN)/python scripts/system_packages.py --browser
	$(BIN)/python -m pytest $(ARGS)

fuzz: $(READY)  ## damaged files and messages of all kinds, fifty times as many as in the suite
	HYPOTHESIS_PROFILE=fuzz $(BIN)/python -m pytest tests -m fuzz $(ARGS)

lint: $(READY)  ## style, formatting, types, import order
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench-loading: $(READY)  ## time and memory to load 1 and 13 parts, to benchmarks/results
	$(BIN)/python benchmarks/loading.py

bench-geometry: $(READY)  ## meshes, flat maps and contact images beside their peers, to benchmarks/results
	$(BIN)/python benchmarks/geometry.py $(ARGS)

bench-classify: $(READY)  ## speed of histograms, SVM and labels, to benchmarks/results
	$(BIN)/python benchmarks/classify.py $(ARGS)

gallery: $(READY)  ## the pictures of docs/viewer.md
	$(BIN)/python -m viewer.gallery $(ARGS)

bench-calibration: $(READY)  ## accuracy of calibrations by anchors, touches, scans, to benchmarks/results
	$(BIN)/python benchmarks/calibration.py $(ARGS)

bench-live: $(READY)  ## streams, loop, identities, memory and recordings (18 min), to benchmarks/results (ARGS=--quick)
	$(BIN)/python benchmarks/live.py $(ARGS)

soak: $(READY)  ## 50 recorders killed, a full disk, a press of ten minutes, 200,000 samples
	$(BIN)/python benchmarks/recordings.py --kills 50
	$(BIN)/python benchmarks/live.py --only press $(ARGS)
	$(BIN)/python benchmarks/live.py --only soak $(ARGS)

bench-viewer: $(READY)  ## frames, start-up and memory of the viewer, to benchmarks/results (ARGS=--quick)
	$(BIN)/python benchmarks/viewer_speed.py $(ARGS)

wheel: $(READY)  ## the distribution, written to dist (or DIST=folder)
	rm -rf build/lib build/bdist.*  # a module deleted since would still be packed from here
	$(BIN)/python -m build --quiet --wheel --no-isolation --outdir "$(DIST)"

lock:  ## renew constraints.txt with the newest versions that fit together
	scripts/lock.sh

clean:  ## remove all that these targets made, .venv too
	rm -rf .venv build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(READY): pyproject.toml constraints.txt
	@PYTHON="$(PYTHON)" scripts/environment.sh .venv -e '.[dev]'
	@touch $@
