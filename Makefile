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
.PHONY: demo test test-all bench docs tests_quick tests_all lint clean

demo: $(STAMP)
	$(VENV)/bin/imapper-prob demo -o out/demo --overwrite

# Checks of the sources run beside the tests.
test: $(STAMP_TEST)
	$(MAKE) --no-print-directory --jobs=2 lint tests_quick

test-all: $(STAMP_TEST)
	$(MAKE) --no-print-directory --jobs=2 lint tests_all

tests_quick: $(STAMP_TEST)
	$(PY) -m pytest -n 2 -m "not slow" --nbmake notebooks tests

tests_all: $(STAMP_TEST)
	$(PY) -m pytest -n 2 --nbmake notebooks tests

bench: $(STAMP)
	$(PY) -m lab.speed

# The site, offline, in an environment that has Sphinx as well; every warning is an error.
docs: $(STAMP) $(STAMP_DOCS)
	$(PY) -m sphinx -b html -W --keep-going docs out/site

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
