# The two commands of the README, and those for developers. Each sets up .venv if needed and reuses it.
SHELL := /bin/bash
VENV := .venv
BIN := $(VENV)/bin
# With these the nodes find the package, and each other on this machine only.
export AMENT_PREFIX_PATH := $(CURDIR)/$(VENV)$(if $(AMENT_PREFIX_PATH),:$(AMENT_PREFIX_PATH))
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
# Many container images set it; without byte code, each start of a node compiles SciPy's sources again (1 to 2 s of CPU).
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help demo test lint benchmark pictures docs clean

help: ## list these commands
	@grep -hE '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## /make \1\t/' | expand -t 18

demo: ## weigh a real payload: replay the committed recording through live nodes and write a report
	@tools/set_up.sh viewer
	@$(BIN)/python tools/demo.py

test: lint ## everything CI checks: formatting, types, tests
	@status=0; \
	$(BIN)/pytest -n 3 --dist worksteal --durations 40 -m "not alone" || status=1; \
	$(BIN)/pytest -m alone test/nodes || status=1; \
	exit $$status  # three processes on two cores, because many tests wait for nodes; both parts run in any case

lint: ## ruff and mypy alone
	@tools/set_up.sh viewer,test
	@$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy

benchmark: ## every figure of the README and docs (long)
	@tools/set_up.sh viewer,test
	@for file in $(filter-out benchmarks/transport_ends.py,$(wildcard benchmarks/*.py)); do echo "== $$file"; PYTHONPATH=. $(BIN)/python $$file || exit 1; done
	@$(BIN)/python -m benchmarks.identification.run
	@$(BIN)/python -m benchmarks.identification.excitation

pictures: ## the pictures in docs/, from the committed recordings
	@tools/set_up.sh viewer
	@$(BIN)/python tools/make_pictures.py

docs: ## the site, built strictly into out/site
	@tools/set_up.sh viewer,docs
	@PYTHONPATH=. $(BIN)/python -m sphinx -q -W --keep-going -b html docs out/site
	@echo "open out/site/index.html"

clean: ## remove the environment and everything built
	rm -rf $(VENV) build install log out
