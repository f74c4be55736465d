# Every target sets up what it needs in .venv, once, and again when pyproject.toml
# changes. Needed beforehand: make and Python 3.11 or newer (another: PYTHON=python3.12).

PYTHON ?= python3
WORKERS ?= 2
PYTESTFLAGS ?=

VENV := .venv
CONSTRAINTS :=
OLDEST := .venv-oldest
TRIAL := .venv-dist
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check install -q \
    $(CONSTRAINTS:%=-c %)
# Parallel tests share the cores: one thread each for linear algebra.
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1

unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV
.DEFAULT_GOAL := help
.PHONY: help demo demo-short test test-long test-longest coverage test-oldest fuzz lint \
    docs test-pages dist release-check \
    bench bench-own bench-sparse bench-short bench-envs bench-page paper paper-short \
    paper-page clean

help:
	@echo 'make demo         learn a robot arm under many loads and compare the models'
	@echo 'make demo-short   the same, smaller'
	@echo 'make test         run all tests but the long ones: minutes'
	@echo 'make test-long    the long ones: clusters, whole data, hard modes'
	@echo 'make test-longest  draws against sums over grids and draws of the priors: minutes'
	@echo 'make coverage     all tests but the longest, and which lines and branches they miss'
	@echo 'make test-oldest  make test with the oldest supported versions, on Python 3.11'
	@echo 'make fuzz         2,000 random cases: minutes (fewer: FUZZFLAGS="--cases 100")'
	@echo 'make lint         check style, formatting and phrases'
	@echo 'make docs         the documentation, in docs/_build/html; its examples are run'
	@echo 'make test-pages   open every page of it in Chromium, run notebooks: minutes'
	@echo 'make dist         what a release is made of, in dist; it is checked and tried'
	@echo 'make release-check  all that must pass before a release; what is to be filled in'
	@echo 'make bench        compare with other packages: hours, see benchmarks/README.md'
	@echo 'make bench-own    the benchmarks that need no other package'
	@echo 'make bench-sparse the whole training set by inducing inputs: hours'
	@echo 'make bench-short  what make bench does, with one small problem'
	@echo 'make bench-envs   the environments of the other packages alone (5 GB)'
	@echo 'make bench-page   the pages of benchmarks and their plots from what is measured'
	@echo 'make paper        the experiments of the paper: hours, see examples/paper/README.md'
	@echo 'make paper-short  the same, tiny: a minute'
	@echo 'make paper-page   the pages of the paper from what is measured'
	@echo 'make clean        remove what was installed, caches and build products'
	@echo 'make help         this list'

demo: $(VENV)/ready-to-run
	$(BIN)/python examples/puma560_loads.py

demo-short: $(VENV)/ready-to-run
	$(BIN)/python examples/puma560_loads.py --short

# Tests of a file stay together, and share what is fitted for them, until a worker idles.
PYTEST := $(ONE_THREAD) $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal

test: $(VENV)/ready-to-test
	$(PYTEST) $(PYTESTFLAGS)

test-long: $(VENV)/ready-to-test
	$(PYTEST) -m long $(PYTESTFLAGS)

test-longest: $(VENV)/ready-to-test
	$(PYTEST) -m longest $(PYTESTFLAGS)

# coverage's own percentage counts lines and branches together.
PERCENT := import json, sys; t = json.load(sys.stdin)["totals"]; \
    print("Covered: {:.1%} of lines, {:.1%} of branches".format( \
        t["covered_lines"] / t["num_statements"], \
        t["covered_branches"] / t["num_branches"]))

coverage: $(VENV)/ready-to-test
	$(PYTEST) -m 'not longest' --cov --cov-report= $(PYTESTFLAGS)
	@$(BIN)/coverage json -q -o - | $(BIN)/python -c '$(PERCENT)'
	$(BIN)/coverage report --fail-under=95

test-oldest:
	@$(MAKE) --no-print-directory test VENV=$(OLDEST) CONSTRAINTS=.ci/oldest.txt

FUZZFLAGS ?=

fuzz: $(VENV)/ready-to-test
	$(ONE_THREAD) $(BIN)/python tests/fuzz.py $(FUZZFLAGS)

lint: $(VENV)/ready-to-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python -m pytest -q tests/project/test_prose.py

# The examples first: a page that does not run is not shown. On a terminal Sphinx says
# where it is; into a file it writes what is wrong alone. All pages are written (-a):
# of those that are not, the search would forget the words of the index.
SPHINX := $(ONE_THREAD) $(BIN)/python -m sphinx -W --keep-going -d docs/_build/.cache \
    $$([ -t 1 ] || echo -q)
HTML := docs/_build/html
docs: $(VENV)/ready-for-docs
	@echo 'Running the gallery and the examples of the pages (two or three minutes)'
	@$(SPHINX) -b doctest docs docs/_build/doctest
	@echo 'Writing the pages (a minute)'
	@$(SPHINX) -a -b html docs $(HTML)
	@echo $(HTML)/index.html

PYODIDE := docs/_build/pyodide
test-pages: $(VENV)/ready-for-pages $(HTML)/index.html $(PYODIDE)/pyodide-lock.json
	SKMTGP_SITE=$(HTML) SKMTGP_PYODIDE=$(PYODIDE) $(PYTEST) -rs $(PYTESTFLAGS) \
	    tests/project/test_site.py tests/project/test_notebooks.py

# Where it cannot be fetched, notebooks are not run: the tests are skipped and say so.
$(PYODIDE)/pyodide-lock.json: .ci/get_pyodide.py
	@echo 'Fetching a Python for the browser into $(PYODIDE) (100 MB)'
	-@$(BIN)/python $< $(PYODIDE)

$(HTML)/index.html:
	$(MAKE) --no-print-directory docs

# The wheel is built from the source distribution and tried on its own, with no extra:
# python -P, in another directory, cannot see the checkout. The examples that need
# Matplotlib or Pinocchio are skipped: see conftest.py.
dist: $(VENV)/ready-to-build
	rm -rf dist $(TRIAL)
	$(BIN)/python -m build
	$(BIN)/python -m twine check --strict dist/*
	$(BIN)/python .ci/check_dist.py
	$(PYTHON) -m venv $(TRIAL)
	$(TRIAL)/bin/python -m pip --disable-pip-version-check install -q dist/*.whl
	cd $(TRIAL) && bin/python -P -m skmtgp
	$(TRIAL)/bin/python -m pip --disable-pip-version-check install -q pytest
	cd $(TRIAL) && $(ONE_THREAD) bin/python -P -m pytest -c ../pyproject.toml \
	    -p no:cacheprovider --pyargs skmtgp

# In this order, also with make -j: the first failure ends it. What is left to fill in
# is said when all else has passed. Less of it: make release-check RELEASE="lint dist".
RELEASE ?= lint dist test docs test-pages test-long test-longest
release-check:
	@for target in $(RELEASE); do \
	    echo "make $$target"; $(MAKE) --no-print-directory $$target || exit 1; done
	$(BIN)/python .ci/check_release.py

# Every package that is compared has an environment of its own. One that cannot be
# installed is left out: the results then say so.
PEERS := gpytorch botorch gpy gpflow sklearn pykrige gstools
ENVS := benchmarks/.envs
COMPARE := $(BIN)/python benchmarks/peers/run.py
PAGE := $(BIN)/python benchmarks/peers/page.py
BENCHFLAGS ?=
OWNFLAGS ?=
SPARSEFLAGS ?=

bench: bench-own $(VENV)/ready-to-bench bench-envs
	$(COMPARE) --parts checks times fits $(BENCHFLAGS)
	$(MAKE) --no-print-directory bench-sparse

# The paper's whole training set, and the peers' sparse models.
SPARSE := $(BIN)/python benchmarks/peers/sparse_run.py
SPARSE_FITS := $(BIN)/python benchmarks/peers/sparse_fits.py

bench-sparse: $(VENV)/ready-to-bench $(ENVS)/gpytorch/ready $(ENVS)/gpflow/ready
	$(BIN)/python benchmarks/sparse_growth.py
	$(SPARSE_FITS) $(SPARSEFLAGS)
	$(SPARSE_FITS) --m 500 --n-exact 2800 --rank 4 5 --search $(SPARSEFLAGS)
	$(BIN)/python benchmarks/peers/own_run.py more_rows
	$(SPARSE) --parts checks times fits
	$(PAGE)

# What the package's own benchmarks print is kept, and shown on the page.
OWN := likelihood memory prediction large_fit modes noisy_modes kronecker digits \
    levels_and_units defaults
bench-own: $(VENV)/ready-to-bench
	$(BIN)/python benchmarks/peers/own_run.py $(OWN) $(OWNFLAGS)
	$(BIN)/python benchmarks/growth.py
	$(BIN)/python benchmarks/engines.py

bench-short: $(VENV)/ready-to-bench bench-envs
	$(COMPARE) --parts checks times fits --joints 4 --draws 0 --fit-sizes 280 \
	    --sizes 280 --time-budget 1 --budget-factor 0 --budget-min 5 --redo \
	    --results benchmarks/.short $(BENCHFLAGS)
	$(SPARSE_FITS) --short
	$(SPARSE_FITS) --short --n-exact 140 --rank 1 2 --search
	$(SPARSE) --parts checks times fits --sizes 2000 --inducing 20 --n-per-load 20 \
	    --fit-inducing 20 --budget 5 --time-budget 1 --test-rows 200 --redo \
	    --results benchmarks/.short
	$(BIN)/python benchmarks/sparse_growth.py --short
	$(PAGE) --results benchmarks/.short --docs benchmarks/.short

bench-page: $(VENV)/ready-to-bench
	$(PAGE)

bench-envs: $(PEERS:%=$(ENVS)/%/ready)

$(ENVS)/%/ready: benchmarks/peers/requirements/%.txt
	@echo 'Installing $* into $(ENVS)/$*'
	@$(PYTHON) -m venv --clear $(ENVS)/$* \
	    && $(ENVS)/$*/bin/python -m pip --disable-pip-version-check install -q -r $< \
	    && touch $@ || { rm -rf $(ENVS)/$*; echo 'No $*: its rows will say so' >&2; }

# An interrupted run goes on where it ended: make paper again.
PAPERFLAGS ?=

paper: $(VENV)/ready-to-bench
	$(BIN)/python examples/paper/run_all.py $(PAPERFLAGS)

paper-short: $(VENV)/ready-to-run
	rm -rf examples/paper/results/short
	$(BIN)/python examples/paper/run_all.py --short $(PAPERFLAGS)

paper-page: $(VENV)/ready-to-run
	$(BIN)/python examples/paper/page.py

# The stamps are written last, so that an interrupted installation is done again.
$(VENV)/ready-to-run: pyproject.toml $(CONSTRAINTS)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	    echo "skmtgp needs Python 3.11 or newer, but $(PYTHON) is:" \
	        "$$($(PYTHON) --version 2>&1). Try: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; \
	    exit 1; }
	@echo 'Installing into $(VENV) (about a minute)'
	@$(PYTHON) -m venv --clear $(VENV) || { \
	    echo "$(PYTHON) cannot make a virtual environment." \
	        "On Debian and Ubuntu: apt install python3-venv" >&2; \
	    exit 1; }
	@$(PIP) -e '.[plot]'
	@touch $@

$(VENV)/ready-to-test: $(VENV)/ready-to-run
	@echo 'Installing the tools of the tests into $(VENV) (about a minute)'
	@$(PIP) -e '.[test]'
	@touch $@

$(VENV)/ready-for-docs: $(VENV)/ready-to-run
	@echo 'Installing the tools of the documentation into $(VENV)'
	$(PIP) -e '.[docs]'
	@touch $@

$(VENV)/ready-for-pages: $(VENV)/ready-to-run
	@echo 'Installing the tools that open the pages into $(VENV)'
	$(PIP) -e '.[pages]'
	@touch $@

$(VENV)/ready-to-build: $(VENV)/ready-to-run
	@echo 'Installing the tools of a release into $(VENV)'
	@$(PIP) -e '.[dist]'
	@touch $@

$(VENV)/ready-to-bench: $(VENV)/ready-to-run
	@$(PIP) -e '.[bench,puma]'
	@touch $@

clean:
	rm -rf benchmarks/.envs benchmarks/.problems benchmarks/.short
	rm -rf examples/paper/results/short
	rm -rf $(VENV) $(OLDEST) $(TRIAL) build dist docs/_build docs/api/*.rst docs/auto_examples htmlcov .coverage*
	rm -rf .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
