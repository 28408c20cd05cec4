# Everything that a checkout needs: Python 3.11 or later, git and make. `make` alone lists what there is.
#
# Stamps in .venv remember what is installed, so that nothing is done twice.

SHELL := /bin/bash
PYTHON ?=
export PYTHON

python := .venv/bin/python
pytest_options ?= -ra -n auto --dist worksteal

.DEFAULT_GOAL := help
.PHONY: help demo test check bench kitchen pictures pin clean
.DELETE_ON_ERROR:

help:  ## what can be made
	@grep -hE '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## (.*)/  make \1\t\2/' | expand -t 16

demo: .venv/run.stamp  ## the bundled kitchen, alive in the browser
	@.venv/bin/mindstage demo

test: .venv/dev.stamp  ## all tests; `make test pytest_options="-k word"` for some
	@scripts/install_system.sh chromium:chromium swipl:swi-prolog-nox node:nodejs npm:npm Xvfb:xvfb xauth:xauth
	@scripts/install_node.sh
	@scripts/install_godot.sh || test -z "$$CI"
	@$(python) -m pytest $(pytest_options)

check: .venv/dev.stamp  ## style, types, packages, and that generated files are what their scripts make
	@$(python) -m ruff check .
	@$(python) -m ruff format --check .
	@$(python) -m mypy
	@cd godot && ../.venv/bin/gdformat --check --line-length 120 . && ../.venv/bin/gdlint .
	@$(python) scripts/make_kitchen.py --check
	@$(python) scripts/make_shapes.py --check
	@$(python) scripts/make_messages.py --check
	@$(python) -m pytest -q tests/test_project.py

bench: .venv/dev.stamp  ## every benchmark, as ratios against a named peer
	@scripts/install_system.sh swipl:swi-prolog-nox
	@$(python) -m benchmarks

kitchen: .venv/dev.stamp  ## writes the bundled kitchen anew
	@$(python) scripts/make_kitchen.py

pictures: .venv/run.stamp  ## takes the docs' pictures of the page anew
	@scripts/install_system.sh chromium:chromium
	@scripts/photograph_page.sh

pin:  ## pins the newest versions that pyproject.toml allows
	@scripts/pin.sh

clean:  ## removes everything that was made here
	@rm -rf .venv build dist .hypothesis .mypy_cache .pytest_cache .ruff_cache MUJOCO_LOG.TXT
	@find . -name __pycache__ -type d -not -path './.git/*' -prune -exec rm -rf {} +

.venv/run.stamp: requirements/run.txt pyproject.toml scripts/install_python.sh
	@scripts/install_python.sh run
	@touch $@

# After the other, never beside it: both write into the same folder.
.venv/dev.stamp: requirements/dev.txt .venv/run.stamp
	@scripts/install_python.sh dev
	@touch $@
