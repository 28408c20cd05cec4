# Requirements: Python 3.11 or later, git and make. `make` without a target lists the targets.
#
# Stamp files in .venv record what is installed, so that nothing is installed twice.

SHELL := /bin/bash
PYTHON ?=
export PYTHON

python := .venv/bin/python
corpus_options ?=
# Generators of ROS messages and what they need; /PATH:PACKAGE is installed if the path does not exist.
opengl_packages := /usr/lib/$(shell uname -m)-linux-gnu/libEGL.so.1:libegl1 \
	/usr/lib/$(shell uname -m)-linux-gnu/dri/swrast_dri.so:libgl1-mesa-dri
ros_packages := rosidl:rosidl-tools gcc:gcc /usr/include/stdio.h:libc6-dev \
	/usr/include/rosidl_runtime_c:rosidl-generator-c-cpp \
	/usr/lib/python3/dist-packages/ament_index_python:python3-ament-index \
	/usr/lib/genpy/genmsg_py.py:python3-genpy /usr/lib/actionlib_msgs/genaction.py:libactionlib-msgs-dev \
	/usr/share/actionlib_msgs/msg:ros-actionlib-msgs /usr/share/geometry_msgs/msg:ros-geometry-msgs \
	/usr/share/std_msgs/msg:ros-std-msgs \
	/usr/lib/python3/dist-packages/geometry_msgs:python3-geometry-msgs \
	/usr/lib/python3/dist-packages/actionlib_msgs:python3-actionlib-msgs
pytest_options ?= -raR -n auto --dist worksteal
random_tests ?= $(addprefix tests/,scene msgs bridge geometry simulation)

.DEFAULT_GOAL := help
.PHONY: help demo test test-random test-slow check docs bench mutants fuzz places kitchen pictures pin clean
.DELETE_ON_ERROR:

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/  make \1\t\2/' | expand -t 20

demo: .venv/run.stamp  ## the bundled kitchen in the browser
	@.venv/bin/mindstage demo

test: .venv/dev.stamp  ## all tests; `make test pytest_options="-k word"` for some
	@scripts/install_system.sh chromium:chromium swipl:swi-prolog-nox node:nodejs npm:npm Xvfb:xvfb xauth:xauth
	@scripts/install_system.sh $(opengl_packages)
	@scripts/install_system.sh $(ros_packages)
	@scripts/install_node.sh
	@scripts/install_godot.sh || test -z "$$CI"
	@scripts/install_system.sh cmake:cmake ninja:ninja-build c++:g++ \
		"$$(python3.11 -c 'import sysconfig; print(sysconfig.get_path("include"))' 2>/dev/null)/Python.h:python3-dev"
	@scripts/ros2_for_tests.sh >/dev/null
	@$(python) -m pytest $(pytest_options)

test-random: .venv/dev.stamp  ## quick packages in random order, with new random inputs
	@seed=$${RANDOM_SEED:-$$RANDOM}; echo "mindstage: repeat this order and these inputs with RANDOM_SEED=$$seed"; \
	HYPOTHESIS_PROFILE=random $(python) -m pytest $(pytest_options) -p randomly --randomly-seed=$$seed \
		--hypothesis-seed=$$seed $(random_tests)

test-slow: .venv/dev.stamp  ## what `make test` leaves out: full lengths, more examples, advisories about the pinned packages
	@HYPOTHESIS_PROFILE=thorough $(python) -m pytest $(pytest_options) -m "slow or hypothesis"

check: .venv/dev.stamp  ## style, types, package structure, and that generated files are up to date
	@$(python) -m ruff check .
	@$(python) -m ruff format --check .
	@$(python) -m mypy
	@$(python) -m pyright --pythonpath $(python)
	@cd godot && ../.venv/bin/gdformat --check --line-length 120 . && ../.venv/bin/gdlint .
	@$(python) scripts/make_kitchen.py --check
	@$(python) scripts/make_shapes.py --check
	@$(python) scripts/make_messages.py --check
	@$(python) scripts/make_ros_packages.py --check
	@$(python) scripts/make_command_line.py --check
	@$(python) scripts/make_questions.py --check
	@$(python) scripts/make_limits.py --check
	@$(python) scripts/make_sizes.py --check
	@$(python) scripts/make_errors.py --check
	@$(python) scripts/make_flows.py --check
	@$(python) scripts/join_changes.py >/dev/null
	@$(python) -m pytest -q tests/test_project.py

docs: .venv/docs.stamp  ## the documentation site, in build/site
	@NO_MKDOCS_2_WARNING=1 $(python) -m mkdocs build --strict

bench: .venv/dev.stamp  ## all benchmarks, as ratios against named peers
	@scripts/install_system.sh swipl:swi-prolog-nox
	@$(python) -m benchmarks

mutants: .venv/dev.stamp  ## mutation testing: a score by package; `make mutants mutants_options="--count 50"`
	@$(python) scripts/mutants.py $(mutants_options)

fuzz: .venv/dev.stamp  ## fuzzing of every reader and port for FUZZ_S seconds (600)
	@$(python) scripts/fuzz.py --seconds $(or $(FUZZ_S),600)

places: .venv/dev.stamp  ## skills of robots in 600 generated homes of the day, and their rates; places_options="--cells 60"
	@$(python) -m tests.places --workers 2 --page $(places_options)

corpus: .venv/run.stamp  ## try all maps of a folder and print a table: make corpus MAPS=folder
	@test -n "$(MAPS)" || { echo "give a folder of maps: make corpus MAPS=folder" >&2; exit 2; }
	@$(python) scripts/try_maps.py $(MAPS) $(corpus_options)

kitchen: .venv/dev.stamp  ## regenerate the bundled kitchen
	@$(python) scripts/make_kitchen.py

pictures: .venv/dev.stamp  ## regenerate the documentation's pictures of the viewer
	@scripts/install_system.sh chromium:chromium $(opengl_packages)
	@$(python) scripts/photograph_page.py

pin:  ## pin the newest versions that pyproject.toml allows
	@scripts/pin.sh

clean:  ## remove everything that make created
	@rm -rf .venv build dist .hypothesis .mypy_cache .pytest_cache .ruff_cache MUJOCO_LOG.TXT
	@find . -name __pycache__ -type d -not -path './.git/*' -prune -exec rm -rf {} +

.venv/run.stamp: requirements/run.txt pyproject.toml scripts/install_python.sh
	@scripts/install_python.sh run
	@touch $@

# After run.stamp, never in parallel: both install into the same environment.
.venv/dev.stamp: requirements/dev.txt .venv/run.stamp
	@scripts/install_python.sh dev
	@touch $@

.venv/docs.stamp: requirements/docs.txt .venv/run.stamp
	@scripts/install_python.sh docs
	@touch $@
