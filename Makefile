# Everything runs in a private .venv; needed beforehand: Python >= 3.11 and a Rust toolchain.
PYTHON ?= python3
VENV := .venv
PY := $(VENV)/bin/python
TARGET := $(or $(CARGO_TARGET_DIR),target)
DIST := $(TARGET)/wheels
SITE := $(TARGET)/site
# The checks see the same interpreter as the wheel, so pyo3 is not configured twice.
export PYO3_PYTHON := $(CURDIR)/$(PY)
export MPLBACKEND := Agg

RUST_SOURCES := Cargo.toml Cargo.lock $(shell find crates -name '*.rs' -o -name 'Cargo.toml' -o -path '*/data/*' -type f)
PYTHON_SOURCES := pyproject.toml README.md $(shell find python -name '*.py' -o -name '*.pyi' -o -name 'py.typed' -o -path '*/data/*' -type f)

.PHONY: help demo test test-full format stubs lint features rust-test python-test examples package bench counts counts-store docs rustdoc api api-store release-wheel tools deny fuzz soak sweep compare wheel clean

help:
	@echo 'make demo       seven examples of track, plan and paint; trajectories and plots in out/demo'
	@echo 'make test       every check of CI (heavy ones on seeded subsets)'
	@echo 'make test-full  the same, with the heavy checks on all their samples'
	@echo 'make features   the core with each feature alone and with none'
	@echo 'make bench      criterion benchmarks, then comparisons with other libraries'
	@echo 'make counts     instruction counts of the kernels, compared with stored ones (needs valgrind)'
	@echo 'make docs       the documentation site in target/site, the Rust documentation in target/doc'
	@echo 'make api        what has changed in the public Rust API since the stored listing'
	@echo 'make wheel      build the package and install it in .venv'
	@echo 'make release-wheel  a manylinux wheel and the source distribution, tested in empty environments'
	@echo 'make tools      install cargo-deny, cargo-fuzz and cargo-hack'
	@echo 'make fuzz       readers and numeric entry points with cargo-fuzz (FUZZ_SECONDS=60 each, resumable)'
	@echo 'make soak       readers and numeric entry points on mutated inputs (SOAK_SECONDS=60 each)'
	@echo 'make sweep      random poses for every arm, with counts of misses (resumable)'
	@echo 'make compare    the public benchmark against other libraries'
	@echo 'make stubs      copy the docstrings of the built module into python/redundancy/_core.pyi'
	@echo 'make format     rewrite the sources in the house format'
	@echo 'make clean      remove everything that was built'

# --- set-up -----------------------------------------------------------------------------------------------
# requirements(EXTRAS): the build system and what those extras name, without the package itself.
define requirements
$(PY) -c 'import sys, tomllib; t = tomllib.load(open("pyproject.toml", "rb")); e = t["project"]; \
print(*t["build-system"]["requires"], *e["dependencies"], \
*(r for x in sys.argv[1:] for r in e["optional-dependencies"][x]), sep="\n")' $(1)
endef

$(VENV)/.created:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed, $(PYTHON) is " + sys.version.split()[0])'
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/.demo: $(VENV)/.created pyproject.toml
	$(call requirements,cli) > $(VENV)/demo.txt
	$(PY) -m pip install --quiet -r $(VENV)/demo.txt
	@touch $@

$(VENV)/.dev: $(VENV)/.demo
	$(call requirements,cli dev) > $(VENV)/dev.txt
	$(PY) -m pip install --quiet -r $(VENV)/dev.txt
	@touch $@

$(VENV)/.bench: $(VENV)/.dev
	$(call requirements,cli dev bench) > $(VENV)/bench.txt
	$(PY) -m pip install --quiet -r $(VENV)/bench.txt
	@touch $@

$(VENV)/.docs: $(VENV)/.demo
	$(call requirements,cli docs) > $(VENV)/docs.txt
	$(PY) -m pip install --quiet -r $(VENV)/docs.txt
	@touch $@

$(VENV)/.wheel: $(VENV)/.demo $(RUST_SOURCES) $(PYTHON_SOURCES)
	rm -rf $(DIST)
	$(PY) -m maturin build --release --locked --interpreter $(PYO3_PYTHON) --out $(DIST)
	$(PY) -m pip install --quiet --no-deps --force-reinstall $(DIST)/*.whl
	@touch $@

wheel: $(VENV)/.wheel

# --- what a user sees first -------------------------------------------------------------------------------
demo: $(VENV)/.wheel
	$(VENV)/bin/redundancy demo --out out/demo

# --- checks -----------------------------------------------------------------------------------------------
test: lint deny features rust-test python-test examples package

test-full:
	REDUNDANCY_TEST_FULL=1 $(MAKE) test
	$(MAKE) sweep

format: $(VENV)/.dev
	cargo fmt --all
	$(PY) -m ruff format .
	$(PY) -m ruff check --fix .

# The `///` comments of crates/redundancy-py are the docstrings; the stub repeats them for editors.
stubs: $(VENV)/.dev $(VENV)/.wheel
	$(PY) tools/stubs.py
	$(PY) -m ruff format python/redundancy/_core.pyi

lint: $(VENV)/.dev
	cargo fmt --all --check
	$(PY) -m ruff format --check .
	$(PY) -m ruff check .
	$(PY) -m mypy
	cargo clippy --workspace --all-targets --locked -- -D warnings
	RUSTDOCFLAGS='-D warnings' cargo doc --workspace --no-deps --locked

# Without features a user of `SrsArm::solve` builds this many packages, the core and its own beside them.
PACKAGES_WITHOUT_FEATURES := 28
features:
	@set -e; for f in '' urdf io parallel plan mesh; do echo "== core with features '$$f'"; \
		cargo check --quiet --locked -p redundancy-core --no-default-features --features "$$f"; done
	@n=$$(cargo tree --locked -p redundancy-core --no-default-features -e normal,build --prefix none --no-dedupe \
		| sort -u | grep -vc '^redundancy-core'); echo "$$n packages without features"; \
		test $$n -le $(PACKAGES_WITHOUT_FEATURES)

# `cargo test` builds and runs unit, integration and documentation tests and builds the examples. The benches run
# once each, unmeasured, in the profile of the tests: what `cargo bench -- --test` does, without another build.
rust-test: $(VENV)/.dev
	cargo test --locked
	cargo test --locked --benches

python-test: $(VENV)/.dev $(VENV)/.wheel
	$(PY) tools/stubs.py --check
	$(PY) -m mypy.stubtest --allowlist tests/python/stubtest.allow redundancy._core
	$(PY) -m pytest -rs

examples: $(VENV)/.dev $(VENV)/.wheel rust-test
	@set -e; for f in $(wildcard examples/rust/*.rs); do \
		echo "== $$f"; cargo run --quiet --locked --profile test --example $$(basename $$f .rs); done
	@set -e; for f in $(wildcard examples/python/*.py); do echo "== $$f"; $(PY) $$f; done

# A wheel and a source distribution, each installed into an empty environment with nothing but numpy.
package: $(VENV)/.dev $(VENV)/.wheel
	$(PY) -m maturin sdist --out $(DIST)
	CARGO_TARGET_DIR=$(abspath $(TARGET)) $(PY) tests/clean_install.py $(DIST)

# A wheel for every Linux since glibc 2.17, with zig as linker, and the source distribution; both are installed into empty
# environments, where the Python tests run.
RELEASE := $(TARGET)/release-dist
release-wheel: $(VENV)/.dev
	$(PY) -m pip install --quiet ziglang
	rm -rf $(RELEASE)
	PATH=$(abspath $(VENV)/bin):$$PATH $(PY) -m maturin build --release --locked --zig --compatibility manylinux_2_17 \
		--interpreter $(PYO3_PYTHON) --out $(RELEASE)
	$(PY) -m maturin sdist --out $(RELEASE)
	$(PY) tests/clean_install.py --tests $(RELEASE)

# What cargo itself does not bring; each is skipped where it is missing.
tools:
	@for tool in cargo-deny cargo-fuzz cargo-hack; do \
		command -v $$tool >/dev/null || cargo install --locked $$tool || echo "not installed: $$tool"; done

# Licences, sources and doubles of the dependency tree; no network.
deny:
	@if command -v cargo-deny >/dev/null; then cargo deny --offline check bans licenses sources; \
	else echo 'cargo-deny is not installed, licences and sources are not checked: make tools'; fi

# --- random inputs ----------------------------------------------------------------------------------------
# Readers and numeric entry points on mutated inputs, SOAK_SECONDS for each; another SEED gives other inputs.
# The same properties with cargo-fuzz and a stable compiler, FUZZ_SECONDS for each target; what has reached something new is kept
# in fuzz/work. FUZZ='--readers 1000000 --numeric 100000000' goes on until that many executions are done.
FUZZ_SECONDS ?= 60
FUZZ ?=
fuzz:
	$(PYTHON) tools/fuzz.py --seconds $(FUZZ_SECONDS) $(FUZZ)

SOAK_SECONDS ?= 60
SEED ?= 1
soak:
	cd fuzz && cargo run --release --example soak -- $(SOAK_SECONDS) $(SEED)

# --- measuring --------------------------------------------------------------------------------------------
bench: $(VENV)/.bench $(VENV)/.wheel
	cargo bench --locked
	@set -e; for f in $(wildcard benches/python/*.py); do echo "== $$f"; $(PY) $$f; done

# Random poses of every arm of the catalogue: 10^7 for a closed form, 10^6 for the numeric solver. Resumable.
sweep: $(VENV)/.dev $(VENV)/.wheel
	$(PY) tools/sweep.py --state $(TARGET)/sweep.json

# The public benchmark: each neighbour in an environment of its own, ours beside it in the same process.
compare: $(VENV)/.dev $(VENV)/.wheel
	$(PY) benches/compare/run.py --wheels $(DIST) --environments $(TARGET)/compare --page docs/benchmark.md

# A change of 3 % is seen on a busy machine; stored in benches/counts.json.
counts:
	$(PYTHON) benches/counts.py

# The public names and signatures of the crate, beside those of the last release.
api: $(VENV)/.created rustdoc
	$(PY) tools/public_api.py $(TARGET)/doc/redundancy_core

api-store: $(VENV)/.created rustdoc
	$(PY) tools/public_api.py $(TARGET)/doc/redundancy_core --store

counts-store:
	$(PYTHON) benches/counts.py --store

# Executes the Python blocks of every page, so it takes minutes; the links are checked without network.
docs: $(VENV)/.docs $(VENV)/.wheel rustdoc
	rm -rf $(SITE)
	$(PY) -W ignore -m sphinx -W --keep-going -q -j auto -b html -d $(TARGET)/doctrees docs $(SITE)
	$(PY) tools/check_site.py $(SITE)
	@echo "written: $(SITE)/index.html and $(TARGET)/doc/redundancy_core/index.html"

rustdoc:
	RUSTDOCFLAGS='-D warnings --html-in-header $(CURDIR)/crates/redundancy-core/katex-header.html' cargo doc --workspace --no-deps --locked

clean:
	rm -rf $(VENV) $(TARGET) out .mypy_cache .ruff_cache .pytest_cache
