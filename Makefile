# Targets of the whole project; `make` alone lists them.

CASE ?= beam2d
MODEL ?= det
RECIPE ?= fast
NP ?= 2
JOBS ?= 2
SAMPLES ?=
SCALE ?= smoke
WHERE ?=
NAME ?=
OPTIONS ?=
SUITE ?= trixie
TORCH ?= torch==2.13.0

DATA ?= data/$(CASE)$(if $(SAMPLES),-$(SAMPLES))
RUN ?= runs/$(CASE)-$(MODEL)-$(RECIPE)$(if $(SAMPLES),-$(SAMPLES))

PUBLISHED = $(RUN)/published.yaml
# The report of another model shows the paper's network beside it, from its committed record.
RECORD = $(if $(filter det,$(MODEL)),,$(wildcard docs/results/$(CASE)-det-$(RECIPE).json))

DEBIAN_PYTHON := /usr/bin/python3
DEBIAN_PACKAGES := gcc libopenblas0-serial openmpi-bin python3-dolfinx python3-gmsh python3-h5py \
	python3-matplotlib python3-meshio python3-venv python3-yaml
NODE_PACKAGES := nodejs npm
BROWSER_PACKAGES := chromium
CALCULIX_PACKAGES := calculix-ccx
DATAGEN := .venv-datagen/bin/datagen
SURROGATE := .venv-surrogate/bin/surrogate
WEB := surrogate/page/web
BUNDLE := surrogate/page/bundle/page.js
# `make page` uses the trained network of the package for CASE, where there is one; the reduced one goes first.
SHIPPED = $(if $(filter det,$(MODEL)),$(if $(SAMPLES),,$(firstword \
	$(wildcard $(foreach name,$(CASE)_reduced $(CASE),surrogate/trained/$(name)/config.yaml)))))
SHOWN = $(if $(SHIPPED),$(notdir $(patsubst %/config.yaml,%,$(SHIPPED))),$(RUN))
COMPOSE = $(foreach v,CASE MODEL RECIPE NP SAMPLES TORCH,$(v)='$($(v))') \
	docker compose -f docker/compose.yaml
# Folders of tests by environment, the longest tests first; each worker begins with a part of them and takes of others'.
FACTORY_TESTS := tests/datagen
LEARNER_TESTS := tests/end_to_end tests/documentation tests/experiments tests/surrogate \
	tests/shared_schema tests/docker tests/tools
# Tests with the mark `slow` are the long part, all others the short one. Options in T come last: their -m counts.
PART = all
SELECTION = $(if $(filter short,$(PART)),-m 'not slow')$(if $(filter long,$(PART)),-m slow)
PYTEST = -m pytest -n $(JOBS) --dist worksteal --durations 20 --junitxml build/tests/$(@:test-%=%)-$(PART).xml
EXPERIMENTS = .venv-surrogate/bin/python -m experiments
STUDIES = $(EXPERIMENTS) $@ --scale $(SCALE) $(WHERE)

export OMPI_ALLOW_RUN_AS_ROOT := 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM := 1
# More ranks than cores, and no words of mpirun's own: Open MPI 4, then 5, whose options differ.
export OMPI_MCA_rmaps_base_oversubscribe := 1
export OMPI_MCA_orte_execute_quiet := 1
export OMPI_MCA_reachable := weighted
export PRTE_MCA_rmaps_default_mapping_policy := :oversubscribe
MPIRUN := mpirun -n $(NP)

.DEFAULT_GOAL := help
.PHONY: help setup demo data train evaluate report page script shelve reproduce beyond organs benchmark gpu test \
	test-long test-all test-datagen test-surrogate lint dist clean packages debian-packages node-packages \
	browser-packages calculix-packages docs images compose-demo test-images test-debian

help: ## list the targets
	@echo "Targets (variables: CASE=$(CASE) MODEL=$(MODEL) RECIPE=$(RECIPE) NP=$(NP) SAMPLES=all" \
		"SCALE=$(SCALE)):"
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  \1\t\2/p' $(MAKEFILE_LIST) | expand -t 16

setup: .venv-datagen/.installed .venv-surrogate/.installed $(BUNDLE) ## install what is missing

demo: MODEL = mechanics
demo: report ## install, solve, train and evaluate; print the path of the report (MODEL=det: the paper's network)

data: .venv-datagen/.installed ## solve the samples of CASE on NP ranks and map them to the grid
	@mkdir -p $(DATA)
	OMP_NUM_THREADS=1 $(MPIRUN) $(DATAGEN) run $(CASE) --out $(DATA)/nodal \
		$(if $(SAMPLES),--samples $(SAMPLES))
	$(DATAGEN) structure $(DATA)/nodal --out $(DATA)/structured

train: data .venv-surrogate/.installed ## train MODEL by RECIPE on the data of CASE
	@mkdir -p $(dir $(RUN))
	$(SURROGATE) train $(CASE)-$(MODEL)-$(RECIPE) --data $(DATA)/structured --out $(RUN)

evaluate: train ## evaluate the run on the test split and draw its figures
	@$(EXPERIMENTS) published $(RUN) > $(PUBLISHED)
	$(SURROGATE) evaluate $(RUN) --data $(DATA)/structured --beside $(PUBLISHED) $(CERTIFY)

report: evaluate
	@$(SURROGATE) report $(RUN) --nodal $(DATA)/nodal --beside $(PUBLISHED) \
		$(RECORD:%=--against %) --out $(RUN)/report.html

page: $(if $(SHIPPED),.venv-surrogate/.installed,train) $(BUNDLE) ## write a page to drag loads on
	@mkdir -p build
	$(SURROGATE) page $(SHOWN) --out build/$(notdir $(SHOWN)).html

script: setup ## run FILE, a Python script that imports both programs
	.venv-datagen/bin/python tools/both_programs.py $(FILE)

shelve: CERTIFY = --certify
shelve: evaluate ## put the evaluated run among the trained networks of the package, as CASE
	$(SURROGATE) shelve $(RUN) $(CASE)

reproduce: ## make the paper's tables and figures at SCALE=smoke|laptop|paper
beyond: ## do the studies beyond the paper at SCALE=smoke|plane|laptop|day
organs: ## do the studies of organs at SCALE=smoke|laptop
reproduce beyond organs: setup
	@$(STUDIES) --list-data > .venv-surrogate/data-commands
	@OMP_NUM_THREADS=1 MPIRUN="$(MPIRUN)" PATH="$(CURDIR)/.venv-datagen/bin:$$PATH" \
		sh -e .venv-surrogate/data-commands
	$(STUDIES)

benchmark: setup ## measure the benchmark NAME (OPTIONS="--rounds 5"), write its record and page
	$(EXPERIMENTS) benchmark $(NAME) $(OPTIONS)

gpu: setup ## measure what needs a GPU, with results in build/gpu-results (OPTIONS="--small --device cpu")
	$(EXPERIMENTS) gpu pack build/gpu --data data --no-wheels
	$(EXPERIMENTS) gpu run build/gpu-results --data build/gpu/data $(OPTIONS)

test: ## run the short tests: every command, every shipped network (JOBS=cores, T="-k beam" selects)
test-long: ## run the long tests: studies, pages, browser, faults, clusters
test-all: ## run all tests
test: PART = short
test-long: PART = long
test-long test-all: | browser-packages calculix-packages
test test-long test-all: test-datagen test-surrogate

test-datagen: .venv-datagen/.installed .venv-plaid/.installed
	.venv-datagen/bin/python $(PYTEST) $(SELECTION) $(FACTORY_TESTS) $(T)

test-surrogate: setup
	OMP_NUM_THREADS=1 .venv-surrogate/bin/python $(PYTEST) $(SELECTION) $(LEARNER_TESTS) $(T)

lint: .venv-surrogate/.installed $(WEB)/node_modules/.package-lock.json ## check style and types
	.venv-surrogate/bin/ruff format --check .
	.venv-surrogate/bin/ruff check .
	.venv-surrogate/bin/mypy
	cd $(WEB) && npm run --silent lint

dist: ## build wheels of the three distributions in dist/ (python3 -m tools.wheels, with `build` installed)
	@rm -rf dist && python3 -m venv build/wheels && build/wheels/bin/pip install -q build
	build/wheels/bin/python -m tools.wheels dist
	@ls dist

docs: setup .venv-docs/.installed ## build the documentation as a site in build/site, check its links
	.venv-datagen/bin/python -m website.reference datagen
	.venv-surrogate/bin/python -m website.reference surrogate
	.venv-docs/bin/sphinx-build --quiet --fail-on-warning --keep-going -d build/doctrees \
		-c website . build/site
	@echo "open build/site/index.html"

images: ## build the container images with Docker
	REVISION=$$(git rev-parse HEAD) $(COMPOSE) build

compose-demo: images ## run the demo in containers; copy its runs to this folder
	$(COMPOSE) up
	$(COMPOSE) cp evaluate:/work/runs .

test-images: ## build and run the images on a bare Debian without Docker
	@TORCH='$(TORCH)' python3 -m tools.containers.images

test-debian: ## run the demo and the tests on a bare Debian, SUITE=bookworm|trixie|sid
	@SUITE='$(SUITE)' SAMPLES='$(SAMPLES)' TESTS='$(TESTS)' T="$(T)" TORCH='$(TORCH)' \
		python3 -m tools.containers.debian

clean: ## remove environments, datasets and runs
	rm -rf .venv-datagen .venv-plaid .venv-surrogate .venv-docs data runs build dist \
		$(WEB)/node_modules $(dir $(BUNDLE))
	find . -name __pycache__ -o -name '*.egg-info' -o -name '.*_cache' | xargs rm -rf

# --- environments -----------------------------------------------------------------------------

debian-packages: PACKAGES = $(DEBIAN_PACKAGES)
node-packages: PACKAGES = $(NODE_PACKAGES)
browser-packages: PACKAGES = $(BROWSER_PACKAGES)
calculix-packages: PACKAGES = $(CALCULIX_PACKAGES)
packages: PACKAGES = $(DEBIAN_PACKAGES) $(NODE_PACKAGES) $(BROWSER_PACKAGES) $(CALCULIX_PACKAGES)
packages debian-packages node-packages browser-packages calculix-packages:
	@missing=""; \
	for package in $(PACKAGES); do \
		command -v $$package >/dev/null \
			|| dpkg-query -W -f='$${Status}' $$package 2>/dev/null | grep -q 'ok installed' \
			|| missing="$$missing $$package"; \
	done; \
	if [ -z "$$missing" ]; then exit 0; fi; \
	if ! command -v apt-get >/dev/null; then \
		echo "make: this needs Debian 12 or 13, for the packages$$missing" >&2; exit 2; fi; \
	if [ "$$(id -u)" != 0 ]; then \
		echo "make: packages are missing; install them by: sudo apt-get install$$missing" >&2; \
		exit 2; fi; \
	apt-get update -q && \
		DEBIAN_FRONTEND=noninteractive apt-get install -qy --no-install-recommends $$missing

# The page's script, for checkouts; wheels contain it.
$(WEB)/node_modules/.package-lock.json: $(WEB)/package-lock.json | node-packages
	cd $(WEB) && npm ci --no-audit --no-fund

$(BUNDLE): $(WEB)/node_modules/.package-lock.json $(WEB)/bundle.mjs $(shell find $(WEB)/src -type f)
	cd $(WEB) && npm run --silent build

# Debian's dolfinx, NumPy and h5py are built for Debian's own interpreter; pip must not replace them.
.venv-datagen/.installed: shared_schema/pyproject.toml datagen/pyproject.toml \
		datagen/requirements.txt datagen/requirements-alone.txt | debian-packages
	rm -rf .venv-datagen
	$(DEBIAN_PYTHON) -m venv --system-site-packages .venv-datagen
	.venv-datagen/bin/pip install -q -r datagen/requirements.txt
	.venv-datagen/bin/pip install -q --no-deps -r datagen/requirements-alone.txt
	.venv-datagen/bin/pip install -q --no-deps -e shared_schema -e datagen
	touch $@

# For the tests of `datagen export --format plaid` and `datagen publish`; without pyplaid for this Python they are skipped.
.venv-plaid/.installed: | debian-packages
	rm -rf .venv-plaid
	$(DEBIAN_PYTHON) -m venv .venv-plaid
	-.venv-plaid/bin/pip install -q 'pyplaid==1.0.*'
	touch $@

.venv-surrogate/.installed: shared_schema/pyproject.toml surrogate/pyproject.toml | debian-packages
	rm -rf .venv-surrogate
	$(DEBIAN_PYTHON) -m venv .venv-surrogate
	.venv-surrogate/bin/pip install -q '$(TORCH)'
	.venv-surrogate/bin/pip install -q -e shared_schema -e 'surrogate[test,export]'
	.venv-surrogate/bin/pip install -q --no-deps 'bayesian-torch==0.5.*' # needs PyTorch only
	touch $@

.venv-docs/.installed: website/requirements.txt | debian-packages
	rm -rf .venv-docs
	$(DEBIAN_PYTHON) -m venv .venv-docs
	.venv-docs/bin/pip install -q -r website/requirements.txt
	touch $@
