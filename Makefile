# make demo: see a room reconstructed.   make test: every check the project has.
# Both share .venv; it is rebuilt only when pyproject.toml or constraints.txt change. The tests also read files made by real
# annotation tools, which live in .venv-tools, and have glTF files judged by Khronos's validator, if npm is there.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ROOM := examples/room
INPUTS := pyproject.toml constraints.txt
TOOLS := .venv-tools
AUDIT := .venv-audit
VALIDATOR := tests/tools/node
COVERAGE := .venv-coverage
# The demo has every command but those for PyTorch, CVAT, HEIC, IFC and USD, which are large or rarely asked for.
DEMO_EXTRAS := annotate,batch,colmap,dxf,report,view
# A file of tests whose process ended is begun again, once: one that hangs would otherwise take the time many times.
PYTEST := python -m pytest -n 2 --dist loadfile --max-worker-restart 1

OLDER := $(addprefix tests/test_,$(addsuffix .py,last_bit synth synth_annotate synth_errors synth_images synth_paths \
	synth_rooms tracking correspondence edges edge_group evidence estimation linearisation error_scales arrow regroup extent extent_details dimensions solved_room measured floor_plan mesh quality real_clips))

.PHONY: demo test test-older-cpu fuzz audit coverage pictures clean

demo: $(VENV)/.installed
	$(BIN)/gtlayout solve $(ROOM)
	$(BIN)/gtlayout evaluate $(ROOM)
	$(BIN)/gtlayout report $(ROOM)
	@echo "Results: $(ROOM)/gtlayout/ (report.html opens in any browser, layout.glb in any 3D viewer; layout.json holds the planes)"

test: $(VENV)/.installed-dev $(TOOLS)/.installed $(VALIDATOR)/node_modules
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	$(BIN)/$(PYTEST)

# What arithmetic decides, as on a processor without AVX-512: NumPy, OpenBLAS and OpenCV differ there in the last bit.
test-older-cpu: $(VENV)/.installed-dev
	$(BIN)/python eval/processors.py avx2 $(BIN)/$(PYTEST) $(OLDER)

# Each reader of files for a minute: about five minutes. FUZZ=600 gives each ten.
FUZZ := 60
fuzz: $(VENV)/.installed-dev
	PYTHONPATH=tests $(BIN)/python tests/fuzz/fuzz_all.py $(FUZZ)

# Known weaknesses of every version that constraints.txt pins, as the index of packages knows them; one that it does not
# know fails, too. Needs the network.
audit: | $(BIN)/pip
	$(BIN)/python -m venv $(AUDIT)
	$(AUDIT)/bin/pip install --quiet --disable-pip-version-check pip-audit==2.10.1
	$(AUDIT)/bin/pip-audit --strict --no-deps --disable-pip --requirement constraints.txt

# Lines and branches of gtlayout/ and factors/ that the tests run, those of the processes that they start among them.
coverage: $(COVERAGE)/.installed $(TOOLS)/.installed
	$(COVERAGE)/bin/$(PYTEST) --cov --cov-report=term:skip-covered --cov-report=html

# The pictures of README and docs. They need Debian's chromium.
pictures: $(VENV)/.installed-dev
	for script in strip report drawing viewer annotate; do $(BIN)/python docs/$${script}_pictures.py || exit 1; done

# The interpreter is checked by name so that an old one gets a sentence, not pip's traceback.
$(BIN)/pip:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
		{ echo "gtlayout needs Python 3.11 or newer and '$(PYTHON)' is not; use: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(INPUTS) | $(BIN)/pip
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[$(DEMO_EXTRAS)]'
	@touch $@

$(VENV)/.installed-dev: $(INPUTS) | $(BIN)/pip
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $@ $(VENV)/.installed

# A second environment that has the first one's packages: measuring needs two more, which nothing else does.
$(COVERAGE)/.installed: $(VENV)/.installed-dev
	$(PYTHON) -m venv $(COVERAGE)
	$(COVERAGE)/bin/pip install --quiet --disable-pip-version-check 'coverage>=7.10' 'pytest-cov>=7' --constraint constraints.txt
	$(BIN)/python -c 'import sysconfig; print("import site; site.addsitedir(%r)" % sysconfig.get_path("purelib"))' \
		> $$($(COVERAGE)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/of_the_first.pth
	@touch $@

$(TOOLS)/.installed: tests/tools/requirements.txt | $(BIN)/pip
	$(BIN)/python -m venv $(TOOLS)
	$(TOOLS)/bin/pip install --quiet --disable-pip-version-check --requirement tests/tools/requirements.txt
	@touch $@

$(VALIDATOR)/node_modules: $(VALIDATOR)/package.json
	@if command -v npm > /dev/null; then \
		cd $(VALIDATOR) && npm install --no-package-lock --no-audit --no-fund --ignore-scripts --loglevel=error && touch node_modules; \
	else echo "npm is not there: glTF files are not judged by Khronos's validator" >&2; fi

clean:
	rm -rf $(VENV) $(TOOLS) $(AUDIT) $(COVERAGE) htmlcov .coverage $(VALIDATOR)/node_modules build *.egg-info \
		.mypy_cache .pytest_cache .ruff_cache $(ROOM)/gtlayout
