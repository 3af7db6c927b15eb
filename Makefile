# `make demo` shows what this is; `make test` checks that it is right.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV   := .venv
PY     := $(VENV)/bin/python
STAMP  := $(VENV)/.stamp
STAMP_TEST := $(VENV)/.stamp_test
STAMP_DOCS := $(VENV)/.stamp_docs

# Libraries are installed without bytecode; the first import is to keep it, others take seconds.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := demo
.PHONY: demo test test-all bench docs beforehand kernels_of_models kernels_of_moves lint clean

demo: $(STAMP)
	$(VENV)/bin/imapper-prob demo -o out/demo --overwrite

test: beforehand
	$(PY) -m pytest -n 2 -m "not slow" --nbmake notebooks tests

test-all: beforehand
	$(PY) -m pytest -n 2 --nbmake notebooks tests

bench: $(STAMP)
	$(PY) -m lab.speed

# The site, offline, in an environment that has Sphinx as well; every warning is an error.
docs: $(STAMP) $(STAMP_DOCS)
	$(PY) -m sphinx -b html -W --keep-going docs out/site

beforehand: $(STAMP_TEST)
	$(MAKE) --no-print-directory --jobs=2 kernels_of_models kernels_of_moves lint

# What several processes of the tests would otherwise each compile. Moves begin with what they have of their own, until the
# other has compiled what both need.
kernels_of_models: $(STAMP_TEST)
	$(PY) -m pytest --quiet tests/models/test_posterior.py tests/models/test_incremental.py

kernels_of_moves: $(STAMP_TEST)
	$(PY) -m pytest --quiet tests/sampling/test_crossover.py \
		tests/sampling/test_reference.py::test_what_was_visited_is_drawn_more_often \
		tests/sampling/test_steps.py tests/sampling/test_alone.py

lint: $(STAMP_TEST)
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/mypy

clean:
	rm -rf out build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +

# A demo needs no extras.
INSTALL = $(PY) -m pip install --quiet --no-compile --constraint constraints.txt

$(STAMP): pyproject.toml constraints.txt
	test -x $(PY) || $(PYTHON) -m venv $(VENV)
	$(INSTALL) --editable .
	touch $@

$(STAMP_TEST): pyproject.toml constraints.txt
	test -x $(PY) || $(PYTHON) -m venv $(VENV)
	$(INSTALL) --editable '.[dev,notebook,cluster]'
	touch $(STAMP) $@

$(STAMP_DOCS): $(STAMP)
	$(INSTALL) --editable '.[docs]'
	touch $@
