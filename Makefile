# make demo: see a room reconstructed.   make test: every check the project has.
# Both share .venv; it is rebuilt only when pyproject.toml or constraints.txt change. The tests also read files made by real
# annotation tools, which live in .venv-tools.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ROOM := examples/room
INPUTS := pyproject.toml constraints.txt
TOOLS := .venv-tools

.PHONY: demo test clean

demo: $(VENV)/.installed
	$(BIN)/gtlayout solve $(ROOM)
	$(BIN)/gtlayout evaluate $(ROOM)
	@echo "Results: $(ROOM)/gtlayout/ (layout.glb opens in any 3D viewer; layout.json holds the planes and their covariances)"

test: $(VENV)/.installed-dev $(TOOLS)/.installed
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/python -m pytest

# The interpreter is checked by name so that an old one gets a sentence, not pip's traceback.
$(BIN)/pip:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
		{ echo "gtlayout needs Python 3.11 or newer and '$(PYTHON)' is not; use: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(INPUTS) | $(BIN)/pip
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable .
	@touch $@

$(VENV)/.installed-dev: $(INPUTS) | $(BIN)/pip
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $@ $(VENV)/.installed

$(TOOLS)/.installed: tests/tools/requirements.txt | $(BIN)/pip
	$(BIN)/python -m venv $(TOOLS)
	$(TOOLS)/bin/pip install --quiet --disable-pip-version-check --requirement tests/tools/requirements.txt
	@touch $@

clean:
	rm -rf $(VENV) $(TOOLS) build *.egg-info .mypy_cache .pytest_cache .ruff_cache $(ROOM)/gtlayout
