# make demo    the main job on meshes the package makes itself; sets everything up
# make test    the tests; sets everything up
# make check   style, types, import floors
# make bench   benchmarks, peers side by side where installed
# make test-blender  what Blender reads and writes, with its Python module (some 1 GB, for the Python versions that it supports)
# Nothing but Python >= 3.11 and make needs to be there. The test data are optional: MORPHLET_DATA=folder.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO := out/demo

.PHONY: demo test check bench test-blender clean

demo: $(VENV)/core
	$(BIN)/morphlet demo -o $(DEMO) --force

test: $(VENV)/test
	$(BIN)/python -m pytest

check: $(VENV)/test
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(VENV)/bench
	$(BIN)/python -m benchmarks

test-blender: $(VENV)/test $(VENV)/blender/made
	MORPHLET_BLENDER_PYTHON=$(VENV)/blender/bin/python $(BIN)/python -m pytest tests/motion/test_blender.py

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

# Blender is a program that tests talk to: it lives apart from the package.
$(VENV)/blender/made: $(VENV)/python
	$(PYTHON) -m venv $(VENV)/blender
	$(VENV)/blender/bin/python -m pip install --quiet 'bpy>=4.2'
	@touch $@

$(VENV)/bench: $(VENV)/test
	$(BIN)/python -m pip install --quiet -e '.[render,bench]'
	@touch $@

clean:
	rm -rf $(VENV) out build dist
