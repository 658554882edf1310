.DEFAULT_GOAL := help
PYTHON ?= .venv/bin/python
SOURCES := pumaid tests tools

.PHONY: help check fix test fast bench peers docs site samples ci

help: ## this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "  make %-8s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

check: ## formatter, linter, types, tests, and whether generated documents are current
	$(PYTHON) -m ruff format --check $(SOURCES)
	$(PYTHON) -m ruff check $(SOURCES)
	$(PYTHON) -m mypy
	$(PYTHON) tools/make_docs.py --check
	$(PYTHON) -m pytest

fix: ## format and mend what the linter can mend
	$(PYTHON) -m ruff format $(SOURCES)
	$(PYTHON) -m ruff check --fix $(SOURCES)

test: ## all tests
	$(PYTHON) -m pytest

fast: ## tests without slow and browser ones
	$(PYTHON) -m pytest -m "not slow and not browser"

bench: ## time identifications beside merely reading their logs, to 50 million rows; appended to bench/log.csv
	$(PYTHON) tests/bench/pass_speed.py

peers: ## time identifications beside figaroh, aurt and mujoco.sysid, which it installs; appended to bench/peers.csv
	$(PYTHON) tests/bench/peers.py

docs: ## write docs/commands.md, docs/effects.md and the sessions in README.md
	$(PYTHON) tools/make_docs.py

site: ## build the documentation site (needs the extra `site`)
	$(PYTHON) -m mkdocs build

samples: ## write sample_logs/ anew
	$(PYTHON) tools/make_samples.py

ci: ## what the project's continuous integration runs, in a clean copy
	.ci/run
