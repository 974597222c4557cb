# Everything below sets itself up: .venv is made and filled on first use.
PYTHON ?= $(shell for p in python3.12 python3.11 python3; do \
	$$p -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)))' 2>/dev/null && echo $$p && break; done)
BIN := .venv/bin
INSTALLED := .venv/.installed

# Tests start hundreds of processes of this project: none of them is to compile its modules again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test lint format soak bench clean

demo: $(INSTALLED)
	$(BIN)/twincell demo

# Whole prints and what is measured by the clock have the machine to themselves, but for the one job that is done from
# end to end. A print stops, as it must, when a virtual machine's host keeps one of its processors to itself for longer
# than the guard waits: such a test is run once more.
JOB := tests/twincell/test_demo.py
REAL_TIME := tests/robot/live
AGAIN := --reruns 2 --only-rerun "ha[sd] been silent for" --only-rerun "has given no good answer for"

test: $(INSTALLED)
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder --max-worker-restart 0 --ignore=$(JOB) --ignore=$(REAL_TIME)
	@$(BIN)/python -m pytest $(AGAIN) $(JOB) & job=$$!; \
	$(BIN)/python -m pytest $(AGAIN) $(REAL_TIME); passed=$$?; wait $$job && exit $$passed

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy examples
	$(BIN)/lint-imports

format: $(INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

soak: $(INSTALLED)
	$(BIN)/python -m pytest -m soak || { [ $$? -eq 5 ] && echo "there are no soak tests yet"; }

bench: $(INSTALLED)
	@for script in benchmarks/*.py; do echo "== $$script"; $(BIN)/python $$script || exit 1; done

$(INSTALLED): pyproject.toml
	@test -n "$(PYTHON)" || { echo "twincell needs Python 3.11 or 3.12 on the PATH, or named by PYTHON=" >&2; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet -e '.[dev]'
	touch $@

clean:
	rm -rf .venv out build dist
