# `make run` trains a policy, `make test` checks everything that takes seconds; both make their own environment first.
SHELL := /bin/bash
PYTHON ?= python3
VENV := .venv
PY := $(VENV)/bin/python
READY := $(VENV)/.ready

.PHONY: run test test-slow test-mjlab test-oldest test-core lint lint-types lint-rest docs gallery format pins env release clean
.DEFAULT_GOAL := test

run: $(READY)
	$(PY) train/ppo.py --device cpu --num-envs 64 --out runs/walk

# a process per core, four at most: each takes a gigabyte; the slowest tests are named at the end
SHARED_OUT := -n logical --maxprocesses 4 --dist worksteal --durations 20

test: $(READY)
	$(PY) -m pytest $(SHARED_OUT) -m "not slow"

# pytest exits with 5 where no test is marked slow
test-slow: $(READY)
	$(PY) -m pytest $(SHARED_OUT) -m slow || [ $$? -eq 5 ]

# mjlab pins another MuJoCo, so it has an environment of its own, with mrwarp's core
test-mjlab:
	test -x .venv-mjlab/bin/pytest || { $(PYTHON) -m venv .venv-mjlab && .venv-mjlab/bin/python -m pip install \
		-c <(grep -E '^(torch|warp-lang)==' constraints.txt) mjlab==1.6.0 -e . pytest; }
	PYTHONPATH=. .venv-mjlab/bin/python -m pytest --noconftest -m "not slow" tests/integrations/test_mjlab.py tests/integrations/test_hosts.py

# exactly the lower bounds of pyproject.toml: joint, drive, plain MuJoCo, and the task in others' learning code.
# Isaac Lab 3.0.0 pins these Newton, Warp, MuJoCo and torch, mjlab 1.6.0 this rsl-rl
OLDEST = $(shell sed -n '/^dependencies/,/^\]/p;/^sim = /,/^\]/p;/gymnasium>/p' pyproject.toml | sed -nE 's/^ *"([^>]*)>=([0-9.]*).*/\1==\2/p')
HOSTS := $(addprefix tests/,actuator/test_newton_drive.py actuator/test_joint_batch.py mujoco integrations)
.venv-oldest/bin/pytest:
	$(PYTHON) -m venv .venv-oldest
	.venv-oldest/bin/python -m pip install $(foreach pin,$(OLDEST),'$(pin)') -e . pytest

test-oldest: .venv-oldest/bin/pytest
	PYTHONPATH=. .venv-oldest/bin/python -m pytest --noconftest $(HOSTS)

# the core alone in an environment of its own, with any PYTHON: commands, kernels, effects and fits
CORE := $(addprefix tests/,test_cli.py test_params.py kernels effects identify/test_fit.py)
.venv-core/bin/pytest:
	$(PYTHON) -m venv .venv-core
	.venv-core/bin/python -m pip install -c constraints.txt -e . pytest

test-core: .venv-core/bin/pytest
	PYTHONPATH=. .venv-core/bin/python -m pytest --noconftest -m "not slow and not gpu" \
		--ignore tests/kernels/test_cuda_compile.py $(CORE)

# the types take as long as all the rest
lint: $(READY)
	$(MAKE) -j 2 --output-sync=line lint-types lint-rest

lint-types: $(READY)
	$(PY) -m pyright --pythonpath $(PY)

lint-rest: $(READY)
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(VENV)/bin/lint-imports --no-cache
	$(PY) -m mrwarp reproduce docs --only-check
	$(PY) -m mrwarp device page --only-check
	$(PY) tools/plain_words.py
	$(PY) tools/gallery.py --only-check
	$(PY) tools/sizes.py
	$(MAKE) docs

# the pages as a site in build/site, with the reference from the code; a warning is an error, but unseen with --quiet; no network is needed
docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(PY) -m mkdocs build --strict -f tools/site/mkdocs.yml

# pictures of the pages that are older than what they show; MuJoCo renders with EGL or, by MUJOCO_GL=osmesa, without
gallery: $(READY)
	$(PY) tools/gallery.py

format: $(READY)
	$(PY) -m ruff check --fix .
	$(PY) -m ruff format .

env: $(READY)

# a virtual environment that works is updated in place, a missing or broken one is made again
$(READY): pyproject.toml constraints.txt
	$(PY) -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV)
	$(PY) -m pip install -c constraints.txt -e '.[dev]'
	touch $@

# wheel and source archive in dist/, checked where nothing but the core is installed; what differs from the checkout's
# version, or needs more than the core, fails here
release: $(READY)
	rm -rf dist && $(PY) -m hatchling build
	$(PYTHON) -m venv --clear .venv-release
	.venv-release/bin/python -m pip install -q -c constraints.txt dist/*.whl
	cd dist && ../.venv-release/bin/mrwarp bench --out check --trajectories 4 --samples 3000 --evaluation-samples 0 \
		&& ../.venv-release/bin/mrwarp check check/fit && ../.venv-release/bin/mrwarp fit check/fit --out check/model
	.venv-release/bin/python -m pip install -q --no-deps --force-reinstall dist/*.tar.gz
	cd dist && ../.venv-release/bin/mrwarp device list && ../.venv-release/bin/mrwarp --version \
		| grep -x "mrwarp $$(sed -n 's/^version: //p' ../CITATION.cff)"
	rm -rf dist/check .venv-release
	@ls -l dist; echo "upload with: python -m twine upload dist/*"

# constraints.txt from what is installed, without local version tags; its heading stays
pins: $(READY)
	{ sed -n '/^#/p' constraints.txt; $(PY) -m pip freeze --all --exclude pip --exclude mrwarp | sed 's/+.*//'; } > $(VENV)/pins
	mv $(VENV)/pins constraints.txt

# the environment stays: `rm -rf .venv` to build it again
clean:
	rm -rf build dist .pytest_cache .ruff_cache
	find . -path ./$(VENV) -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +
