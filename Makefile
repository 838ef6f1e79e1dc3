# Everything is set up by the first target that needs it: `make demo` and `make test` work on a fresh machine with
# Python 3.11 to 3.13, git and make.

BIN   := .venv/bin
READY := .venv/ready

.PHONY: demo test lint docs warmup lock clean

demo: $(READY)
	PATH="$(CURDIR)/$(BIN):$$PATH" bash .ci/demo

test: $(READY)
	$(BIN)/pytest -n auto $(ARGS)

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The documentation as a site, in site/ (open site/index.html). A warning is an error.
docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

warmup: $(READY)
	$(BIN)/slamcli warmup

lock: $(READY)
	$(BIN)/python .ci/lock.py

clean:
	rm -rf .venv demo site build dist .coverage .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis

$(READY): requirements.lock pyproject.toml .ci/setup
	bash .ci/setup
	touch $(READY)
