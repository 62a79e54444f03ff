# Two commands for a new user: `make demo` and `make test`. Everything installs into .venv.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

.PHONY: demo proof test test-slow test-all static check bench docs notebooks fuzz wheel lowest format clean

$(VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet -e .
	touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet -e ".[dev]"
	touch $@

demo: $(VENV)/.installed  ## run the main job on an embedded flight
	$(BIN)/structsel demo --out out/demo

# Kernels are compiled once, and then two processes of one thread each run the tests. Tests of one file go to the same
# process: they share what they compute. TESTS=tests/test_cli.py runs this file only.
COMPILE = OMP_NUM_THREADS=1 $(BIN)/python -m tests.compile_kernels
PYTEST = OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile

test: $(VENV)/.installed-dev  ## run the default set of tests, in about five minutes
	$(COMPILE)
	$(PYTEST) -m "not slow" $(TESTS)

test-slow: $(VENV)/.installed-dev  ## run the tests that the default set leaves out
	$(COMPILE)
	$(PYTEST) -m slow $(TESTS)

test-all: test test-slow  ## run every test

static: $(VENV)/.installed-dev  ## format, lint, import order, types
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/mypy

check: static test  ## everything a commit must pass

.venv-bench/.installed: pyproject.toml benchmarks/requirements.txt
	$(PYTHON) -m venv .venv-bench
	.venv-bench/bin/python -m pip install --quiet --upgrade pip
	.venv-bench/bin/python -m pip install --quiet -r benchmarks/requirements.txt
	.venv-bench/bin/python -m pip install --quiet -e ".[dask]"
	touch $@

bench: .venv-bench/.installed  ## ratios against X.T @ X and the peers, goals S1 to S6; half an hour; CONTINUE=--continue resumes
	OMP_NUM_THREADS=1 .venv-bench/bin/python benchmarks/selection.py --samples 20000,200000 --peer-samples 200000 --other-peer-samples 20000 --parts time,peers,memory,workers --out out/bench.md $(CONTINUE)

fuzz: $(VENV)/.installed-dev  ## damaged files by the thousand, for every reader; about half an hour
	OMP_NUM_THREADS=1 STRUCTSEL_FUZZ=200 $(BIN)/python -m pytest tests/test_fuzzing.py -k damaged -q -s

proof: $(VENV)/.installed-dev  ## how often the diagnosis is right: CASES (20) cases of development
	OMP_NUM_THREADS=1 $(BIN)/python -m proof --cases $(or $(CASES),20) --out out/proof

docs: $(VENV)/.installed-dev  ## build the site in out/site; a dead link stops it
	$(BIN)/python -m pip install --quiet -e ".[docs]"
	OMP_NUM_THREADS=1 $(BIN)/mkdocs build --quiet

notebooks: $(VENV)/.installed-dev  ## run the notebooks of examples/, and store what they show
	OMP_NUM_THREADS=1 $(BIN)/python docs/notebooks.py $(NOTEBOOKS)

wheel: $(VENV)/.installed-dev  ## build the wheel, look what is in it, install it by itself and use it
	rm -rf build out/wheel
	$(BIN)/python -m build --quiet --wheel --outdir out/wheel .
	$(BIN)/python .ci/check_wheel.py out/wheel/*.whl

# Direct dependencies as old as pyproject.toml allows, theirs as new as fits.
lowest: $(VENV)/.installed-dev  ## run the tests with the oldest dependencies allowed
	$(BIN)/python -m uv venv --quiet --clear --python $(BIN)/python out/lowest
	$(BIN)/python -m uv pip install --quiet --python out/lowest/bin/python --resolution lowest-direct -e ".[test]"
	$(MAKE) test test-slow BIN=out/lowest/bin

format: $(VENV)/.installed-dev  ## put the code in order
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf $(VENV) .venv-bench out
