# lmctl: `make demo` and `make test` need nothing but make and Python >= 3.11.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_CONSTRAINT=constraints.txt $(BIN)/python -m pip install --quiet

.PHONY: demo test check bench faults kills soak clean

## the main job: a scanned gear to a printed job log, on the simulated machine
demo: $(VENV)/.installed
	$(BIN)/lmctl demo

## every test, in a fresh or existing .venv
test: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n 2 --dist worksteal -p tests.house.message_log

## style, types, import contracts, tests
check: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest -n 2 --dist worksteal -p tests.house.message_log

## the benchmarks, each one JSON object; with the peers they measure against, and over an hour long
bench: $(VENV)/.installed-bench
	@for script in tests/benchmarks/*.py; do echo "== $$script"; $(BIN)/python $$script || exit 1; done

## every fault in every state of a run, judged by the simulators' record; the table stays in the tree
faults: $(VENV)/.installed-test
	$(BIN)/python -m tests.faults.matrix > tests/faults/MATRIX.md.new; wrong=$$?; \
	  mv tests/faults/MATRIX.md.new tests/faults/MATRIX.md; tail -n 1 tests/faults/MATRIX.md; exit $$wrong

## a hundred hosts killed at random moments, and what recovery makes of it
kills: $(VENV)/.installed-test
	$(BIN)/python -m tests.faults.kills 100

## random parts down the whole road, and random faults in random cells
soak: $(VENV)/.installed-test
	@for what in solids meshes clouds; do $(BIN)/python -m tests.soak $$what 0 40 || exit 1; done
	@$(BIN)/python -m tests.soak cells 0 400

clean:
	rm -rf $(VENV) lmctl-demo build dist

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "error: lmctl needs Python 3.11 or newer; $(PYTHON) is older"; \
	    echo "hint: make PYTHON=/path/to/python3.11"; exit 3; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml constraints.txt | $(VENV)/bin/python
	@echo "installing lmctl into $(VENV) ..."
	@$(PIP) --editable .
	@touch $@

$(VENV)/.installed-test: pyproject.toml constraints.txt | $(VENV)/bin/python
	@echo "installing lmctl and its test tools into $(VENV) ..."
	@$(PIP) --editable '.[test]'
	@touch $@ $(VENV)/.installed

# Printrun's own dependencies are a graphical user interface, which printcore does not use.
$(VENV)/.installed-bench: $(VENV)/.installed-test
	@echo "installing what the benchmarks compare with into $(VENV) ..."
	@$(PIP) --editable '.[test,bench]'
	@$(PIP) --no-deps printrun
	@touch $@
