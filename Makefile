# One word per job; CI runs the same words. Each word does its own set-up in .venv.
PORT ?= 8000
# Each worker of the tests imports and collects all of them for itself.
WORKERS ?= 2
DURATION ?= 0
PYTHON ?= $(shell for p in python3.13 python3.12 python3.11 python3 python; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo $$p; break; }; done)
BIN := .venv/bin
# As the command does: small matrices, and sums that do not depend on the machine.
export OPENBLAS_NUM_THREADS ?= 1
# Processes are started by the dozen under test: each module is compiled once.
unexport PYTHONDONTWRITEBYTECODE
# Not --quiet: a first installation takes a minute or more, and says what it is at.
PIP_INSTALL := $(BIN)/python -m pip --disable-pip-version-check install --progress-bar on -c constraints.txt

.PHONY: demo test test-long test-times test-slow blind blind-pairs blind-outside blind-excitations blind-slow peers peers-torch faults load mutation lint check bench tutorials site notebooks release extras gallery surrogates real figures pictures clean help

help:  ## this list
	@grep -E '^[a-z-]+:.*##' Makefile | sed -E 's/:.*## /\t/' | expand -t 14

demo: .venv/run  ## router, edges, twin and page on http://127.0.0.1:$(PORT); DURATION=0 until Ctrl-C
	@$(BIN)/slowtime demo --port $(PORT) --duration $(DURATION)

test: .venv/dev  ## the default suite, some minutes on two cores; WORKERS=2
	$(BIN)/python -m pytest -q -n $(WORKERS) --dist loadfile --no-loadscope-reorder -m "not slow and not long"

test-long: .venv/dev  ## longer tests: whole flows, pages and searches
	$(BIN)/python -m pytest -q -n $(WORKERS) --dist loadfile --no-loadscope-reorder -m "long and not slow"

test-times: .venv/dev  ## measure tests, and move those of more than 1 s to the longer ones
	: > tests/long_tests.txt
	$(BIN)/python -m pytest -q -m "not slow" -p tests.processor_times

test-slow: .venv/dev  ## tests of hours: statistics over hundreds of runs
	$(BIN)/python -m pytest -q -m slow --hypothesis-profile=default

blind: .venv/dev  ## diagnose and score hundreds of hidden effects; N=300 SEED=1 JOBS=1, PEER=pysindy-weak
	$(BIN)/python -m tests.blind run --cases $(or $(N),300) --seed $(or $(SEED),1) --jobs $(or $(JOBS),1) \
		--out var/blind/$(or $(SEED),1) $(if $(PEER),--peer $(PEER))

blind-pairs: .venv/dev  ## diagnose undecidable pairs, before and after the proposed experiment
	$(BIN)/python -m tests.blind pairs --cases $(or $(N),28) --seed $(or $(SEED),1) --out var/blind/pairs-$(or $(SEED),1)

blind-outside: .venv/dev  ## diagnose laws that are in no list; SEED=1 CASES=64 JOBS=1, goes on where it ended
	$(BIN)/python -m tests.blind.outside --seed $(or $(SEED),1) --cases $(or $(CASES),64) --jobs $(or $(JOBS),1)

blind-excitations: .venv/dev  ## diagnose the same effects by eight excitations; SEED=1 CASES=60 JOBS=1
	$(BIN)/python -m tests.blind.excitations --seed $(or $(SEED),1) --cases $(or $(CASES),60) --jobs $(or $(JOBS),1)

peers: .venv-peers/ready  ## other tools to compare with, in an environment of their own

peers-torch: .venv-peers/ready  ## GPyTorch beside them, for `make bench`: 5 GB
	.venv-peers/bin/python -m pip --disable-pip-version-check --quiet install -c constraints.txt -e '.[peers-torch]'

blind-slow: .venv/dev  ## diagnose and score hundreds of hidden histories; SEED=1 CASES=100
	$(BIN)/python -m tests.slowtime.history_diagnosis.battery --seed $(or $(SEED),1) --cases $(or $(CASES),100)

fuzz: .venv/dev  ## send malformed messages, files and requests; WIRE=1000000 FILES=100000 FORMATS=10000 REST=20000 SEED=1
	$(BIN)/python -m tests.fuzz wire --cases $(or $(WIRE),1000000) --seed $(or $(SEED),1)
	$(BIN)/python -m tests.fuzz files --cases $(or $(FILES),100000) --seed $(or $(SEED),1)
	$(BIN)/python -m tests.fuzz formats --cases $(or $(FORMATS),10000) --seed $(or $(SEED),1)
	$(BIN)/python -m tests.fuzz rest --cases $(or $(REST),20000) --seed $(or $(SEED),1)

audit: .venv/run  ## ask a vulnerability service about every dependency; it needs the internet
	@test -x .venv-audit/bin/pip-audit || { $(BIN)/python -m venv .venv-audit && \
		.venv-audit/bin/python -m pip --disable-pip-version-check --quiet install pip-audit; }
	.venv-audit/bin/pip-audit --requirement constraints.txt --no-deps --disable-pip

lint: .venv/dev  ## format, lint, strict types, import contracts
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

check: lint  ## the same, and docs tests
	$(BIN)/python -m pytest -q -m "not slow and not long" tests/docs

faults: .venv/dev  ## fault-injection tests of real processes; N=200 SEED=1 SECONDS=60 JOBS=4 SHARDS=1 LINK=lab
	$(BIN)/python -m tests.faults --cases $(or $(N),200) --seed $(or $(SEED),1) --seconds $(or $(SECONDS),60) \
		--jobs $(or $(JOBS),4) --shards $(or $(SHARDS),1) --link $(or $(LINK),lab) --out var/faults

mutation: .venv/dev  ## change random lines and report those that no test notices; LINES=200 SEED=1 PACKAGES="slowtime twin_server edge_agent"
	$(BIN)/python -m tests.mutation --lines $(or $(LINES),200) --seed $(or $(SEED),1) \
		--rooms $(or $(PACKAGES),slowtime twin_server edge_agent)

load: .venv/dev  ## ten thousand assets on this machine: loss, latencies, memory; DURATION_S=1800
	$(BIN)/python -m benchmarks.processes.load --seconds $(or $(DURATION_S),1800)

bench: .venv/dev .venv-peers/ready  ## print most figures of speed, memory and accuracy, as ratios
	$(BIN)/python -m benchmarks

tutorials: .venv/dev  ## run each tutorial as written, in an empty folder with the files that it links to; ONLY="first_hour or court"
	$(BIN)/python -m pytest -q -m slow tests/docs/test_tutorials.py -k "$(or $(ONLY),tutorial)"

site: .venv/dev  ## the documentation site in var/site; warnings are errors; NOTEBOOKS=off, URL=https://... of the repository
	rm -rf var/site
	SLOWTIME_URL=$(URL) $(BIN)/python -m sphinx -q -W --keep-going -b html \
		-c docs/site -D nb_execution_mode=$(or $(NOTEBOOKS),cache) docs var/site
	@echo "Open var/site/index.html"

notebooks: .venv/dev  ## run the notebooks, with figures in var/notebooks; ONLY="modal_test live_twin"
	$(BIN)/python docs/notebooks/run.py $(ONLY)

release: .venv/dev  ## build and check wheel, sdist and SBOM of the last commit; a dry run without URL=https://HOST/OWNER/NAME
	$(BIN)/python release/build.py $(if $(URL),--url $(URL))

extras: .venv/dev  ## the wheel with each extra alone: every command answers or names what it needs; ONLY="none twin"
	$(BIN)/python -m release.extras $(if $(ONLY),--only $(ONLY))

gallery: .venv/dev  ## twelve hidden effects from the command line to the report; pictures in docs/gallery
	$(BIN)/python docs/gallery/build.py

surrogates: .venv-peers/ready  ## docs/surrogates.md: surrogates beside chaospy, OpenTURNS and scikit-learn on the same points
	.venv-peers/bin/python -m benchmarks.methods.surrogates --seeds $(or $(SEEDS),3) --write docs/surrogates.md

real: .venv/dev .venv-peers/real  ## docs/real_rigs.md: measured rigs in SLOWTIME_DATA beside other tools; goes on where it ended; ONLY=emps REFRESH=1
	$(BIN)/python -m benchmarks.real_rigs $(if $(ONLY),--only $(ONLY)) $(if $(REFRESH),--refresh)

figures: .venv/dev  ## draw the book's figures into docs/figures
	$(BIN)/python docs/figures/chapter_3.py
	$(BIN)/python docs/figures/chapter_5.py
	$(BIN)/python -m docs.figures.chapter_7
	$(BIN)/python -m docs.figures.chapter_8
	$(BIN)/python -m docs.figures.chapter_9
	$(BIN)/python docs/figures/chapter_6.py

.venv/run: pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "slowtime needs Python 3.11 or newer; none was found. Give one: make PYTHON=/path/to/python3"; exit 2; }
	@test -x $(BIN)/python || { echo "Making a virtual environment in .venv with $(PYTHON) ..."; $(PYTHON) -m venv .venv; }
	@echo "Installing slowtime and what it needs into .venv: about 45 packages, a minute or two, this once ..."
	@$(PIP_INSTALL) -e '.[all]' && touch $@
	@echo "Installed. \`$(BIN)/slowtime --help\` lists the commands."

.venv/dev: .venv/run
	@echo "Installing the development tools into .venv: about 75 packages more, this once ..."
	@$(PIP_INSTALL) -e '.[dev]' && touch $@

.venv-peers/ready: .venv/run
	@echo "Installing the tools to compare with into .venv-peers, this once ..."
	@$(BIN)/python -m venv .venv-peers
	@.venv-peers/bin/python -m pip --disable-pip-version-check install --progress-bar on -c constraints.txt -e '.[all,peers]' && touch $@

.venv-peers/real: .venv-peers/ready
	@echo "Installing JAX and jax-sysid into .venv-peers for \`make real\`, this once ..."
	@.venv-peers/bin/python -m pip --disable-pip-version-check install --progress-bar on -c constraints.txt -e '.[peers-jax]' && touch $@

pictures: .venv/dev  ## take the pictures of the page, in every view, into docs
	$(BIN)/python docs/figures/page.py
	$(BIN)/python docs/figures/frame.py
	$(BIN)/python -m docs.figures.shapes
	$(BIN)/python -m docs.figures.tower
	$(BIN)/python docs/figures/diagnosis.py

clean:  ## remove what the other words have made
	rm -rf .venv .venv-peers .venv-audit var build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
