# Needs only make and Python 3.11 or newer; everything else is installed into .venv, in the versions of constraints.txt.

PYTHON ?= python3
ENV ?= cartpole
ARGS ?=

VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help run test test-all docs chromium test-processors lint format settings bench clean

help: ## List the targets (this text)
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-15s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

run: $(VENV)/.installed ## Evolve a controller; choose with ENV=mountaincar and ARGS="seed=3 ge.generations=50"
	@$(BIN)/python -m ge_torchrl env=$(ENV) $(ARGS)

# Each worker begins with a half of its own, so that few kernels are compiled by both.
test: lint chromium ## Check style, types, imports and behaviour: all that CI checks
	@$(BIN)/pytest -n auto --dist worksteal

test-all: lint chromium ## The same with the slow tests, and five times as many generated examples
	@$(PIP) install -c constraints.txt -e ".[ray]"
	@$(BIN)/pytest -n auto --dist worksteal -m "slow or not slow" --hypothesis-profile=thorough

# Tests open pages in a real browser, and skip that where there is none. Only root of a Debian can be given one by itself.
chromium:
	@if ! command -v chromedriver > /dev/null && [ "$$(id -u)" = 0 ] && command -v apt-get > /dev/null; then \
		echo "Installing chromium for the tests of pages (once) ..."; \
		{ apt-get -qq update && DEBIAN_FRONTEND=noninteractive \
			apt-get -qq install -y --no-install-recommends chromium chromium-driver fonts-dejavu-core; \
		} > /dev/null 2>&1 || echo "... it cannot be installed here: these tests are skipped"; fi

# Each stands in for an older processor, or for one with fewer cores; the last is all the slow ones together.
test-processors: $(VENV)/.installed-dev ## Run the tests as on other processors: PyTorch, numba and NumPy with fewer instructions
	@failed=""; for setting in \
		"ATEN_CPU_CAPABILITY=default" \
		"ATEN_CPU_CAPABILITY=avx2" \
		"NUMBA_CPU_NAME=generic" \
		"NPY_DISABLE_CPU_FEATURES=X86_V3,X86_V4,AVX512_ICL" \
		"OMP_NUM_THREADS=1 MKL_NUM_THREADS=1" \
		"OMP_NUM_THREADS=2 MKL_NUM_THREADS=2" \
		"ATEN_CPU_CAPABILITY=default NUMBA_CPU_NAME=generic OMP_NUM_THREADS=1"; \
	do echo "$$setting"; env $$setting $(BIN)/pytest -n auto --dist worksteal || failed="$$failed  $$setting\n"; done; \
	if [ -n "$$failed" ]; then printf "Tests failed with\n$$failed" >&2; exit 1; fi

lint: $(VENV)/.installed-dev ## Check style, types and the direction of imports
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check
	@$(BIN)/lint-imports
	@$(BIN)/mypy

format: $(VENV)/.installed-dev ## Format the code and mend what ruff can mend
	@$(BIN)/ruff check --fix
	@$(BIN)/ruff format

docs: $(VENV)/.installed-docs ## Make a site of docs/: site/index.html; a warning is an error
	@$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet --doctree-dir build/doctrees docs site
	@echo "open site/index.html"

settings: $(VENV)/.installed ## Write docs/settings.md from what the settings declare
	@$(BIN)/python -m ge_torchrl.config.document > docs/settings.md

bench: $(VENV)/.installed-dev ## Measure the speed of rollouts, evolution and refinement, each beside its rival
	@$(BIN)/python tests/benchmarks/bench.py
	@$(BIN)/python tests/benchmarks/bench_ppo.py

clean: ## Remove .venv, caches and build products; the results of runs stay
	rm -rf $(VENV) build dist site .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# A stamp is younger than what it was made from, so nothing is installed twice; a run needs fewer packages than the tests.
$(VENV)/.installed: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing ge_torchrl into $(VENV) (once; minutes) ..."
	@$(PIP) install -c constraints.txt -e .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing ge_torchrl and its development tools into $(VENV) (once; minutes) ..."
	@$(PIP) install -c constraints.txt -e ".[dev]"
	@touch $(VENV)/.installed $(VENV)/.installed-docs $@

$(VENV)/.installed-docs: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing ge_torchrl and what makes its site into $(VENV) (once; minutes) ..."
	@$(PIP) install -c constraints.txt -e ".[docs]"
	@touch $(VENV)/.installed $@

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
		echo "ge_torchrl needs Python 3.11 or newer; $(PYTHON) is $$($(PYTHON) --version 2>&1)." \
		"Name another one, such as: make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV)
