# make help lists the targets.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PLUGINS := $(dir $(wildcard plugins/*/pyproject.toml))
# Not released: the presses of MULTIS.
EXAMPLE := examples/palpate-multis/
EDITABLE := $(addprefix -e ,$(PLUGINS) $(EXAMPLE))
RUST := $(shell find crates -name '*.rs' -o -name Cargo.toml 2>/dev/null) Cargo.toml
# In a terminal pip shows that it works.
QUIET := $(if $(MAKE_TERMOUT),,--quiet)
PYTEST_SET := -m "not slow and not browser and not packaging"
PYPROJECTS := pyproject.toml $(addsuffix pyproject.toml,$(PLUGINS) $(EXAMPLE))

.DEFAULT_GOAL := help
.PHONY: coverage coverage-fe help demo test test-all test-rust test-python dist docs pictures chaos lint lint-python lint-stub lint-rust format hooks relaxation bench bench-core bench-executors bench-fit bench-logs bench-ledger bench-next bench-search bench-solver bench-sparse clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

$(VENV)/installed: $(RUST) $(PYPROJECTS)
	@command -v cargo >/dev/null || { echo "cargo is missing: install Rust first"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "CPython 3.11 or newer is needed: make PYTHON=python3.11"; exit 1; }
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install $(QUIET) --upgrade "pip>=25.1"
	$(BIN)/python -m pip install $(QUIET) --group dev
# A distribution whose folder has gone would be listed as a broken plugin.
	$(BIN)/python -m pip list --editable | tail -n +3 | while read name version folder; do test -f "$$folder/pyproject.toml" || $(BIN)/python -m pip uninstall $(QUIET) --yes "$$name"; done
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python -m pip install $(QUIET) --no-build-isolation -e . $(EDITABLE)
	touch $@

demo: $(VENV)/installed ## identify the stiffness of a simulated forearm, end to end
	test -d runs/demo || $(BIN)/palpate init runs/demo
	$(BIN)/palpate run runs/demo --out runs/first-press

# Rust next to Python, whose lint uses one core.
test: $(VENV)/installed ## what decides a merge: lint, types, Rust tests and the fast Python tests
	$(MAKE) -j2 test-rust test-python

# Packages first: clippy has the build script of PyO3 run again, and what depends on it built again.
test-all: dist lint-stub ## everything: slow tests, new random examples, packages and the site too
	$(MAKE) -j2 test-rust test-python PYTEST_SET="--hypothesis-profile all"

test-rust: lint-rust
	cargo nextest run --workspace --release || { command -v cargo-nextest >/dev/null && exit 1 || cargo test --workspace --release; }
	cargo test --workspace --release --doc

test-python: lint-python
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -q -n auto --maxprocesses 4 --dist worksteal --cpu-times $(PYTEST_SET)

# The wheel is not built from the source distribution: cargo would take its files, dated 2006, for unchanged.
dist: $(VENV)/installed ## wheels and source distributions of every package, in dist/
	rm -rf dist
	$(BIN)/maturin sdist --out dist
	$(BIN)/maturin build --release --locked --interpreter $(BIN)/python --out dist
	set -e; for folder in $(PLUGINS); do (cd $$folder && $(CURDIR)/$(BIN)/hatchling build --directory $(CURDIR)/dist >/dev/null); done

docs: $(VENV)/installed ## the site in target/docs, with a gallery of studies that are run here
	$(BIN)/python docs/site/gallery.py
	$(BIN)/mkdocs build --strict --quiet --config-file docs/site/mkdocs.yml

pictures: $(VENV)/installed ## the pictures of the guides, from runs in target/gallery
	$(BIN)/python docs/site/pictures.py

chaos: $(VENV)/installed ## kill runs 200 times at random and at every write, and count what was lost
	OMP_NUM_THREADS=1 $(BIN)/python tests/chaos/kills.py --random 200 --workers 20

lint: lint-python lint-stub lint-rust ## ruff, mypy --strict, imports, dead code, clippy pedantic, rustfmt

lint-python: $(VENV)/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	$(BIN)/vulture python plugins
	$(BIN)/python tests/unused_exports.py

lint-stub: $(VENV)/installed
	$(BIN)/stubtest palpate._core --concise

lint-rust: $(VENV)/installed
	cargo fmt --check
	cargo clippy --workspace --all-targets --release -- -D warnings

format: $(VENV)/installed ## rewrite the sources in the project's format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	cargo fmt

hooks: $(VENV)/installed ## write the reference for plugins
	$(BIN)/python docs/site/hook_reference.py

bench: $(VENV)/installed ## timings, each with a peer of the same run
	$(BIN)/python benchmarks/bench_scoring.py
	$(BIN)/python benchmarks/bench_elements.py
	@echo "more: make coverage, bench-core, bench-executors, bench-fit, bench-logs, bench-ledger, bench-next, bench-search, bench-solver, bench-sparse"

coverage: $(VENV)/installed ## how often 95 % intervals hold the truth, with other errors than the budget's, and what checks see
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/bench_wrong.py
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/bench_wrong.py --presses 4 --n 40 --studies ogden yeoh --errors 1 2 3

# Some hours the first time: it simulates on meshes of 23,000 nodes. What is in the folder is not simulated again.
coverage-fe: $(VENV)/installed ## the same by finite elements, and models that do not describe the data
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/bench_coverage_fe.py runs/coverage-fe
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/bench_inadequate.py

relaxation: $(VENV)/installed ## how often relaxation is flagged in robot logs, and what it does to intervals
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/bench_relaxation.py
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/study_relaxation.py

bench-core: $(VENV)/installed ## the core's kernels with their peers, and their instruction counts
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/bench_core.py
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/bench_core_sampling.py
	cargo bench -p palpate-core --bench instructions

bench-executors: $(VENV)/installed ## what executors add to each job, and how many workers are fed
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/bench_executors.py

bench-fit: $(VENV)/installed ## fits by finite elements: runs, time and errors
	$(BIN)/python benchmarks/bench_fit.py

bench-ledger: $(VENV)/installed ## the ledger and Optuna's storages: cost of a result, opening and resuming 100,000 rows
	$(BIN)/python -m pip install --quiet --group bench
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/bench_ledger.py

bench-logs: $(VENV)/installed ## a robot's log of a million rows, read and processed, with polars and NumPy as peers
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/bench_reading.py
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/bench_robot_log.py

bench-next: $(VENV)/installed ## what chosen presses are worth, over 50 simulated sessions
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/bench_next.py

bench-search: $(VENV)/installed ## how many simulations a search needs, with CMA-ES and SciPy's differential evolution
	$(BIN)/python -m pip install --quiet --group bench
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/bench_search.py

bench-solver: $(VENV)/installed ## whole simulations: by size, many sets together, with derivatives
	$(BIN)/python benchmarks/bench_solver.py

bench-sparse: $(VENV)/installed ## factors of real tangents, with CHOLMOD's and SuperLU's
	$(BIN)/python benchmarks/bench_sparse.py

clean: ## remove what the build made
	rm -rf $(VENV) target runs dist
