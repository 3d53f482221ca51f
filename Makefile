# kinreach: set-up and the jobs of the project. `make help` lists them.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV ?= .venv
ARGS ?=
# Some tests wait, for a robot's time or a browser: one process more than there are cores.
WORKERS := $(shell cores=$$(nproc 2>/dev/null || getconf _NPROCESSORS_ONLN); echo $$((cores < 8 ? cores + 1 : 8)))
PYTEST_ARGS ?= -n $(WORKERS) --dist worksteal
TORCH ?= cpu

BIN := $(VENV)/bin
PIP_INSTALL := $(BIN)/python -m pip install --disable-pip-version-check --root-user-action=ignore -c constraints.txt
# torch comes before what needs it: PyPI has a GPU build, which brings some 3 GB of libraries. A torch that is there stays.
TORCH_INDEX := https://download.pytorch.org/whl/$(TORCH)
TORCH_VERSION := $(shell grep '^torch==' constraints.txt)
install_torch = $(1)/bin/python -m pip install --disable-pip-version-check --root-user-action=ignore --no-deps \
    --retries 1 --timeout 15 --index-url $(TORCH_INDEX) $(TORCH_VERSION) || \
    echo 'No $(TORCH_VERSION) from $(TORCH_INDEX): pip takes the build that it finds; from PyPI it brings some 3 GB of GPU libraries' >&2
# What was installed without make, as the README does it, is not installed again.
has = test ! -e $@ && $(BIN)/python -c 'from importlib.metadata import version; [version(name) for name in "$(1)".split()]' 2>/dev/null
CORE := $(VENV)/.installed-core
DEV := $(VENV)/.installed-dev
DOCS := $(VENV)/.installed-docs
BENCH := $(VENV)/.installed-bench
VIEW := $(VENV)/.installed-view
CODE_IN_C := hatch_build.py $(wildcard kinreach/kinematics/_core/*.[ch])
NEWEST_VENV ?= build/venv-newest
CLIENTS_VENV ?= build/venv-clients
CLIENTS := $(CLIENTS_VENV)/.installed
UR_CLIENTS_VENV ?= build/venv-ur-clients
UR_CLIENTS := $(UR_CLIENTS_VENV)/.installed

# Some machines ask Python to keep nothing that it compiled. Tests start a hundred interpreters, and each would compile all of kinreach again.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help setup compare view examples test test-all newest lint bench clients ur-clients wheels core-check digest endurance notebooks docs clean

help: ## List the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-10s %s\n", $$1, $$2}'
	@echo '  Options: ARGS="..." for compare, view and bench, PYTEST_ARGS="-n 1" for the tests, PYTHON=python3.12, VENV=DIR'
	@echo '           TORCH=cu130 at the first set-up for that GPU build of torch instead of the CPU build'

setup: $(DEV) ## Make the virtual environment with everything that tests and lint need

compare: $(CORE) ## Put all methods on the same goals, for example ARGS="--task button --goals 50"
	$(BIN)/python -m kinreach.compare $(ARGS)

view: $(VIEW) ## See postures in the browser, and why there are none, for example ARGS="--arm ur10"
	$(BIN)/python -m kinreach.view --open $(ARGS)

examples: $(DEV) ## Run all examples, one after the other; ARGS="examples/13_own_arm.py" for one
	@for script in $(or $(ARGS),$(sort $(wildcard examples/*.py))); do echo "$$script"; $(BIN)/python $$script || exit 1; done

test: $(DEV) ## Run the tests but the slow ones
	$(BIN)/python -m pytest -m "not slow" $(PYTEST_ARGS)

test-all: $(DEV) ## Run all tests
	$(BIN)/python -m pytest $(PYTEST_ARGS)

newest: ## Test kinematics with the newest versions of all packages, without placo, for example PYTHON=python3.13
	$(PYTHON) -m venv --clear $(NEWEST_VENV)
	$(NEWEST_VENV)/bin/pip install --disable-pip-version-check --root-user-action=ignore --quiet -e . hypothesis jsonschema pytest pytest-xdist
	$(NEWEST_VENV)/bin/python -m pytest -m "not slow" -W ignore::DeprecationWarning -W ignore::ResourceWarning -W "ignore:It looks like .register_random." $(PYTEST_ARGS) $(or $(ARGS),tests/kinematics tests/robots)

lint: $(DEV) ## Check style, format and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(BENCH) ## Speed beside other packages, for example ARGS="--suite ik-single --quick"
	$(BIN)/python -m benchmarks.speed $(ARGS)

clients: $(CLIENTS) ## Train with stable-baselines3, rl-zoo3, CleanRL, Tianshou and TorchRL, each a little
	@for script in $(or $(ARGS),$(sort $(wildcard tools/clients/*.py))); do \
	    echo "$$script"; OMP_NUM_THREADS=1 $(CLIENTS_VENV)/bin/python -W ignore $$script || exit 1; done

ur-clients: $(CORE) $(UR_CLIENTS) ## Try ur_rtde and urx on simulate-ur, and write docs/reference/ur_clients.md; ARGS="--check" compares
	$(BIN)/python -m tools.ur_clients --python $(UR_CLIENTS_VENV)/bin/python $(or $(ARGS),--write)

digest: $(CORE) ## Compare fixed results with tools/digest.txt, for example PYTHON=python3.13 VENV=build/venv-3.13
	$(BIN)/python -m tools.digest --check $(ARGS)

endurance: $(DEV) ## What takes too long for the tests: faults, long runs, processes; ARGS="--quick" for some minutes
	$(BIN)/python -m tools.endurance $(ARGS)

wheels: $(DEV) ## Make wheels for Linux and macOS, x86-64 and ARM, on any of them, into dist/
	$(BIN)/python -m tools.wheels $(ARGS)

core-check: $(DEV) ## Run the compiled core's tests under address and undefined-behaviour sanitizers
	$(BIN)/python -m tools.core_check $(ARGS)

notebooks: $(DEV) ## Run all notebooks from top to bottom and keep their outputs
	$(BIN)/python notebooks/execute.py $(ARGS)

docs: $(DOCS) ## Build the documentation into build/docs
	$(BIN)/python -m sphinx --fail-on-warning --quiet -d build/doctrees docs build/docs
	@echo 'build/docs/index.html'

clean: ## Remove the virtual environment and the caches
	rm -rf $(VENV) .pytest_cache .ruff_cache .mypy_cache .hypothesis

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "kinreach needs Python 3.11: no python3 found" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "kinreach needs Python 3.11 or newer, this is %d.%d: make PYTHON=python3.11" % sys.version_info[:2])'
	$(PYTHON) -m venv $(VENV)

$(CORE): pyproject.toml constraints.txt $(CODE_IN_C) | $(BIN)/python
	@$(call has,kinreach placo) || $(PIP_INSTALL) -e '.[placo]'
	@touch $@

$(DEV): pyproject.toml constraints.txt $(CODE_IN_C) | $(BIN)/python
	$(call install_torch,$(VENV))
	$(PIP_INSTALL) -e '.[dev]'
	@touch $(CORE) $(VIEW) $@

$(VIEW): $(CORE)
	@$(call has,kinreach viser) || $(PIP_INSTALL) -e '.[view]'
	@touch $@

$(BENCH): $(CORE)
	$(call install_torch,$(VENV))
	$(PIP_INSTALL) -e '.[bench]'
	@touch $@

$(CLIENTS): pyproject.toml tools/clients/requirements.txt
	$(PYTHON) -m venv $(CLIENTS_VENV)
	$(call install_torch,$(CLIENTS_VENV))
	$(CLIENTS_VENV)/bin/pip install --disable-pip-version-check -r tools/clients/requirements.txt -e .
	$(CLIENTS_VENV)/bin/pip install --disable-pip-version-check --no-deps --ignore-requires-python cleanrl==1.2.0
	@touch $@

$(UR_CLIENTS): tools/ur_clients/requirements.txt
	$(PYTHON) -m venv $(UR_CLIENTS_VENV)
	$(UR_CLIENTS_VENV)/bin/pip install --disable-pip-version-check -r tools/ur_clients/requirements.txt
	@touch $@

$(DOCS): $(CORE)
	$(PIP_INSTALL) -e '.[docs]'
	@touch $@
