# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0

# Everything makes the set-up that it needs; when there is nothing to do, that takes a few hundredths of a second.

SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help

# A recipe line that starts with it runs in the project's environment.
IN_ENVIRONMENT = setup/bootstrap && source setup/environment &&

comma := ,
PYTHON_SOURCES := $(wildcard src/*/) $(wildcard test/) $(wildcard bench/) $(wildcard docs/)

PYTHONS = python3.11 python3.12 python3.13
# What bloom can release; checkweigher_msgs has no tests of its own.
RELEASED = checkweigher_core checkweigher_dsp checkweigher_production checkweigher_driver

.PHONY: help setup demo test test-pythons test-noble soak bench coverage docs site deb image release lint format clean

help: ## Show this list.
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' Makefile | expand -t 14

setup: ## Make the environment (.venv) and build the workspace; PYTHON=python3.12 chooses the Python.
	@setup/bootstrap

demo: ## Replay a recorded bag through the ROS graph in real time.
	@./checkweigher replay bags/paper_60 --rate 1
	@echo 'next, a line with its page: ./checkweigher run --page --folder my_machine (docs/page.md)'

# Tests wait for lines in real time: three at once, also on two cores. They start hundreds of
# processes, which share their compiled modules even if the user's Python writes none. Each process
# has one thread for linear algebra, because idle threads of OpenBLAS keep the cores busy.
test: lint ## Check the code, then run all tests; PYTEST_ARGS='-n 0 -k name -x' are handed on.
	@$(IN_ENVIRONMENT) ROS_PYTHON_CHECK_FIELDS=1 ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST \
	  PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1 python3 -m pytest -n 3 --dist worksteal $(PYTEST_ARGS)

test-pythons: ## Run `make test` of the latest commit with each of PYTHONS, in log/python3.11 and so on.
	@for python in $(PYTHONS); do \
	  rm -rf log/$$python; git clone --quiet --shared . log/$$python; \
	  PYTHON=$$python $(MAKE) --directory log/$$python test; \
	done

test-noble: ## Run the tests of the packages for bloom with the packages of Ubuntu 24.04 (requirements/noble.in).
	@$(IN_ENVIRONMENT) python3 -m pip install --quiet --upgrade --no-deps --require-hashes --only-binary :all: \
	  --target log/noble -r requirements/noble.lock
	@$(IN_ENVIRONMENT) PYTHONPATH=$$PWD/log/noble:$$PYTHONPATH ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST \
	  python3 -m pytest -n 3 $(RELEASED:%=src/%/test) $(PYTEST_ARGS)

soak: ## Run the long tests, which print their counts; SOAK_ARGS='-k lines' are handed on.
	@$(IN_ENVIRONMENT) ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST \
	  python3 -m pytest -m soak -s $(SOAK_ARGS)

bench: ## Measure kernels and graph; BENCH_ARGS='--quick --part graph' are handed on.
	@$(IN_ENVIRONMENT) ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST python3 bench/run.py $(BENCH_ARGS)

coverage: ## Measure which lines the tests of each package reach, in one process; PYTEST_ARGS are handed on.
	@$(IN_ENVIRONMENT) ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST python3 -m coverage run --data-file log/coverage \
	  --source $(subst $() ,$(comma),$(filter-out checkweigher_msgs,$(notdir $(patsubst %/,%,$(wildcard src/*/))))) \
	  -m pytest -n 0 $(PYTEST_ARGS)
	@$(IN_ENVIRONMENT) python3 -m coverage report --data-file log/coverage --skip-covered --include 'src/*/checkweigher_*'

docs: ## Write the tables of docs/ and the file config/line.yaml from the code.
	@$(IN_ENVIRONMENT) python3 docs/make_docs.py

site: ## Build the docs as a site into dist/site, and check its links.
	@$(IN_ENVIRONMENT) packaging/site .venv dist/site

deb: ## Build the Debian package of the latest commit into dist/.
	@$(IN_ENVIRONMENT) packaging/deb .venv dist

image: ## Build the OCI image of the package in dist/; as root, with buildah and mmdebstrap.
	@packaging/image dist/checkweigher_*.deb dist

release: ## Build what is released of the latest commit into dist/: source archive, package, SBOM, check sums.
	@$(IN_ENVIRONMENT) packaging/release .venv dist

lint: ## Check style and types.
	@$(IN_ENVIRONMENT) ruff check $(PYTHON_SOURCES)
	@$(IN_ENVIRONMENT) ruff format --check $(PYTHON_SOURCES)
	@$(IN_ENVIRONMENT) mypy

format: ## Bring the code into the house style.
	@$(IN_ENVIRONMENT) ruff format $(PYTHON_SOURCES)
	@$(IN_ENVIRONMENT) ruff check --fix $(PYTHON_SOURCES)

clean: ## Remove the environment and everything that was built.
	rm -rf .venv .setup.lock build install log .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find src test -name __pycache__ -prune -exec rm -rf {} + 2> /dev/null || true
