# Two commands for a fresh machine: `make demo` and `make test`. Both say what they install.

CARGO ?= cargo
PYTHON ?= python3
VENV := target/venv
OUT ?= loden-demo
PAGE := crates/loden-studio/page

# One set of flags and packages for every build keeps the dependencies from being compiled twice.
FLAGS := --release --locked
PACKAGES := -p loden -p loden-cli -p loden-py -p loden-studio

.PHONY: demo test test-interop build lint unit peers measured chromium wheel python page site dist package features bench gallery screenshots fuzz clean

demo: build
	target/release/loden demo --out $(OUT)

build: page
	@echo "== building the program (release)"
	$(CARGO) build $(FLAGS)

test: page lint unit peers python
	@echo "== all checks passed"

lint:
	@echo "== format, lints, dependencies, documentation"
	$(CARGO) fmt --all --check
	$(CARGO) clippy $(FLAGS) $(PACKAGES) -p loden-fuzz --all-targets -- -D warnings
	$(CARGO) clippy --release --locked -p loden --no-default-features -- -D warnings
	$(PYTHON) tests/dependencies.py
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc $(FLAGS) $(PACKAGES) --no-deps --document-private-items

# The packaged crates, installed in an empty folder as a user would; needs neither Python nor the repository.
package: page
	$(CARGO) package --locked --no-verify --allow-dirty -p loden -p loden-cli -p loden-studio
	folder=$$(mktemp -d) && trap 'rm -rf "$$folder"' EXIT && for crate in target/package/*.crate; do tar -xzf $$crate -C $$folder; done && \
	cd $$folder && $(CARGO) install --locked --quiet --path loden-cli-[0-9]* --root . --config "patch.crates-io.loden.path='$$(echo $$folder/loden-[0-9]*)'" --config "patch.crates-io.loden-studio.path='$$(echo $$folder/loden-studio-[0-9]*)'" && \
	env -i PATH=/usr/bin:/bin bin/loden acquire twill --size 8 --spp 1 -o twill.zip && env -i PATH=/usr/bin:/bin bin/loden info twill.zip

# The library with each of its features alone. `make test` checks all of them together, and none.
features:
	for feature in $$(sed -n '/^\[features\]/,/^\[dep/s/^\([a-z-]*\) = .*/\1/p' crates/loden/Cargo.toml); do \
	  echo "== $$feature"; \
	  $(CARGO) clippy --release --locked -p loden --no-default-features --features $$feature -- -D warnings || exit 1; \
	done

# Tests that need the reference measurements are counted as ignored where LODEN_DATA does not name them.
unit:
	@echo "== unit, property, physics, golden and command-line tests"
	$(CARGO) test $(FLAGS) $(PACKAGES) $(if $(LODEN_DATA),-- --include-ignored)
	@echo "== a program outside the workspace, with a codec and a material of its own"
	$(CARGO) run --locked --manifest-path tests/outside/Cargo.toml --target-dir target -- crates/loden/tests/data/pvmf-f16.loden

# Comparisons with NumPy, Mitsuba 3 and, if there is a Chromium, with shaders and pages in a browser.
peers: page $(VENV)/ready target/three/ready chromium
	@echo "== comparisons with independent programs"
	$(CARGO) build $(FLAGS) $(PACKAGES) --bins --examples
	$(VENV)/bin/python tests/python/run.py

# What `make test` leaves out where LODEN_DATA does not name the reference measurements. Run it after `make test`.
measured: page $(VENV)/ready
	@echo "== tests and comparisons with the reference measurements"
	$(CARGO) test $(FLAGS) $(PACKAGES) -- --ignored
	$(VENV)/bin/python tests/python/run.py --data

# Without a Chromium, comparisons in a browser are skipped and counted.
chromium:
	@if ! $(PYTHON) tests/python/browser.py && [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	  echo "== installing Debian's Chromium"; \
	  export DEBIAN_FRONTEND=noninteractive; install="apt-get install -y -qq --no-install-recommends chromium"; \
	  ($$install || (apt-get update -qq && $$install)) >/dev/null || echo "Chromium could not be installed"; \
	fi

# Comparisons with programs that are too large for every run. Blender comes as a package for Python 3.11 only.
BPY_PYTHON ?= python3.11
test-interop: build $(VENV)/ready target/three/ready chromium target/bpy/ready
	@echo "== comparisons of every codec in a browser, and with Blender"
	$(VENV)/bin/python tests/python/shaders_vs_loden.py --all
	target/bpy/bin/python tests/python/interop_osl.py

target/bpy/ready:
	@echo "== installing Blender as a Python package into target/bpy: a download of 374 MB, 970 MB on disk"
	$(BPY_PYTHON) -m venv target/bpy
	target/bpy/bin/python -m pip install --quiet --disable-pip-version-check bpy==5.0.1
	touch $@

# The package for Python, as a wheel.
wheel: $(VENV)/ready
	@echo "== building the Python package into target/wheels"
	rm -rf target/wheels
	$(VENV)/bin/python -m maturin build $(FLAGS) --quiet --manifest-path crates/loden-py/Cargo.toml --out target/wheels

python: wheel
	@echo "== tests of the Python package"
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps target/wheels/*.whl
	$(VENV)/bin/python -m pytest --quiet crates/loden-py/tests
	cd crates/loden-py/tests && ../../../$(VENV)/bin/python -m mypy --strict types_of_users.py test_make.py
	$(VENV)/bin/python -m mypy.stubtest loden --ignore-missing-stub
	@echo "== commands and snippets of the guide"
	$(VENV)/bin/python docs/site/run_guide.py target/release

# The documentation as a site that works without a network, in target/site.
site: build wheel
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -r docs/site/requirements.txt
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps target/wheels/*.whl
	$(VENV)/bin/python docs/site/make.py target/release/loden

# An archive of the program, manual pages, completions and licences, in target/dist.
dist: build
	$(PYTHON) tests/dist.py target/release/loden

$(VENV)/ready: tests/python/requirements.txt
	@echo "== installing NumPy, Pillow, Mitsuba 3 and tools for Python packages into $(VENV)"
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -r tests/python/requirements.txt
	touch $@

# Without npm, the comparison with three.js is skipped and counted.
target/three/ready: tests/three/package-lock.json
	@echo "== installing three.js into target/three"
	mkdir -p target/three
	cp tests/three/package.json tests/three/package-lock.json target/three
	if command -v npm >/dev/null; then npm ci --prefix target/three --no-audit --no-fund; fi
	touch $@

# The page of the studio, which becomes part of the program. Without npm, the page says that it is missing.
page: $(PAGE)/dist/index.html

$(PAGE)/dist/index.html: $(PAGE)/node_modules/ready $(PAGE)/index.html $(PAGE)/vite.config.js $(shell find $(PAGE)/src -type f)
	@echo "== building the page of the studio"
	if command -v npm >/dev/null; then cd $(PAGE) && npm run --silent check && npm run --silent build -- --logLevel warn; fi
	if [ -f $@ ]; then touch $@; fi

$(PAGE)/node_modules/ready: $(PAGE)/package-lock.json
	@echo "== installing what the page of the studio is built with into $(PAGE)/node_modules"
	mkdir -p $(PAGE)/node_modules
	if command -v npm >/dev/null; then npm ci --prefix $(PAGE) --no-audit --no-fund; fi
	touch $@

# Our times beside the peers', as ratios of one run; see docs/benchmarks.md.
bench: build $(VENV)/ready
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -r benches/requirements.txt
	$(VENV)/bin/python benches/run.py

# The pictures of docs/gallery, from samples that are measured on the way.
gallery: build $(VENV)/ready
	$(VENV)/bin/python docs/gallery/make.py

# The pictures of docs/studio.md: every panel in three sizes of the window, light and dark. Needs a Chromium.
screenshots: build $(VENV)/ready
	$(VENV)/bin/python docs/images/studio.py

# Ten minutes a target by default; needs `cargo install cargo-fuzz`. No sanitizer, so the stable compiler will do
# if it is allowed the flags of instrumentation.
FUZZ_SECONDS ?= 600
fuzz: build
	$(PYTHON) fuzz/seeds.py
	for target in $(basename $(notdir $(wildcard fuzz/src/bin/*.rs))); do \
	  RUSTC_BOOTSTRAP=1 $(CARGO) fuzz run --sanitizer none --features link $$target -- -max_total_time=$(FUZZ_SECONDS) -rss_limit_mb=2048 || exit 1; \
	done

clean:
	$(CARGO) clean
