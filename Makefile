# Every verb works as the first command on a machine with make, Python >= 3.11 and a package index:
# what else it needs of the system is installed where that is ours to change (dev/system.sh).
# `make PYTHON=python3.12 test` chooses the interpreter. Verbs for releases are in dev/Makefile.

ifndef PYTHON
PYTHON := $(shell for python in python3 python3.13 python3.12 python3.11; do \
	$$python -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && break; \
	done; echo $$python)
endif
VENV := .venv
BIN := $(VENV)/bin
LEROBOT_PYTHON ?= python3.12
LEROBOT_VENV := .venv-lerobot
HARDWARE_PYTHON ?= python3.12
HARDWARE_VENV := .venv-hardware
FRANKA_SIM_VENV := .venv-franka-sim
OPENPI_VENV := .venv-openpi
VLA_EVAL_VENV := .venv-vla-eval
VLAGENTS_VENV := .venv-vlagents
RAY_VENV := .venv-ray
SITE_VENV := .venv-site
ECOSYSTEM_PYTHON ?= python3.12
ECOSYSTEM_VENV := .venv-ecosystem
AXE := .axe/node_modules/axe-core/axe.min.js
IWER := .iwer/node_modules/iwer/build/iwer.min.js
STUBS := typings/mujoco/__init__.pyi
DEMO_RUN := demo-run
# A third of a worker's time is waiting for other processes: three keep two cores busy.
TEST_WORKERS ?= 3
TESTS ?= not slow and not long
# Hundreds of processes of the tests import the same modules: they are compiled once.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help system system-test system-browser system-hardware setup setup-test demo test test-all test-lerobot test-hardware test-interop test-ray test-ecosystem test-printing test-pages check format bench docs site golden FORCE

help:  ## Say what each verb does.
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 22

setup: $(VENV)/.installed  ## Make the virtual environment and install the package.

# Where nothing renders, there is no video, and the report shows the episodes in 3D.
demo: setup  ## Evaluate the scripted experts, three episodes a task; leaves demo-run/ with a report.
	rm -rf $(DEMO_RUN)
	@videos=1; $(BIN)/python -m dev.tools.renders || videos=0; \
	$(BIN)/duobench eval --policy expert --episodes 3 --workers 2 --videos $$videos --out $(DEMO_RUN) && \
	{ [ $$videos = 1 ] || $(BIN)/duobench report $(DEMO_RUN) --replays all; }

test: check  ## Check format, lint and types, then run the tests; six minutes on two cores.
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n $(TEST_WORKERS) --dist loadscope -m "$(TESTS)"

test-all: setup-test  ## Run what `make test` leaves out: slow tests, the fuzzer, the site, the distributions.
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n $(TEST_WORKERS) --dist loadscope -m "slow or long"
	$(MAKE) -f dev/Makefile fuzz site dist

# An environment of its own, of several gigabytes, with the versions that LeRobot asks for.
test-lerobot: $(LEROBOT_VENV)/.installed  ## Test with LeRobot: exports, policies, its programs.
	HF_HUB_OFFLINE=1 OMP_NUM_THREADS=1 $(LEROBOT_VENV)/bin/python -m pytest -W default tests/lerobot tests/examples

# Libraries of arms, grippers and cameras, and simulators of their interfaces. A simulator that
# enforces an arm's limits asks for an older NumPy, and has an environment of its own.
test-hardware: system-hardware $(HARDWARE_VENV)/.installed $(FRANKA_SIM_VENV)/.installed  ## Test drivers against simulators of the hardware.
	DUOBENCH_FRANKA_SIM_PYTHON=$(FRANKA_SIM_VENV)/bin/python \
		$(HARDWARE_VENV)/bin/python -m pytest -p no:cacheprovider tests/real/with_libraries

# openpi-client asks for an older NumPy than DuoBench does.
test-interop: setup-test $(OPENPI_VENV)/.installed $(VLA_EVAL_VENV)/.installed $(VLAGENTS_VENV)/.installed  ## Test with openpi, vla-eval and VLAgents.
	DUOBENCH_OPENPI_PYTHON=$(OPENPI_VENV)/bin/python \
	DUOBENCH_VLA_EVAL_PYTHON=$(VLA_EVAL_VENV)/bin/python \
	DUOBENCH_VLAGENTS_PYTHON=$(VLAGENTS_VENV)/bin/python \
		$(BIN)/python -m pytest tests/evaluation/interop

# A cluster of several processes on this machine; Ray is large, and not in the usual environment.
test-ray: $(RAY_VENV)/.installed  ## Test evaluations on a Ray cluster.
	$(RAY_VENV)/bin/python -m pytest -W default tests/ray

# Of several gigabytes: PyTorch is the default wheel, which brings Triton and CUDA.
test-ecosystem: $(ECOSYSTEM_VENV)/.installed  ## Test with Gymnasium, Stable-Baselines3, TorchRL, MuJoCo's programs.
	OMP_NUM_THREADS=1 $(ECOSYSTEM_VENV)/bin/python -m pytest -W default tests/ecosystem

# PrusaSlicer is of the system: installed where the machine is ours to change (root, apt).
test-printing: setup-test  ## Test the files to print with a slicer, PrusaSlicer.
	@command -v prusa-slicer >/dev/null || [ "$$(id -u)" != 0 ] || ! command -v apt-get >/dev/null || { \
		apt-get update; apt-get install --yes --no-install-recommends prusa-slicer; } || true
	@if command -v prusa-slicer >/dev/null; then \
		OMP_NUM_THREADS=1 DUOBENCH_SLICER=prusa-slicer \
			$(BIN)/python -m pytest -n $(TEST_WORKERS) tests/printing/with_slicer; \
	else \
		echo "Skipped: there is no prusa-slicer here. On Debian: apt-get install prusa-slicer"; \
	fi

# Needs npm.
test-pages: system-browser $(VENV)/.installed-browser $(STUBS) $(AXE) $(IWER) site  ## Test pages in a browser: accessibility, phone, paper, driving.
	DUOBENCH_AXE=$(AXE) DUOBENCH_IWER=$(IWER) DUOBENCH_SITE=site/html $(BIN)/python -m pytest tests/pages

check: setup-test  ## Check format, lint and types.
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/basedpyright --pythonpath $(BIN)/python

format: setup-test  ## Format the code and fix what the linter can fix.
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: setup-test  ## Measure speed, as ratios and against the bars.
	$(BIN)/python -m dev.benchmarks

docs: setup-test  ## Draw the gallery, replays, looks and printed parts; write tables and outputs of pages.
	$(BIN)/python docs/gallery.py
	$(BIN)/python docs/replays.py
	$(BIN)/python docs/looks.py
	$(BIN)/python docs/prints.py
	$(BIN)/python docs/tables.py
	DUOBENCH_WRITE_PAGES=1 $(BIN)/python -m pytest -q tests/test_readme.py


# An environment of its own: Sphinx and its theme ask for versions that nothing else here wants.
site: $(SITE_VENV)/.installed  ## Build the site in site/html, warnings are errors, and test it: links, search, size.
	OMP_NUM_THREADS=1 $(SITE_VENV)/bin/python docs/site_build.py
	DUOBENCH_SITE=site/html $(SITE_VENV)/bin/python -m pytest -q -p no:cacheprovider tests/site

golden: setup-test  ## Renew the golden episodes; allowed only with a new suite version.
	$(BIN)/python -m tests.golden.episodes

setup-test: system-test $(VENV)/.installed-test $(STUBS)

system:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "DuoBench needs Python 3.11 or newer, but $(PYTHON) is not; try: make PYTHON=python3.12" >&2; \
		exit 1; }
	@sh dev/system.sh $(PYTHON) setup

# One after the other: two cannot install at the same time.
system-test: system
	@sh dev/system.sh $(PYTHON) test

system-browser: system-test
	@sh dev/system.sh $(PYTHON) browser

system-hardware: system
	@sh dev/system.sh $(PYTHON) hardware

# The environment belongs to one interpreter and one folder: scripts in it name both. The file
# is rewritten only when either changes, and everything else follows from it.
define IDENTITY
import sys; print(sys.version, sys.base_prefix, "$(CURDIR)", sep="\n")
endef

$(VENV)/.identity: FORCE | system
	@identity="$$($(PYTHON) -c '$(IDENTITY)')"; \
	if [ "$$identity" != "$$(cat $@ 2>/dev/null)" ]; then \
		$(PYTHON) -m venv --clear $(VENV) || exit 1; \
		echo "$$identity" > $@; \
	fi

$(VENV)/.installed: $(VENV)/.identity pyproject.toml constraints.txt
	$(BIN)/python -m pip install --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/.installed-test: $(VENV)/.installed
	$(BIN)/python -m pip install --disable-pip-version-check -c constraints.txt -e '.[test]'
	@touch $@

$(VENV)/.installed-browser: $(VENV)/.installed-test
	$(BIN)/python -m pip install --disable-pip-version-check -c constraints.txt -e '.[browser]'
	@touch $@

$(LEROBOT_VENV)/.installed: pyproject.toml plugins/lerobot/pyproject.toml
	$(LEROBOT_PYTHON) -m venv $(LEROBOT_VENV)
	$(LEROBOT_VENV)/bin/python -m pip install --disable-pip-version-check -e '.[lerobot]' \
		-e ./plugins/lerobot 'lerobot[diffusion,smolvla,xvla]' 'dm-tree>=0.1.8,<1' \
		'duckdb>=1' 'polars>=1' 'pytest>=9'
	@touch $@

$(HARDWARE_VENV)/.installed: pyproject.toml
	$(HARDWARE_PYTHON) -m venv $(HARDWARE_VENV)
	$(HARDWARE_VENV)/bin/python -m pip install --disable-pip-version-check -e '.[hardware]' \
		'franky-sim==1.0.4' 'pytest>=9'
	@touch $@

$(FRANKA_SIM_VENV)/.installed:
	$(HARDWARE_PYTHON) -m venv $(FRANKA_SIM_VENV)
	$(FRANKA_SIM_VENV)/bin/python -m pip install --disable-pip-version-check \
		'franka-sim==1.1.7' 'numpy==1.26.4' 'mujoco<3.3'
	@touch $@

$(OPENPI_VENV)/.installed: | system
	$(PYTHON) -m venv $(OPENPI_VENV)
	$(OPENPI_VENV)/bin/python -m pip install --disable-pip-version-check \
		openpi-client==0.1.2 typing_extensions
	@touch $@

$(VLA_EVAL_VENV)/.installed: pyproject.toml | system
	$(PYTHON) -m venv $(VLA_EVAL_VENV)
	$(VLA_EVAL_VENV)/bin/python -m pip install --disable-pip-version-check -e . vla-eval==0.8.0
	@touch $@

$(VLAGENTS_VENV)/.installed: pyproject.toml | system
	$(PYTHON) -m venv $(VLAGENTS_VENV)
	$(VLAGENTS_VENV)/bin/python -m pip install --disable-pip-version-check -e . \
		vlagents==0.3.0 'rpyc>=6,<7'
	@touch $@

$(SITE_VENV)/.installed: pyproject.toml docs/site_requirements.txt | system
	$(PYTHON) -m venv $(SITE_VENV)
	$(SITE_VENV)/bin/python -m pip install --disable-pip-version-check -c constraints.txt \
		-r docs/site_requirements.txt -e .
	@touch $@

$(RAY_VENV)/.installed: pyproject.toml | system
	$(PYTHON) -m venv $(RAY_VENV)
	$(RAY_VENV)/bin/python -m pip install --disable-pip-version-check -e '.[test,ray]'
	@touch $@

$(ECOSYSTEM_VENV)/.installed: pyproject.toml
	$(ECOSYSTEM_PYTHON) -m venv $(ECOSYSTEM_VENV)
	$(ECOSYSTEM_VENV)/bin/python -m pip install --disable-pip-version-check -e . 'pytest>=9' \
		array-api-compat moviepy 'mujoco-warp>=4.0,<4.1' 'stable-baselines3>=2.7' 'torchrl>=0.10'
	@touch $@

# Pinned, so that the same page breaks the same rules.
$(AXE):
	npm install --no-save --no-audit --no-fund --prefix .axe axe-core@4.14.1

# An imitated headset, for tests alone.
$(IWER):
	npm install --no-save --no-audit --no-fund --prefix .iwer iwer@2.5.0

# Their types are those of the installed version, which only the two files above can change.
$(STUBS): $(VENV)/.installed-test dev/tools/mujoco_stubs.py
	$(BIN)/python -m dev.tools.mujoco_stubs
