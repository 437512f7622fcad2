# Every command sets up .venv on its first use. `make help` lists the targets.
.DEFAULT_GOAL := help
PYTHON ?= python3
SCENARIO ?= reversed
VEHICLE ?= paper
LOG ?= examples/flight.csv
HEALTHY ?=
PARAMS ?=
SENSORS ?= null
STRANGERS ?= null
JOBS ?= 2
VENV := .venv
BIN := $(VENV)/bin
BASE := $(VENV)/.base
TRAIN := $(VENV)/.train
READY := $(VENV)/.ready
export MPLBACKEND := Agg
# Where it is set, each process would compile the libraries anew, for 8 s.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help env train diagnose sweep test suite test-all test-fast check format bench gpu blind real fuzz docs clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-10s %s\n", $$1, $$2}'

env: $(READY) ## set up .venv with the locked versions

# .venv is made anew where its Python does not run, as after an upgrade of the system, and where PYTHON=... names another.
VERSION := -c 'import sys; print(*sys.version_info[:2], sep=".")'
FOUND := $(if $(wildcard $(BASE)),$(shell $(BIN)/python $(VERSION) 2>/dev/null || echo broken))
GIVEN := $(if $(filter-out file default,$(origin PYTHON)),$(shell $(PYTHON) $(VERSION) 2>/dev/null || echo missing))
STALE := $(if $(FOUND),$(if $(filter-out $(or $(GIVEN),3.11 3.12 3.13 3.14),$(FOUND)),stale))
.PHONY: stale
stale: ;

# What diagnoses comes first, what trains and what develops are added to it. Modules are compiled when they are first
# imported: pip would compile all there are, for as long as it installs.
INSTALL = $(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt --editable
$(BASE): pyproject.toml constraints.txt $(STALE)
	@$(PYTHON) -c pass || { echo "$(PYTHON) does not run: Python 3.11 to 3.14 is needed, make PYTHON=/path/to/python3.12 env" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; (3, 11) <= sys.version_info[:2] <= (3, 14) or sys.exit(f"Python 3.11 to 3.14 is needed, $(PYTHON) is {sys.version.split()[0]}: make PYTHON=python3.12 env")'
	$(PYTHON) -m venv $(if $(STALE),--clear) $(VENV)
	$(INSTALL) '.[fast]'
	touch $@

# dm-control needs labmaze, which has no wheel for later ones.
TRAINS = $(BIN)/python -c 'import sys; sys.version_info[:2] <= (3, 12) or sys.exit(f"Python 3.11 or 3.12 is needed to train and to develop, $(VENV) has {sys.version.split()[0]}: make PYTHON=python3.12 $@")'
$(TRAIN): $(BASE)
	@$(TRAINS)
	$(INSTALL) '.[train]'
	touch $@

$(READY): $(BASE)
	@$(TRAINS)
	$(INSTALL) '.[dev,docs,export,fly,page]'
	touch $(TRAIN) $@

train: $(TRAIN) ## train, break and adapt: SCENARIO=reversed VEHICLE=paper
	$(BIN)/python train.py +scenario=$(SCENARIO) vehicle=$(VEHICLE)

# The shell puts the names in, not make: spaces, quotes and commas in them survive.
diagnose: export LOG := $(LOG)
diagnose: export VEHICLE := $(VEHICLE)
diagnose: export HEALTHY := $(HEALTHY)
diagnose: export PARAMS := $(PARAMS)
diagnose: $(BASE) ## what is wrong with a vehicle: LOG= VEHICLE= HEALTHY= PARAMS=
	$(BIN)/python diagnose.py "log=$$LOG" "vehicle=$$VEHICLE" $(if $(HEALTHY),"healthy=$$HEALTHY") $(if $(PARAMS),"params=$$PARAMS")

sweep: $(TRAIN) ## all scenarios x seeds, one table and one picture
	$(BIN)/python train.py -m +experiment=sweep

# The check of types keeps one core busy for a minute or two: `make -j 2 test` tests beside it.
test: check suite ## lint, types and tests: JOBS=2
# Arrays are small: a second thread of BLAS only waits, on a core that another process tests on.
suite test-all: export OMP_NUM_THREADS := 1
suite: $(READY)
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

bench: $(READY) ## measure the figures of docs/results/benchmarks.md
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[bench]'
	$(BIN)/python -m benchmarks.control

gpu: $(READY) ## where there is a GPU: its tests, steps per second, trainings
	$(BIN)/python -m pytest -m gpu
	$(BIN)/python -m benchmarks.control.on_gpu

blind: $(READY) ## sealed benchmark: CASES=430 SENSORS=stock STRANGERS=2
	$(BIN)/python -m benchmarks.blind $(if $(CASES),cases=$(CASES)) sensors=$(SENSORS) strangers=$(STRANGERS)

real: $(READY) ## logs of real vehicles: AUV_TORCHRL_DATA=FOLDER JOBS=2
	$(BIN)/python -m benchmarks.real --publish --jobs $(JOBS)

fuzz: $(READY) ## read logs of all formats altered at random: DRAWS=5000
	$(BIN)/python -m tests.flightlog.fuzz --draws $(or $(DRAWS),5000)

docs: $(READY) ## the documents as a site, into site/
	$(BIN)/mkdocs build --strict --quiet

clean: ## remove the environment and caches, keep outputs
	rm -rf $(VENV) site .pytest_cache .ruff_cache .hypothesis *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
