SHELL := /bin/sh
.DEFAULT_GOAL := help

VENV := .venv
BIN ?= $(VENV)/bin
# A version manager may offer python3.11 and refuse to start it: ask it to run.
PYTHON ?= $(shell if python3.11 -c '' >/dev/null 2>&1; then echo python3.11; else echo python3; fi)
WORKERS ?= auto
ARGS ?=

# A folder of tests, or a file.
PART ?=

# A file's tests share what they ran; tests/conftest.py orders the files.
PYTEST = $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder
FAST = $(PYTEST) -m 'not slow and not render and not apart' $(ARGS)
# Where `make test-report` looks for results; a run with ARGS or of a file is not a whole part.
STORED = $(if $(ARGS)$(filter %.py,$(PART)),,--junitxml=build/tests/$(1).xml)

# What numbers come from, and what compares them as text or to the bit.
COMPUTING := theory mechanics simulation experiments/assumptions experiments/requirements studies/margins export
# The file says what it emulates, and how.
OLDER := nehalem haswell
AS := $(BIN)/python tools/emulated_machine.py

GALLERY := renders/films/gallery

# Films need these; nothing else does.
FILM_PACKAGES := libegl1 libgl1-mesa-dri ffmpeg
# Tests of exported laws need these beside gcc; they are left out without.
TEST_PACKAGES := clang gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm

INSTALLED := $(VENV)/.installed
SYSTEM := $(VENV)/.system
SECOND_COMPILER := $(VENV)/.second_compiler
# Python compiles a module when it is first imported: most of these never are. It keeps what it has
# compiled, else every start would take three times as long. A container may tell it not to, and
# keep a user's runs from it: so the set-up makes the first run (below).
unexport PYTHONDONTWRITEBYTECODE
PIP_INSTALL := PIP_DISABLE_PIP_VERSION_CHECK=1 $(BIN)/python -m pip install -qq --no-compile

.PHONY: help setup validate record test test-apart test-all test-report test-fast hostile portable $(OLDER:%=portable-%) portable-fast mutate lint format typecheck bench gallery results rivals tolerance ladder page docs clean

help:  ## List the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-14s  %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))
	@echo 'Variables: ARGS (more arguments), PART (tests of one folder), PYTHON (interpreter), WORKERS (test processes)'

setup:  ## Create .venv with the pinned packages; install the system packages for films and tests
	@rm -f $(SYSTEM) $(SECOND_COMPILER)
	@$(MAKE) -s $(INSTALLED) $(SYSTEM) $(SECOND_COMPILER)

validate: $(INSTALLED) $(SYSTEM)  ## Check every claim against physics; a film of each case, and a page of it all
	$(BIN)/grosmc-mj validate --films --report $(ARGS)

record: $(INSTALLED) $(SYSTEM)  ## Regenerate the expected results; review the diff
	$(BIN)/grosmc-mj validate --record $(ARGS)

test: $(INSTALLED) $(SYSTEM) $(SECOND_COMPILER)  ## Run the tests, over all cores; PART=tests/theory runs one folder
	$(PYTEST) -m 'not apart' $(call STORED,$(or $(subst /,-,$(PART)),all)) $(PART) $(ARGS)

test-apart: $(INSTALLED) $(SYSTEM)  ## Run the rest: browser, Dask, mutated input, an older machine
	$(PYTEST) -m apart $(call STORED,apart) $(shell grep -rl --include='test_*.py' mark.apart tests) $(ARGS)
	$(MAKE) portable-fast

test-all: test test-apart  ## Run every test

test-report: $(INSTALLED)  ## Put the stored results of all parts together; fail if one failed or is missing
	@$(BIN)/python tools/report.py

test-fast: $(INSTALLED)  ## Run the tests that are neither slow nor render
	$(FAST)

hostile: $(INSTALLED)  ## Five times as many mutated files, models and command lines
	HOSTILE=5 $(PYTEST) tests/hostile $(ARGS)

portable: $(OLDER:%=portable-%)  ## Fast tests and validate as on other machines than this one
	$(AS) other-libraries $(FAST)

$(OLDER:%=portable-%): portable-%: $(INSTALLED)
	$(AS) $* $(FAST)
	$(AS) $* $(BIN)/grosmc-mj validate --no-figures --out build/portable/$*

portable-fast: $(INSTALLED)  ## The fast tests of what computes, with another machine's libraries
	$(AS) other-libraries $(FAST) $(call STORED,portable) $(COMPUTING:%=tests/%)

mutate: $(INSTALLED)  ## Put faults in and count those that tests notice; under ten minutes, the next call goes on
	$(BIN)/python tools/mutants.py $(ARGS)

lint: $(INSTALLED)  ## Check style, format and the direction of imports
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

format: $(INSTALLED)  ## Apply the formatter and the linter's safe fixes
	$(BIN)/ruff check --fix-only .
	$(BIN)/ruff format .

typecheck: $(INSTALLED)  ## Check the types
	$(BIN)/pyright --pythonpath $(BIN)/python

bench: $(INSTALLED)  ## Measure throughput against MuJoCo's open loop
	$(BIN)/python -m benchmarks $(ARGS)

gallery: $(INSTALLED) $(SYSTEM)  ## Make the films that the README shows
	for film in 'servo --from 8.5 --to 15.5' 'cart_pendulum --to 4' 'arm --to 4.5' 'two_link_arm --to 4'; do \
	  $(BIN)/grosmc-mj film $$film --size 600x400 --fps 10 --gif -o $(GALLERY)/$${film%% *}.mp4 || exit; \
	done
	for system in servo cart_pendulum arm two_link_arm; do \
	  mv $(GALLERY)/$$system.gif renders/gallery/$${system}_case1.gif; \
	done
	$(BIN)/grosmc-mj film cart_pendulum --laws grosmc cart-pfl --switching implicit --surface discrete \
	  --camera wide --duration 7 --size 600x400 --fps 8 --gif -o $(GALLERY)/hold.mp4
	mv $(GALLERY)/hold.gif renders/gallery/cart_pendulum_hold.gif
	$(BIN)/grosmc-mj film cart_pendulum/bench --laws sign implicit 'implicit, predicted' \
	  --to 3 --size 960x400 --fps 8 --gif -o $(GALLERY)/bench.mp4
	mv $(GALLERY)/bench.gif renders/gallery/cart_pendulum_bench.gif
	$(BIN)/grosmc-mj study ladder cart_pendulum --laws super-twisting --film super-twisting --gif --out $(GALLERY)
	mv $(GALLERY)/ladder_cart_pendulum_machine_film.gif renders/gallery/cart_pendulum_ladder.gif

results: $(INSTALLED)  ## Write the table of results from renders/validation.json anew
	$(BIN)/python -m grosmc_mj.cli.pages results docs/results.md renders/validation.json

rivals: $(INSTALLED)  ## Write the table of docs/rivals.md anew
	$(BIN)/python -m grosmc_mj.cli.pages rivals docs/rivals.md

# Exit code 1 of a study: a law keeps nothing.
BENCHES := servo cart_pendulum arm

tolerance: $(INSTALLED)  ## Find the largest imperfections of each bench, and write the tables of docs/tolerance.md anew
	$(foreach bench,$(BENCHES),{ $(BIN)/grosmc-mj study tolerance $(bench) --rivals --resume || test $$? = 1; } &&) true
	$(BIN)/python -m grosmc_mj.cli.pages tolerances docs/tolerance.md $(BENCHES:%=renders/tolerance_%_bench.json)
	cp renders/tolerance_cart_pendulum_bench.png docs/figures/tolerance_cart_pendulum.png

MACHINES := servo cart_pendulum arm two_link_arm
TUNED := servo arm
TUNED_LAWS := lqr lqi fl-pid adrc sign implicit boundary-layer super-twisting 'grosmc adaptive'
LADDERS := $(MACHINES:%=renders/ladder_%_machine.json) $(TUNED:%=renders/ladder_%_tuned.json)

ladder: $(INSTALLED)  ## Find where each law fails on each machine, and write docs/ladder_tables.md anew
	$(foreach machine,$(MACHINES),{ $(BIN)/grosmc-mj study ladder $(machine) --rivals --loaded --resume || test $$? = 1; } &&) true
	$(BIN)/grosmc-mj study ladder jaco/machine --laws lqr implicit "implicit, predicted" --resume || test $$? = 1
	$(foreach machine,$(TUNED),{ $(BIN)/grosmc-mj study ladder $(machine)/tuned --laws $(TUNED_LAWS) --resume || test $$? = 1; } &&) true
	$(BIN)/python -m grosmc_mj.cli.pages ladders docs/ladder_tables.md $(MACHINES:%=renders/ladder_%_machine.json) renders/ladder_jaco_machine.json
	$(BIN)/python -m grosmc_mj.cli.pages failures docs/ladder.md $(LADDERS)
	$(BIN)/python -m grosmc_mj.cli.pages "few failures" README.md $(LADDERS)
	for machine in servo cart_pendulum; do cp renders/ladder_$${machine}_machine.png docs/figures/ladder_$$machine.png || exit; done

page: $(INSTALLED)  ## Write docs/claims.md and its figures anew
	$(BIN)/grosmc-mj claims --page docs/claims.md

docs: $(INSTALLED)  ## Build the documentation's site in build/site, and fail where a link is broken
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict $(ARGS)
	@echo 'build/site/index.html'

clean:  ## Remove .venv, builds and caches; keep renders/
	rm -rf $(VENV) build dist .hypothesis .import_linter_cache .pytest_cache .ruff_cache
	find grosmc_mj tests -name __pycache__ -prune -exec rm -rf {} +

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c '' 2>/dev/null || { \
	  echo "make: cannot run '$(PYTHON)'; name a Python 3.11 or newer with PYTHON=..." >&2; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "make: grosmc_mj needs Python 3.11 or newer, '$(PYTHON)' is $$($(PYTHON) -V 2>&1); name another with PYTHON=..." >&2; exit 2; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "make: '$(PYTHON)' cannot create virtual environments; run: apt-get install python3-venv" >&2; exit 2; }
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || { rm -rf $(VENV) && $(PYTHON) -m venv $(VENV); }
	@echo 'Installing grosmc_mj and its pinned packages in $(VENV)'
	@$(PIP_INSTALL) -c constraints.txt -e '.[dev]'
	@echo 'Compiling what a run needs'
	@$(BIN)/grosmc-mj run cart_pendulum/case1 --out $(VENV)/first_run >$(VENV)/first_run.log 2>&1 || :
	@touch $@

# Install packages by apt if root: $(1) the packages, $(2) what needs them. Never fails: all else works
# without. `make setup` tries again.
define apt
@missing=; \
for package in $(1); do \
  dpkg-query -W -f '$${Status}' $$package 2>/dev/null | grep -q 'ok installed' || missing="$$missing $$package"; \
done; \
if [ -z "$$missing" ]; then :; \
elif [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
  echo "Installing for $(2):$$missing"; \
  export DEBIAN_FRONTEND=noninteractive; \
  { apt-get update -qq && apt-get install -y -qq --no-install-recommends $$missing; } >$(VENV)/apt.log 2>&1 || \
    echo "Could not install$$missing (see $(VENV)/apt.log): $(2) will not work, all else does"; \
else \
  echo "Not installed:$$missing. Needed for $(2), and for nothing else; as root: apt-get install$$missing"; \
fi
@touch $@
endef

$(SYSTEM): | $(INSTALLED)
	$(call apt,$(FILM_PACKAGES),films)

$(SECOND_COMPILER): | $(SYSTEM)
	$(call apt,$(TEST_PACKAGES),tests of exported laws with a second compiler and on processors)
