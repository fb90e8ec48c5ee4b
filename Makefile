# Variables: PYTHON (interpreter that makes .venv), UV (empty: use venv and pip even where uv is
# present), OUT (where the demo writes), ARGS (passed on to the demo or to pytest), JOBS (processes
# that test), DIST (wheels), INSTALL (0: missing system packages are not installed, only named),
# FUZZ_EXAMPLES, FUZZ_SECONDS and TARGETS (of `make fuzz`: damaged inputs of each reader, how long it
# follows coverage in seconds of CPU, and of which readers).
PYTHON ?= python3
OUT ?= build/demo
DIST ?= dist
ARGS ?=
JOBS ?= 2
export INSTALL ?= 1
TARGETS ?=
export FUZZ_EXAMPLES ?= 10000
FUZZ_SECONDS ?= 5

BIN := .venv/bin
READY := .venv/.ready

# One thread in the numeric libraries: times stay comparable between machines and between runs,
# and two processes on two cores do not fight over them.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

# Commands that tests start anew by the hundred are compiled once.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help demo test fuzz audit limits schemas docs tutorials figures lint bench bench-needs bench-geometry bench-classify gallery bench-calibration bench-live soak reliability bench-viewer wheel dist lock clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo: $(READY)  ## touches named on the iCub's body, written to build/demo (or OUT=folder)
	$(BIN)/skinmap demo --out "$(OUT)" $(ARGS)

test: $(READY)  ## the test suite (ARGS="-k flat" for a part of it)
	@$(BIN)/python scripts/system_packages.py --browser
	$(BIN)/python -m pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder $(ARGS)

fuzz: $(READY)  ## damaged files and messages: FUZZ_EXAMPLES of each reader, then FUZZ_SECONDS by coverage
	HYPOTHESIS_PROFILE=fuzz $(BIN)/python -m pytest tests --ignore tests/extremes -m fuzz --timeout 0 -o faulthandler_timeout=0 $(ARGS)
	$(BIN)/python scripts/fuzz.py --seconds $(FUZZ_SECONDS) $(TARGETS)

audit: $(READY)  ## known holes of the pinned versions (asks the service of pip-audit)
	$(BIN)/pip-audit -r constraints.txt --no-deps --disable-pip --strict

limits: $(READY)  ## docs/limits.md from the laws of tests/extremes/limits and what they measure
	$(BIN)/python scripts/limits.py

schemas: $(READY)  ## docs/schemas and the tables of docs/json.md from the types of result
	$(BIN)/python scripts/schemas.py

docs: $(READY)  ## the documentation, to build/docs; a warning or a broken link is an error
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs build/docs

tutorials: $(READY)  ## run the tutorials, which draw their own pictures into docs/pictures/tutorials
	cd docs/pictures/tutorials && for script in ../../tutorials/*.py; do $(CURDIR)/$(BIN)/python $$script . || exit 1; done

figures: $(READY)  ## the figures of README.md from benchmarks/results, where benchmarks leave them
	$(BIN)/python scripts/figures.py

lint: $(READY)  ## style, formatting, types, import order
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(READY)  ## all areas beside their peers, asked and got (20 min), to docs/benchmarks.md (ARGS=--quick: 4 min)
	$(BIN)/python -m benchmarks.harness.bench $(ARGS)

bench-needs: $(READY)  ## time and memory against what is asked for, to benchmarks/results and docs/needs.md
	$(BIN)/python -m benchmarks.scale.needs $(ARGS)

bench-geometry: $(READY)  ## meshes, flat maps and contact images beside their peers, to benchmarks/results
	$(BIN)/python -m benchmarks.geometry.geometry $(ARGS)

bench-classify: $(READY)  ## speed of histograms, SVM and labels, to benchmarks/results
	$(BIN)/python -m benchmarks.classify.classify $(ARGS)

gallery: $(READY)  ## the pictures of docs/viewer.md and docs/gallery.md
	$(BIN)/python scripts/gallery.py $(ARGS)

bench-calibration: $(READY)  ## accuracy of calibrations (90 min), to benchmarks/results (ARGS=--quick, ARGS='--only wrap mount')
	$(BIN)/python -m benchmarks.calibration.calibrations $(ARGS)

bench-live: $(READY)  ## streams, loop, identities, memory and recordings (18 min), to benchmarks/results (ARGS=--quick)
	$(BIN)/python -m benchmarks.live.live $(ARGS)

# Without ARGS also whole what the suite tests in a short form (the mark `soak`).
soak: $(READY)  ## files cut, disks full, commands stopped, recorders killed, memory: a table (ARGS=--quick, ARGS=stops)
	$(BIN)/python -m benchmarks.reliability.soak $(ARGS)
	$(if $(ARGS),,SUITE=whole $(BIN)/python -m pytest tests -m soak --timeout 0 -o faulthandler_timeout=0)

reliability: $(READY)  ## docs/reliability.md from what `make soak` and `make fuzz` measured
	$(BIN)/python -m benchmarks.reliability.soak fuzz

bench-viewer: $(READY)  ## frames, start-up, age and memory of the viewer (4 min), to benchmarks/results (ARGS=--quick)
	$(BIN)/python -m benchmarks.viewer.viewer_speed $(ARGS)

wheel: $(READY)  ## the distribution, written to dist (or DIST=folder)
	rm -rf build/lib build/bdist.*  # a module deleted since would still be packed from here
	$(BIN)/python -m build --quiet --wheel --no-isolation --outdir "$(DIST)"

dist: $(READY)  ## sdist and wheel, checked for the index (needs: pip install twine)
	rm -rf build/lib build/bdist.*
	$(BIN)/python -m build --quiet --no-isolation --outdir "$(DIST)"
	$(BIN)/python -m twine check "$(DIST)"/skinmap-*

lock:  ## renew constraints.txt with the newest versions that fit together
	scripts/lock.sh

clean:  ## remove all that these targets made, .venv too
	rm -rf .venv build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(READY): pyproject.toml constraints.txt
	@PYTHON="$(PYTHON)" scripts/environment.sh .venv -e '.[dev]'
	@touch $@
