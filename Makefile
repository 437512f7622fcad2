# Every command sets up .venv on its first use. `make help` lists the targets.
.DEFAULT_GOAL := help
PYTHON ?= python3
SCENARIO ?= thruster_gain
VEHICLE ?= paper
LOG ?= examples/flight.csv
SENSORS ?= null
STRANGERS ?= null
JOBS ?= 2
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
export MPLBACKEND := Agg
# Where it is set, each process would compile the libraries anew, for 8 s.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help env train diagnose sweep test test-all test-fast check format bench blind real fuzz clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-10s %s\n", $$1, $$2}'

env: $(READY) ## set up .venv with the locked versions

# Modules are compiled when they are first imported: pip would compile all there are, for as long as it installs.
$(READY): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; assert (3, 11) <= sys.version_info[:2] <= (3, 12), f"Python 3.11 or 3.12 is needed, this is {sys.version.split()[0]}: make PYTHON=python3.12 env"'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt --editable '.[dev,logs]'
	touch $@

train: $(READY) ## train, break and adapt: SCENARIO=thruster_gain
	$(BIN)/python train.py +scenario=$(SCENARIO)

diagnose: $(READY) ## say what is wrong with the vehicle of a log: LOG=flight.csv VEHICLE=paper
	$(BIN)/python diagnose.py log=$(LOG) vehicle=$(VEHICLE)

sweep: $(READY) ## all scenarios x seeds on the local cores, one table and one picture
	$(BIN)/python train.py -m +experiment=sweep

test: check $(READY) ## lint, types and tests: JOBS=2
	$(BIN)/python -m pytest -m "not thorough" --numprocesses $(JOBS) --dist loadfile --no-loadscope-reorder

test-all: check $(READY) ## the same with the thorough tests, some minutes more
	$(BIN)/python -m pytest --numprocesses $(JOBS) --dist loadfile --no-loadscope-reorder

test-fast: $(READY) ## the tests that take seconds
	$(BIN)/python -m pytest -m "not slow and not thorough"

check: $(READY) ## lint and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/basedpyright

format: $(READY) ## format the code
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(READY) ## measure the figures of docs/benchmarks.md
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[bench]'
	$(BIN)/python -m benchmarks.control

blind: $(READY) ## sealed benchmark of the diagnosis: CASES=430 SENSORS=stock STRANGERS=2
	$(BIN)/python -m benchmarks.blind $(if $(CASES),cases=$(CASES)) sensors=$(SENSORS) strangers=$(STRANGERS)

real: $(READY) ## logs of real vehicles and firmware that are at hand: AUV_TORCHRL_DATA=FOLDER JOBS=2, writes docs/real.md
	$(BIN)/python -m benchmarks.real --publish --jobs $(JOBS)

fuzz: $(READY) ## read logs of all formats that are altered at random: DRAWS=5000
	$(BIN)/python -m tests.flightlog.fuzz --draws $(or $(DRAWS),5000)

clean: ## remove the environment and caches, keep outputs
	rm -rf $(VENV) .pytest_cache .ruff_cache .hypothesis *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
