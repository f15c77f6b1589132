# What a person who works on the bridge calls. `make help` lists it.

PYTHON ?= python3
UV ?= uv

VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-input
LOCK := $(UV) pip compile pyproject.toml --universal --python-version 3.11 --generate-hashes \
	--no-emit-index-url --no-emit-find-links --no-header --no-annotate --no-config --quiet

# Real counterparts of the bridge: the tests start them by name.
COUNTERPARTS := mosquitto mosquitto_pub mbpoll openssl
DEBIAN_PACKAGES := mosquitto mosquitto-clients mbpoll openssl
# Only `make test-brokers` needs these, and they are large: they are not installed without a word.
OTHER_BROKERS := nats-server rabbitmq-server

# Most tests wait for a wire, a broker or a process: so many side by side, even on two cores.
WORKERS ?= 4
# The tests of `make check` wait for little.
QUICK_WORKERS ?= 3

# Where a wrong line could switch a relay: branch coverage of each, in percent, at the least.
COVERED := protocol line hub config mqtt
COVERAGE := 95

# A real Node-RED: some 120 MB that outlive `make clean`.
NODE_RED_RELEASE := 4.1.15
NODE_RED := $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/wisco2mqtt/node-red-$(NODE_RED_RELEASE)

# What judges whether the panel can be used by all.
AXE_RELEASE := 4.14.1
AXE := $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/wisco2mqtt/axe-$(AXE_RELEASE)

# What builds the documentation.
SITE := build/site-venv
# The theme advertises its successor at each build.
export NO_MKDOCS_2_WARNING := 1

# Debian keeps brokers out of a plain user's PATH.
export PATH := $(PATH):/usr/sbin:/sbin

# Without compiled files each worker and each bridge that a test starts compiles all anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help test check quick demo proofs soak fleet scans bench docs lint format lock clean counterparts \
	coverage pytest test-brokers test-node-red node-red-pictures test-ha home-assistant-pictures test-fresh \
	test-web panel-pictures site deb apt-repo app image test-packages release-check

help:  ## what there is
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 26

test: lint pytest coverage  ## everything that has to hold: linters, tests, coverage

demo: $(VENV)/.demo  ## the bridge with simulated modules and a broker of its own, on this machine
	$(BIN)/python -m bridge demo

proofs: $(VENV)/.dev counterparts  ## every promise under its failure, in full; ONLY="A3 C1" for some
	PYTHONPATH=.:tests:rigs $(BIN)/python -m proofs --jobs $(or $(JOBS),3) $(ONLY)

soak: $(VENV)/.dev counterparts  ## the daemon for an hour in a house where everything goes wrong; MINUTES=3 for less
	PYTHONPATH=.:tests:rigs $(BIN)/python -m soak --minutes $(or $(MINUTES),60)

fleet: $(VENV)/.dev counterparts  ## clusters under kills, a fleet at one broker, its alerts: two hours; ONLY="nats" COUNT=50
	@for name in nats-server rabbitmq-server prometheus; do command -v $$name >/dev/null || \
		{ echo "the rig needs $$name: apt-get install nats-server rabbitmq-server prometheus" >&2; exit 1; }; done
	PYTHONPATH=.:tests:rigs $(BIN)/python -m fleet $(ONLY) --count $(or $(COUNT),1000) \
		--bridges $(or $(BRIDGES),5 20 100)

bench: $(VENV)/.dev counterparts  ## the bridge against a bare loop and the wire's own limit; CASES="C E:wisco" for some
	PYTHONPATH=.:tests:rigs $(BIN)/python -m bench $(CASES)

scans: $(VENV)/.dev counterparts  ## scans of a panel of which nothing is known, in full: a quarter of an hour
	$(BIN)/pytest -q -p no:randomly rigs/scans/full_scan.py rigs/scans/full_line_scan.py

test-brokers: $(VENV)/.dev counterparts  ## the end-to-end tests on nats-server and rabbitmq-server; BROKERS=nats for one
	@for name in $(OTHER_BROKERS); do command -v $$name >/dev/null || \
		{ echo "the tests need $$name: apt-get install $(OTHER_BROKERS)" >&2; exit 1; }; done
	@for broker in $(or $(BROKERS),nats rabbitmq); do BROKER=$$broker \
		$(BIN)/pytest -q -p no:randomly -n 3 --timeout 180 tests/end_to_end || exit 1; done

test-node-red: $(VENV)/.dev counterparts $(NODE_RED)/.installed  ## the flows of docs/node-red in a real Node-RED
	NODE_RED=$(NODE_RED) $(BIN)/pytest -q -p no:randomly rigs/node_red/deployed_flows.py

node-red-pictures: $(VENV)/.dev counterparts $(NODE_RED)/.installed  ## the pictures of docs/node-red anew
	@command -v chromium >/dev/null || { echo "the pictures need chromium: apt-get install chromium" >&2; exit 1; }
	NODE_RED=$(NODE_RED) PYTHONPATH=.:tests:rigs $(BIN)/python -m node_red.pictures

docs: $(VENV)/.dev  ## docs/commands/ and the man pages in docs/man/ anew, from what --help prints
	PYTHONPATH=.:tests:rigs $(BIN)/python -m reference

test-ha: $(VENV)/.home-assistant counterparts  ## two releases of the real Home Assistant, a quarter of an hour; ONLY=restarts
	PYTHONPATH=.:tests:rigs $(BIN)/python -m home_assistant.install
	$(BIN)/pytest -q -p no:randomly -n 0 --timeout 900 rigs/home_assistant/check_$(or $(ONLY),*).py

home-assistant-pictures: $(VENV)/.home-assistant counterparts  ## the pictures of docs/home-assistant.md anew
	PYTHONPATH=.:tests:rigs $(BIN)/python -m home_assistant.install
	PYTHONPATH=.:tests:rigs $(BIN)/python -m home_assistant.pictures

test-web: $(VENV)/.home-assistant counterparts $(AXE)/.installed  ## the panel in Debian's chromium: six minutes; ONLY=setup
	@command -v chromium >/dev/null || { echo "the panel needs chromium: apt-get install chromium" >&2; exit 1; }
	AXE=$(AXE) $(BIN)/pytest -q -p no:randomly -n 0 --timeout 300 rigs/panel/check_$(or $(ONLY),*).py

panel-pictures: $(VENV)/.home-assistant counterparts  ## the pictures of docs/panel.md anew
	@command -v chromium >/dev/null || { echo "the pictures need chromium: apt-get install chromium" >&2; exit 1; }
	PYTHONPATH=.:tests:rigs $(BIN)/python -m panel.pictures

test-fresh:  ## every line of README and docs, pasted in a fresh Debian 12 (root, debootstrap): five minutes
	PYTHONPATH=.:tests:rigs $(PYTHON) -m fresh

site: $(SITE)/.installed  ## the documentation as a site, in build/site/; no link of it is dead
	$(SITE)/bin/mkdocs --quiet build --strict --config-file rigs/pages/mkdocs.yml
	PYTHONPATH=.:rigs $(SITE)/bin/python -m pages.links build/site

deb: $(VENV)/.python  ## the Debian package, in build/deb/ (root, debootstrap)
	PYTHONPATH=.:rigs $(BIN)/python -m packages.deb

apt-repo: deb  ## a signed repository of it, in build/apt/; the key is thrown away
	PYTHONPATH=.:rigs $(BIN)/python -m packages.repository

image: $(VENV)/.dev  ## the container image, by buildah; tried by podman and podman-compose (root, debootstrap)
	PYTHONPATH=.:tests:rigs $(BIN)/python -m packages.image
	PYTHONPATH=.:tests:rigs $(BIN)/python -m packages.compose

app: $(VENV)/.dev  ## the repository of the Home Assistant app, in build/home-assistant/
	PYTHONPATH=.:rigs $(BIN)/python -m packages.app

test-packages: $(VENV)/.dev  ## the package from install to purge, Debian 12 and 13 with systemd (root): five minutes
	PYTHONPATH=.:tests:rigs $(BIN)/python -m packages

release-check: $(VENV)/.release  ## all of a release but its publication, twice, in dist/ (root, debootstrap)
	PYTHONPATH=.:rigs $(BIN)/python -m release

lint: $(VENV)/.dev  ## linters, types and the layers of the architecture
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

check: $(VENV)/.dev  ## lint, types, and the tests that need no process and no broker: a minute
	@$(MAKE) --jobs 2 --output-sync=target lint quick

quick: $(VENV)/.dev
	$(BIN)/pytest -q --numprocesses $(QUICK_WORKERS) --dist worksteal -m "not slow" \
		--ignore tests/broker --ignore tests/end_to_end --ignore tests/rigs

format: $(VENV)/.dev  ## puts the code into its form
	$(BIN)/ruff format
	$(BIN)/ruff check --fix

lock:  ## resolves requirements/ anew from pyproject.toml (needs uv)
	@command -v $(UV) >/dev/null || { echo "make lock needs uv: pip install uv" >&2; exit 1; }
	$(LOCK) --upgrade --all-extras --group dev --output-file requirements/dev.txt
	$(LOCK) --extra demo --extra cli --extra web --constraint requirements/dev.txt --output-file requirements/demo.txt
	$(LOCK) --constraint requirements/dev.txt --output-file requirements/run.txt
	$(LOCK) --extra cli --extra web --constraint requirements/dev.txt --output-file requirements/debian.txt
	$(LOCK) --group release --constraint requirements/dev.txt --output-file requirements/release.txt
	$(LOCK) --group site --constraint requirements/dev.txt --output-file requirements/site.txt
	$(LOCK) --group home-assistant --constraint requirements/dev.txt \
		--output-file requirements/home-assistant.txt
	@! grep -nE '://|^-' requirements/*.txt

clean:  ## removes what the other targets made
	rm -rf $(VENV) build dist .coverage .hypothesis .mypy_cache .pytest_cache .ruff_cache \
		.import_linter_cache
	find bridge tests rigs -name __pycache__ -prune -exec rm -rf {} +

pytest: $(VENV)/.dev counterparts
	$(BIN)/pytest --numprocesses $(WORKERS) --dist worksteal --cov --cov-report=

coverage: pytest
	@for part in $(COVERED); do \
		echo "coverage of bridge/$$part, $(COVERAGE) % wanted:"; \
		$(BIN)/coverage report --include "bridge/$$part/*" --fail-under=$(COVERAGE) || exit 1; \
	done

counterparts:
	@missing=; for name in $(COUNTERPARTS); do \
		command -v $$name >/dev/null || missing="$$missing $$name"; done; \
	test -n "$$missing" || exit 0; \
	as_root=; test "$$(id -u)" = 0 || as_root=sudo; \
	for name in apt-get $$as_root; do command -v $$name >/dev/null || \
		{ echo "the tests need$$missing (Debian: $(DEBIAN_PACKAGES))" >&2; exit 1; }; done; \
	echo "installing $(DEBIAN_PACKAGES)"; \
	$$as_root apt-get update -qq </dev/null && \
	$$as_root env DEBIAN_FRONTEND=noninteractive \
		apt-get install -qq -y --no-install-recommends $(DEBIAN_PACKAGES) </dev/null

$(VENV)/.python:
	@command -v $(PYTHON) >/dev/null || \
		{ echo "there is no $(PYTHON) here: make PYTHON=/path/to/python3" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python 3.11 or later is needed, and $(PYTHON) is" \
			"$$($(PYTHON) --version): make PYTHON=python3.11" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
		{ echo "$(PYTHON) cannot make a venv: apt-get install python3-venv" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@touch $@

# The lock is complete, so nothing is left to resolve: an older pip, asked to resolve all the same, refuses
# a pinned package as soon as a newer release of it is out (an extra such as coverage[toml] brings it up).
$(VENV)/.demo: requirements/demo.txt $(VENV)/.python
	$(PIP) --no-deps --require-hashes --requirement requirements/demo.txt
	@touch $@

$(VENV)/.home-assistant: requirements/home-assistant.txt $(VENV)/.dev
	$(PIP) --no-deps --require-hashes --requirement requirements/home-assistant.txt
	@touch $@

$(VENV)/.release: requirements/release.txt $(VENV)/.dev
	$(PIP) --no-deps --require-hashes --requirement requirements/release.txt
	@touch $@

# A venv of its own: mkdocs and its theme have nothing to do with the bridge.
$(SITE)/.installed: requirements/site.txt $(VENV)/.python
	$(PYTHON) -m venv $(SITE)
	$(SITE)/bin/python -m pip install --quiet --disable-pip-version-check --no-input \
		--no-deps --require-hashes --requirement requirements/site.txt
	@touch $@

$(VENV)/.dev: requirements/dev.txt pyproject.toml $(VENV)/.python
	$(PIP) --no-deps --require-hashes --requirement requirements/dev.txt
	$(PIP) --no-deps --no-build-isolation --editable .
	@touch $@

$(AXE)/.installed:
	@command -v npm >/dev/null || { echo "axe-core needs npm: apt-get install nodejs npm" >&2; exit 1; }
	npm install --prefix $(AXE) --no-audit --no-fund --loglevel=error axe-core@$(AXE_RELEASE)
	@touch $@

$(NODE_RED)/.installed:
	@for name in node npm; do command -v $$name >/dev/null || \
		{ echo "Node-RED needs $$name: apt-get install nodejs npm" >&2; exit 1; }; done
	npm install --prefix $(NODE_RED) --no-audit --no-fund --loglevel=error node-red@$(NODE_RED_RELEASE)
	@touch $@
