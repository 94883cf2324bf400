# Each target installs what it needs, ROS 2 included, into .venv.
VENV := .venv
BIN := $(VENV)/bin
RUN := runs/demo_$(shell date +%Y%m%d_%H%M%S)
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
PYTHON ?= python3
# Stay on this machine, so that demos on one network do not meet.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
# Some containers set this: every process, and the tests start hundreds, would compile all modules anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test check-long reproduce lint types docs coverage dist bench clean

# The same doorway twice: by the paper's learner, and by ours.
demo: $(VENV)/runs
	@$(BIN)/python -m tools.demo $(RUN)

# Three processes on two cores: tests of nodes wait for one another.
test: $(VENV)/tests
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder

# Slow checks: every command of the documentation, long runs, fuzzing.
check-long: $(VENV)/tests
	$(BIN)/python -m pytest -m long -n 3 --dist loadfile --timeout 1800

# Every experiment: tables and figures of docs/paper.md, into results/.
reproduce: $(VENV)/runs
	$(BIN)/sparse_coord reproduce --out results

lint: $(VENV)/tests
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache

types: $(VENV)/tests
	$(BIN)/mypy

# The documentation with the reference of the Python API, as pages in docs/_build/html.
docs: $(VENV)/tests
	$(PIP) -e '.[docs]'
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html
	@echo docs/_build/html/index.html

# Which lines the tests run. A test that is interrupted may leave coverage's own lock held.
coverage: $(VENV)/tests
	$(PIP) -e '.[coverage]'
	$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --cov=sparse_coord_ros --cov-report=term:skip-covered -k "not interrupt and not closed_batch"

# Packages to publish: source distribution and wheel, in dist.
dist: $(VENV)/runs
	$(PIP) -e '.[dist]'
	rm -rf dist
	$(BIN)/python -m build
	$(BIN)/python -m twine check --strict dist/*

# Seconds of compiling, and speed: compiled, beside plain C, in plain Python, and live.
bench: $(VENV)/runs
	$(BIN)/python -m tools.bench

clean:
	rm -rf $(VENV) docs/_build docs/generated dist .coverage .mypy_cache build install log .pytest_cache .ruff_cache *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Where ROS 2 is there already (rclpy imports), the environment uses it, and its NumPy: pip keeps these.
# Elsewhere ROS 2 comes from PyPI, installed by uv, which takes seconds; by pip where uv fails.
# Python compiles each module when it is imported first: pip would compile all of them.
define install
	@command -v $(PYTHON) >/dev/null || \
	  { echo "$(PYTHON) is missing. Install it: sudo apt install python3 python3-venv"; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed; '$(PYTHON)' is older. Try: make PYTHON=python3.12 ..."; exit 2; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
	  { echo "python3-venv is missing. Install it: sudo apt install python3-venv"; exit 2; }
	@echo "installing into $(VENV) ..."
	@[ -x $(BIN)/pip ] || if $(PYTHON) -c 'import rclpy' 2>/dev/null; then \
	  $(PYTHON) -m venv --clear --system-site-packages $(VENV); \
	else \
	  $(PYTHON) -m venv --clear $(VENV); \
	fi
	@if grep -q 'system-site-packages = true' $(VENV)/pyvenv.cfg; then \
	  $(PIP) -e '.[$(EXTRAS)]'; \
	else \
	  { $(PIP) uv && $(BIN)/uv pip install --quiet --python $(BIN)/python -e '.[ros,$(EXTRAS)]'; } || \
	  $(PIP) -e '.[ros,$(EXTRAS)]'; \
	fi
	@touch $@
endef

$(VENV)/runs: EXTRAS := fast,plots,page,maps
$(VENV)/tests: EXTRAS := fast,test,lint

$(VENV)/runs $(VENV)/tests: setup.py pyproject.toml Makefile
	$(install)
