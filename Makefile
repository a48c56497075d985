# Two commands do it all: `make demo` runs the main job, `make test` passes the tests.
# Each makes .venv and installs from locked files, by their hashes (requirements.lock); no root, no GPU.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check install --quiet --no-deps
# the lock up to a section, by hashes: a file that is another than the locked one is refused. The project
# itself is built by the setuptools that is locked, with nothing from outside
LOCKED = sed '/^\# $(1):/,$$d' requirements.lock > $(VENV)/locked.txt && \
    $(PIP) --require-hashes --requirement $(VENV)/locked.txt && $(PIP) --no-build-isolation $(EDITABLE) .
# a plain path in place of an import hook, which type checkers of a user's scripts cannot follow
EDITABLE := --config-settings editable_mode=compat --editable
# one more than the cores: some tests wait for ports, processes and the disk
WORKERS := $(shell $(PYTHON) -c "import os; print(min((os.cpu_count() or 1) + 1, 4))")
# the workers and the hundreds of processes that tests start load compiled modules, whatever is set here
PYTEST := OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest --numprocesses $(WORKERS) --dist loadfile --no-loadscope-reorder
QUICK := $(addprefix tests/,cli/commands/test_devices.py cli/commands/test_run.py::test_events_then_the_summary \
    cli/commands/test_run.py::test_replay_finds_the_same_events engines/programs/test_machine.py \
    engines/devices/test_threads.py engines/devices/test_working_devices.py tactile/test_contact.py test_plan.py \
    scenes/test_scene.py)
SITUATION := sh -c '$(BIN)/cnnum devices --no-measure && $(BIN)/cnnum demo --out cnnum-demo.html --force && $(PYTEST) $(QUICK)'

.PHONY: demo test test-full situations faults arrays embedded costs gpu portability fuzz mutate platforms docs lint style mypy pyright bench lock audit clean

demo: $(VENV)/run.stamp
	$(BIN)/cnnum demo --out cnnum-demo.html --force

# the workers fill the cores: threads of OpenBLAS on top wait for each other, in SciPy's `expm` of
# small matrices hundreds of times as long as they work
test: $(VENV)/dev.stamp
	$(PYTEST) --durations 20

# the same with every case of the tests that it thins, which takes minutes more
test-full: $(VENV)/dev.stamp
	CNNUM_TESTS=full $(PYTEST) --durations 20

# the demo and a quick part of the suite as on two other machines: one whose processor is newer than
# the compiler of PoCL's wheel, and one without OpenCL (its loader is sent to a folder that is not there)
situations: $(VENV)/dev.stamp
	PYTHONPATH="$(CURDIR)/tests/situations/generic_cpu" $(SITUATION)
	OCL_ICD_VENDORS="$(CURDIR)/tests/situations/no_opencl" $(SITUATION)

# recordings, frames, caches, files and processes under faults on purpose; a short version is in `test`
faults: $(VENV)/dev.stamp
	CNNUM_FAULTS=full $(PYTEST) tests/faults tests/drivers/test_serial_gaps.py tests/scenes/test_long_runs.py \
	    tests/cli/arrays/test_outside_drivers.py tests/cli/test_streams.py tests/live/test_server.py \
	    tests/drivers/test_virtual_array.py tests/drivers/test_neighbours.py tests/house/test_one_writer.py \
	    tests/house/test_packaging.py tests/engines/test_hostile_names.py

# arrays for long: a million damaged packets a protocol, 200 kills of a recorder, 20 unplugs, and five
# minutes of a line at 1 kHz, which needs a core of its own; a short version is in `test`
arrays: $(VENV)/dev.stamp
	CNNUM_FAULTS=full CNNUM_CODEC_INPUTS=1000000 $(PYTEST) --dist load tests/faults/test_codecs.py \
	    tests/faults/test_recordings.py::test_kill
	CNNUM_FAULTS=full CNNUM_LINE_SECONDS=300 $(BIN)/python -m pytest tests/drivers/test_virtual_array.py

# ten minutes of random input for all parsers and public functions; a short version is in `test`.
# Two of them are Atheris', which looks where damage to a file leads (Linux on x86-64 alone)
fuzz: $(VENV)/dev.stamp
	CNNUM_FUZZ=480 $(BIN)/python -m pytest tests/fuzz
	$(BIN)/python tests/fuzz/guided.py 120

# programs as C99: 10,000 random frames of each against the emulator under sanitizers, then what slip
# and twist cost on Cortex-M; compiler and emulated cores of that come with pip, and need no root. With
# GCC for Arm and QEMU, which are optional, a second count stands next to the first. Half an hour on
# two cores, of which the benchmark takes some minutes
embedded: $(VENV)/dev.stamp
	command -v cc >/dev/null || { [ "$$(id -u)" = 0 ] && apt-get install --yes gcc libc6-dev; } || \
	    { echo "Install a C compiler that is called by 'cc', such as GCC with its sanitizers." >&2; exit 1; }
	{ command -v arm-none-eabi-gcc && command -v qemu-system-arm; } >/dev/null || \
	    { [ "$$(id -u)" = 0 ] && apt-get install --yes gcc-arm-none-eabi qemu-system-arm; } || \
	    echo "Install gcc-arm-none-eabi and qemu-system-arm for their counts, too." >&2
	CNNUM_FRAMES=10000 $(PYTEST) tests/embedded tests/fuzz/test_programs.py \
	    tests/cli/commands/test_bench_embedded.py
	$(BIN)/cnnum bench embedded --quick --shape 4x4x3 --shape 8x8x3 --method auto --method euler \
	    --force --out bench-results

# the table of costs in docs/microcontrollers.md: the row of each program takes one or two minutes
COUNTED = active_contour contact edges grasp_code halfspace_equilibrium halfspace_layers \
    halfspace_strain halfspace_stress localize mindlin_slip motion_direction on_off slip \
    surface_load tactile tactile_flow texture twist slip,twist slip,twist,contact
costs: $(VENV)/dev.stamp
	$(BIN)/cnnum bench embedded --costs $(COUNTED:%=--program %)
	$(BIN)/cnnum bench embedded --costs --program receptors --needs "sa2_x,sa2_y,stretch_x,stretch_y$(foreach \
	    f,sa1 ra1 pc sa2,,$(f),$(f)_active,$(f)_strength,$(f)_row,$(f)_column)"

# the engine on a graphics processor, in at most five minutes: `make gpu`, or `make gpu GPU=NAME`
gpu: $(VENV)/dev.stamp
	$(BIN)/python tests/situations/other_opencl.py gpu $(GPU)

# the engine's tests on Oclgrind, on Mesa's rusticl and on Intel's runtime, where they are installed
portability: $(VENV)/dev.stamp
	$(BIN)/python tests/situations/other_opencl.py portability

# a data set as LeRobot itself reads it, in an environment of its own: some gigabytes
lerobot: $(VENV)/dev.stamp
	test -x $(VENV)/lerobot/bin/python || python3.12 -m venv $(VENV)/lerobot
	$(VENV)/lerobot/bin/pip install --quiet 'lerobot[dataset]>=0.6'
	$(BIN)/python tests/situations/real_lerobot.py --with $(VENV)/lerobot/bin/python

# faults put into a copy of the code, one at a time: the tests must catch each (tests/mutations)
mutate: $(VENV)/dev.stamp
	CNNUM_TESTS=full OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/mutations/run.py

# whether the dependencies resolve on Linux, macOS and Windows: it asks the package index
platforms: $(VENV)/dev.stamp
	for each in 3.11 3.12 3.13; do $(BIN)/python tests/house/platforms.py $$each || exit 1; done

# the site, from the pages and the docstrings: docs/_build/index.html; a warning is an error
docs: $(VENV)/dev.stamp
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet docs docs/_build

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
	    $(BIN)/cnnum bench $$each --quick --force --out bench-results || exit 1; \
	done

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/run.stamp: pyproject.toml requirements.lock | $(VENV)/bin/python
	$(call LOCKED,to develop and test)
	touch $@

$(VENV)/dev.stamp: pyproject.toml requirements.lock | $(VENV)/bin/python
	$(call LOCKED,of other extras)
	touch $@ $(VENV)/run.stamp

# Resolve anew: everything of the run and dev sets, at the newest versions that fit together, with hashes.
lock:
	rm -rf $(VENV)-lock && $(PYTHON) -m venv $(VENV)-lock
	$(VENV)-lock/bin/python -m pip install --quiet uv
	$(VENV)-lock/bin/python tests/house/lock.py
	rm -rf $(VENV)-lock

# known weaknesses of the locked packages, by name and version: it asks a public database, and fails where
# that has nothing on one of them
audit:
	rm -rf $(VENV)-audit && $(PYTHON) -m venv $(VENV)-audit
	$(VENV)-audit/bin/python -m pip install --quiet pip-audit
	$(VENV)-audit/bin/pip-audit --strict --disable-pip --require-hashes --requirement requirements.lock
	rm -rf $(VENV)-audit

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache
