# make run    set up, then run a scenario on this machine     make run SCENARIO=toy ARGS="--seed 2"
# make test   set up with what tests need, then linters, type checker and all tests (make checks: without the tests)
# make compose  the same by Docker Compose (see docker-compose.yml), the answer last
# make flower .venv-flower, where the tests marked flower run Flower (40 s, 430 MB)
# make wheels the folder of wheels that the container image takes PyTorch from (on Linux: a wheel of this platform)
# make clean  removes what the above made, but no run directory
#
# TORCH_INDEX  options for pip when it fetches PyTorch. On Linux pip's usual index holds the CUDA build, several
#              gigabytes that a machine without such a GPU has no use for. PyTorch publishes an index of CPU wheels:
#              make run TORCH_INDEX="--index-url <address of the CPU wheels>". Unset, pip decides, by its configuration.
# TORCH        exact, so that a CPU wheel that is found (2.13.0+cpu counts as newer than 2.13.0) is the one chosen.

SCENARIO    ?= quick
ARGS        ?=
TORCH       ?= torch==2.13.0
TORCH_INDEX ?=
FLWR        ?= flwr[simulation]==1.42.0
PYTHON      ?= $(shell for each in python3.11 python3 python; do \
	$$each -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo $$each; break; }; done)

VENV := .venv
BIN  := $(VENV)/bin
PIP  := $(BIN)/python -m pip install --quiet --disable-pip-version-check

.PHONY: run test checks setup compose flower wheels clean

run: setup
	@$(BIN)/jouleswarm run $(SCENARIO) $(ARGS)

# What is set up for Flower and what the type checker does are as long, and neither keeps two cores busy.
test: $(VENV)/tested
	@$(MAKE) --no-print-directory --jobs 2 checks flower
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder

checks: $(VENV)/tested
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --strict

# A deployment ends under the lines of containers that stop: what the recorder said last is said once more below them.
compose:
	@docker compose up --build --abort-on-container-exit; code=$$?; docker compose cp recorder:/runs/. runs; \
	docker compose logs --no-log-prefix --tail 40 recorder; exit $$code

setup: $(VENV)/installed

# A stamp: written last, so that a set-up that was broken off is done again, and a complete one never is.
$(VENV)/installed: pyproject.toml
	@test -n "$(PYTHON)" || { echo "JouleSwarm needs Python 3.11 or newer; none was found. make PYTHON=/path/to/python3.11"; exit 2; }
	@echo "Setting up $(VENV) with $(PYTHON): a few minutes, the first time only"
	@$(PYTHON) -m venv $(VENV)
	@echo "  1/2 $(TORCH) (about 200 MB as a CPU wheel; see TORCH_INDEX in the Makefile)"
	@$(PIP) $(TORCH_INDEX) "$(TORCH)"
	@echo "  2/2 JouleSwarm and its other dependencies"
	@$(PIP) --editable ".[page]"
	@touch $@
	@echo "Set-up done"

# What tests need besides: linters, MLflow, TensorBoard, the site's generator.
$(VENV)/tested: $(VENV)/installed
	@echo "Setting up what tests need: another minute"
	@$(PIP) --editable ".[dev]"
	@touch $@

flower: $(VENV)-flower/installed

$(VENV)-flower/installed: pyproject.toml | $(VENV)/tested
	@echo "Setting up $(VENV)-flower with $(FLWR), for the tests marked flower"
	@$(PYTHON) -m venv $(VENV)-flower
	@$(VENV)-flower/bin/python -m pip install --quiet --disable-pip-version-check --no-compile "$(FLWR)"
	@$(VENV)-flower/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	@touch $@

wheels: setup
	$(BIN)/python -m pip download --no-deps --only-binary=:all: --python-version 3.11 --dest wheels $(TORCH_INDEX) "$(TORCH)"

clean:
	rm -rf $(VENV) $(VENV)-flower wheels build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
