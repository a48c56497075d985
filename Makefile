# Two commands do it all: `make demo` runs the main job, `make test` passes the tests.
# Each makes .venv and installs from locked versions (requirements.lock); no root, no GPU.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check install --quiet --constraint requirements.lock
export PIP_CONSTRAINT := requirements.lock

.PHONY: demo test lint style mypy pyright bench lock clean

demo: $(VENV)/run.stamp
	$(BIN)/cnnum demo --out cnnum-demo.html

# the workers fill the cores: threads of OpenBLAS on top wait for each other, in SciPy's `expm` of
# small matrices hundreds of times as long as they work
test: $(VENV)/dev.stamp
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses auto --maxprocesses 4 --dist loadfile --durations 20

# `make --jobs 2 lint` has both type checkers at work at once, of which each takes one core
lint: style mypy pyright

style: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

mypy pyright: $(VENV)/dev.stamp
	$(BIN)/$@

# a quick round of about a minute, with data, picture and page in bench-results/; the others of
# `cnnum bench` (work-precision, scaling, peers) take minutes each
bench: $(VENV)/dev.stamp
	for each in throughput latency compile; do \
	    $(BIN)/cnnum bench $$each --quick --out bench-results || exit 1; \
	done

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/run.stamp: pyproject.toml requirements.lock | $(VENV)/bin/python
	$(PIP) --editable .
	touch $@

$(VENV)/dev.stamp: pyproject.toml requirements.lock | $(VENV)/bin/python
	$(PIP) --editable '.[dev]'
	touch $@ $(VENV)/run.stamp

# Resolve anew: everything of the run and dev sets, at the newest versions that fit together.
lock:
	rm -rf $(VENV)-lock && $(PYTHON) -m venv $(VENV)-lock
	PIP_CONSTRAINT= $(VENV)-lock/bin/python -m pip install --quiet setuptools '.[dev]'
	$(VENV)-lock/bin/python -m pip freeze --all --exclude cnnum --exclude pip > requirements.lock
	rm -rf $(VENV)-lock

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache
