# make demo    the main job on meshes the package makes itself; sets everything up
# make test    the tests; sets everything up
# make check   style, types, import floors
# make bench   the benchmark book, in out/bench; ONLY="editing motion" runs these, QUICK=1 little of each
# make bench-peers  what figures stand beside: Open3D and viser in an environment of their own; what cannot be installed is said
# make test-blender  what Blender reads and writes, with its Python module (some 1 GB, for the Python versions that it supports)
# make studio  the page of the studio, from TypeScript; needs Node.js and npm, which nothing else does
# make docs    the documentation as a site, in out/docs; a warning is an error
# make test-studio   that page in a real browser; what is not there (npm, Chromium) is said, and its tests are skipped
# Nothing but Python >= 3.11 and make needs to be there. The test data are optional: MORPHLET_DATA=folder.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO := out/demo
PAGE := src/morphlet/studio/static/index.html
PAGE_SOURCES := $(shell find studio -path studio/node_modules -prune -o -type f -print)
NO_NPM := no npm: the studio's page cannot be built (Node.js 20.19 or newer is needed)

APART := open3d viser
BESIDE := scikit-sparse
MADE_PEERS = $(wildcard $(VENV)/peers/bin/python)
PEERED = $(if $(MORPHLET_PEER_PYTHON),,$(if $(MADE_PEERS),MORPHLET_PEER_PYTHON=$(CURDIR)/$(MADE_PEERS)))
ABSENT := cannot be installed here: it will be named as absent

.PHONY: demo test check bench bench-peers docs test-blender studio test-studio clean

demo: $(VENV)/core
	$(BIN)/morphlet demo -o $(DEMO) --force

# A process per core, files of tests whole, so that what they share is made once; then a second thread of BLAS would only be in the way.
test: $(VENV)/test
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadfile

check: $(VENV)/test
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(VENV)/docs
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs out/docs

bench: $(VENV)/bench
	$(PEERED) $(BIN)/python -m benchmarks $(ONLY) --out out/bench $(if $(QUICK),--quick)

bench-peers: $(VENV)/bench
	$(PYTHON) -m venv $(VENV)/peers
	@for peer in $(APART); do $(VENV)/peers/bin/python -m pip install --quiet $$peer || echo "$$peer $(ABSENT)" >&2; done
	@for peer in $(BESIDE); do $(BIN)/python -m pip install --quiet $$peer || echo "$$peer $(ABSENT)" >&2; done

test-blender: $(VENV)/test $(VENV)/blender/made
	MORPHLET_BLENDER_PYTHON=$(VENV)/blender/bin/python $(BIN)/python -m pytest tests/motion/test_blender.py

studio: $(PAGE)

test-studio: $(VENV)/browser
	@if command -v npm > /dev/null; then $(MAKE) studio; else echo "$(NO_NPM)"; fi
	$(BIN)/python -m pytest -rs tests/studio_browser

$(PAGE): $(PAGE_SOURCES)
	@command -v npm > /dev/null || { echo "$(NO_NPM)" >&2; exit 1; }
	cd studio && npm ci && npm run build

$(VENV)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "morphlet needs Python 3.11 or newer: make PYTHON=/path/to/python3.11 ..." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/core: $(VENV)/python pyproject.toml
	$(BIN)/python -m pip install --quiet -e .
	@touch $@

$(VENV)/test: $(VENV)/python pyproject.toml
	$(BIN)/python -m pip install --quiet -e '.[render,test,check]'
	@touch $@

$(VENV)/browser: $(VENV)/test
	$(BIN)/python -m pip install --quiet -e '.[studio,test,browser]'
	@touch $@

# Blender is a program that tests talk to: it lives apart from the package.
$(VENV)/blender/made: $(VENV)/python
	$(PYTHON) -m venv $(VENV)/blender
	$(VENV)/blender/bin/python -m pip install --quiet 'bpy>=4.2'
	@touch $@

$(VENV)/docs: $(VENV)/python pyproject.toml
	$(BIN)/python -m pip install --quiet -e '.[docs,studio]'
	@touch $@

$(VENV)/bench: $(VENV)/test
	$(BIN)/python -m pip install --quiet -e '.[render,bench]' || echo "not all of [bench] $(ABSENT)" >&2
	@touch $@

clean:
	rm -rf $(VENV) out build dist
