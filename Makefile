# make demo    the main job on meshes the package makes itself; sets everything up
# make test    the tests; sets everything up
# make check   style, types, import floors
# make bench   benchmarks, peers side by side where installed
# Nothing but Python >= 3.11 and make needs to be there. The test data are optional: MORPHLET_DATA=folder.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO := out/demo

.PHONY: demo test check bench clean

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

$(VENV)/bench: $(VENV)/test
	$(BIN)/python -m pip install --quiet -e '.[render,bench]'
	@touch $@

clean:
	rm -rf $(VENV) out build dist
