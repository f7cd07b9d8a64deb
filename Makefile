# Each target sets up the environment that it needs, from Python and the package index alone;
# a second run finds it ready. `make help` lists the targets.

PYTHON ?= python3
OUT ?= out
PYTEST_ARGS ?=
# How often `make evidence` draws new examples for the tests of properties.
SEARCHES ?= 5

main := .venv/bin
dev := .venv-dev/bin

# The tools find this Python, and each other, first.
dev_run := PATH="$(CURDIR)/$(dev):$$PATH"

.DEFAULT_GOAL := help
# Tests that measure time, by their marker.
alone = $(shell grep -rl --include='test_*.py' 'mark\.alone' tests)
# Servers, browsers and stages in their own time are waited for in the slow tier: one process more
# than cores. In the other each process more compiles the same loops again.
processes = $(shell $(PYTHON) -c 'import os; print(os.cpu_count() + 1)')
parallel := --dist worksteal --durations=20

.PHONY: study test quick slow evidence bench docs lint style types format lock clean help python env env-dev

# Side by side: much of a study is work for one core. The longer one shows its progress.
study: env ## both stages of the study, with a report each, into out/
	@$(MAKE) --no-print-directory -j2 study-vgtu-piezo study-vgtu-mechanical

study-vgtu-mechanical: quietly := --quiet
study-%: env
	$(main)/flexstage study $* --folder $(OUT)/$* $(quietly)

# Types are looked at within a minute: the tests begin beside it.
test: style ## lint, with every test but the slow ones beside it
	@$(MAKE) --no-print-directory -j2 types quick

quick: env-dev
	$(dev_run) pytest -n auto $(parallel) $(PYTEST_ARGS)

slow: env-dev ## the slow evidence: peers, long runs, the built package
	$(dev_run) pytest tests -m "slow and not alone" \
		-n $(processes) $(parallel) $(PYTEST_ARGS)
	$(dev_run) pytest $(alone) -m "slow and alone"

evidence: env-dev ## the slow evidence at full size, before a release
	$(dev_run) pytest tests -m evidence -n auto $(parallel) --evidence-page $(OUT)/evidence.md \
	  $(PYTEST_ARGS)
	for search in $$(seq $(SEARCHES)); do \
	  $(dev_run) pytest tests -m "hypothesis and not evidence" --hypothesis-profile=search \
	    -n auto $(parallel) $(PYTEST_ARGS) || exit 1; \
	done

bench: env-dev ## speed, as ratios against named alternatives, and a page of them, out/benchmarks.md
	$(dev_run) python -m benchmarks --page $(OUT)/benchmarks.md

docs: env-dev ## the manual, as HTML, into out/docs
	$(dev_run) sphinx-build -q -W --keep-going -b html -d $(OUT)/.doctrees docs $(OUT)/docs
	@echo "the manual is in $(OUT)/docs/index.html"

lint: style types ## style, format, types, layers, spelling, words

style: env-dev
	$(dev_run) ruff check .
	$(dev_run) ruff format --check .
	$(dev_run) lint-imports
	$(dev_run) codespell
	$(dev_run) python scripts/words.py

types: env-dev
	$(dev_run) pyrefly check --python-interpreter-path $(dev)/python --output-format min-text

format: env-dev ## put the code into the common format
	$(dev_run) ruff check --fix .
	$(dev_run) ruff format .

lock: python ## write the requirement locks again
	PYTHON="$(PYTHON)" scripts/lock.sh

clean: ## remove the environments, outputs and caches
	rm -rf .venv .venv-dev .venv-lock .venv.lock .venv-dev.lock $(OUT) dist docs/reference/api docs/reference/command-line.md
	rm -rf .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find src tests docs benchmarks -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true

help: ## this list
	@grep -E '^[a-z-]+:.*##' Makefile | sed -E 's/^([a-z-]+):.*## (.*)/  make \1\t\2/' | expand -t 16

env: python
	@$(PYTHON) scripts/environment.py .venv requirements/main.txt

env-dev: python
	@$(PYTHON) scripts/environment.py .venv-dev requirements/dev.txt

python:
	@command -v $(PYTHON) >/dev/null || { \
	  echo "flexstage needs Python 3.11 or later, and there is no '$(PYTHON)': \
	say 'make PYTHON=/path/to/python3.11'." >&2; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "flexstage needs Python 3.11 or later, and '$(PYTHON)' is" \
	  "$$($(PYTHON) -c 'import platform; print(platform.python_version())'):" \
	  "say 'make PYTHON=/path/to/python3.11'." >&2; exit 2; }
