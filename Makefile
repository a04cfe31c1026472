# `make evaluate` and `make test` are all that a newcomer needs: each makes .venv/ by itself.
# Needed beforehand: CPython >= 3.11, pip, gcc and make.
#
#   make evaluate ARGS="--suite gyres --episodes 200"
#   make test ARGS="-k vortex"
#   make PYTHON=python3.12 test              another interpreter
#   make PIP_ARGS="--extra-index-url URL"    another source of wheels (a CPU-only PyTorch, say)

PYTHON ?= python3
ARGS ?=
PIP_ARGS ?=

VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
# Present while packages are being installed: an environment that still has it was interrupted.
BUSY := $(VENV)/.installing

.DEFAULT_GOAL := help
.PHONY: help install evaluate published train test lint format wheel-check benchmark ci clean distclean

help:  ## this list
	@sed -nE 's/^([a-z-]+):.*## (.*)/  make \1|\2/p' Makefile | awk -F'|' '{ printf "%-20s %s\n", $$1, $$2 }'

install: $(READY)  ## .venv/ with the pinned packages and this checkout (the other targets do it too)

evaluate: $(READY)  ## the benchmark at its quick size; report in runs/evaluation/index.html
	$(BIN)/python evaluate.py $(ARGS)

published: $(READY)  ## the published tables beside ours
	$(BIN)/python evaluate.py published $(ARGS)

train: $(READY)  ## train a policy; options in ARGS, `make train ARGS=--help` lists them
	$(BIN)/python train.py $(ARGS)

test: $(READY)  ## the tests
	$(BIN)/python -m pytest -n logical --maxprocesses 4 --dist loadfile $(ARGS)

lint: $(READY)  ## style, formatting and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(READY)  ## rewrite the sources in the project's format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

wheel-check: $(READY)  ## build the wheel; run it alone in empty environments, lowest and pinned versions
	$(BIN)/python tools/check_wheel.py $(ARGS)

benchmark: $(READY)  ## speed on this machine (benchmarks/)
	@set -e; for script in benchmarks/[a-z]*.py; do echo "== $$script"; $(BIN)/python $$script $(ARGS); done

ci:  ## everything that a change must pass
	bash .ci/run

clean:  ## remove build products and caches
	rm -rf build dist *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis
	find . -path ./$(VENV) -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean  ## also remove .venv/
	rm -rf $(VENV)

# A virtual environment whose interpreter is gone (an upgrade, a moved checkout) is made anew.
ifneq ($(shell $(BIN)/python -c 'print("runs")' 2>/dev/null),runs)
.PHONY: $(READY)
endif

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "Python >= 3.11 is needed, '$(PYTHON)' is not that; try 'make PYTHON=python3.12 $(MAKECMDGOALS)'." >&2; exit 1; }
	@if [ -e $(BUSY) ] || ! $(BIN)/python -m pip --version >/dev/null 2>&1; then \
		echo "Making $(VENV)/ with $$($(PYTHON) --version)"; \
		rm -rf $(VENV) && $(PYTHON) -m venv $(VENV); fi
	@rm -f $@ && touch $(BUSY)
	@echo "Installing the pinned packages: minutes the first time."
	$(BIN)/python -m pip install --quiet --disable-pip-version-check $(PIP_ARGS) -c constraints.txt pip setuptools
	PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --disable-pip-version-check $(PIP_ARGS) \
		-c constraints.txt --no-build-isolation --editable '.[all,dev]'
	@rm -f $(BUSY) && touch $@
