# The one list of verbs, for people and for CI.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STUDY := studies/mace-1993.toml
# docs/decisions/0004-one-blas-thread.md; before any plugin of pytest imports numpy.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
# Else every process of the tests would compile the package and the asserts anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: install study pictures test test-all suite kernels check docs bench lock clean

install: $(VENV)/run.stamp  ## the environment alone, .venv

study: $(VENV)/run.stamp  ## the paper: out/mace-1993/report.html
	$(BIN)/middeck study $(STUDY) -o out/mace-1993

pictures: $(VENV)/run.stamp  ## docs/images/*.svg, the pictures of the pages
	$(BIN)/python docs/pictures.py

test: $(VENV)/dev.stamp  ## lint, types, import contract beside tests and docs examples
	$(MAKE) -j2 check suite

test-all: export MIDDECK_LONG = 1  ## the same with every long campaign whole; each file has its row in tests/results.json
test-all: test

# Rewriting the assertions of a fresh checkout takes each worker as long as importing all; locals are shown instead.
suite: export PYTHONDONTWRITEBYTECODE =
suite: $(VENV)/dev.stamp  ## three workers for two cores: one of them often waits for an engine
	$(BIN)/python -m compileall -q src tests  # once: the workers would each compile all, at the same time
	$(BIN)/python -m pytest -rs -n 3 --dist loadfile --no-loadscope-reorder --assert=plain --showlocals

kernels: $(VENV)/dev.stamp  ## marked tests and the study as other processors compute them, and what differs
	$(BIN)/python .ci/kernels.py -o out/kernels $(KERNELS)

check: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/ty check
	$(BIN)/lint-imports

docs: $(VENV)/dev.stamp  ## docs/_build/html
	$(BIN)/sphinx-build -W -b html docs docs/_build/html

bench: $(VENV)/dev.stamp  ## benchmarks/results/*.json and docs/benchmarks.md
	$(BIN)/python benchmarks/run.py

$(VENV)/run.stamp: requirements.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation -e .
	touch $@

$(VENV)/dev.stamp: requirements-dev.lock $(VENV)/run.stamp
	$(BIN)/python -m pip install --quiet --require-hashes -r requirements-dev.lock
	touch $@

lock:  ## needs uv; writes both locks, hashes and no addresses
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links --no-header --extra build pyproject.toml -o requirements.lock
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links --no-header --all-extras pyproject.toml -o requirements-dev.lock

clean:
	rm -rf $(VENV) out docs/_build
