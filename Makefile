# make demo, make test: each does all the set-up that is missing, then its job.
.PHONY: help demo test slow hard-cases sanitize wheels bench lint format setup setup-dev clean

PYTHON_VENV := .venv/bin/python
PYTEST_ARGS ?=
# As many at once as there are cores; PYTEST_WORKERS=0 for one process, as a debugger needs.
PYTEST_WORKERS ?= $(shell nproc 2>/dev/null || echo 2)
HARD_CASES_ARGS ?=
C_FILES = $(shell find csrc benchmarks -name '*.[ch]')
# GLFW needs a display; without one, a virtual one is enough.
DISPLAYED = $(if $(DISPLAY),,$(if $(shell command -v xvfb-run 2>/dev/null),xvfb-run -a))

help:
	@echo 'make demo    pictures and numbers of real terrain, in ./demo'
	@echo 'make test    the test suite; PYTEST_ARGS="-k splits" for a part of it'
	@echo 'make slow    the long tests as well'
	@echo 'make hard-cases  worst figures of what is easy to get wrong, in ./hard-cases'
	@echo 'make sanitize  the tests with address and undefined-behaviour sanitizers'
	@echo 'make wheels  sdist, wheel from it, fast tests on Python 3.11, 3.12, 3.13'
	@echo 'make bench   fits per second; time per pass; the whole job beside hand-written moderngl'
	@echo 'make lint    ruff, clang-format, clang-tidy;  make format  applies the formats'

setup:
	@scripts/set_up.sh

setup-dev:
	@scripts/set_up.sh dev

demo: setup
	@scripts/demo.sh

test: setup
	@$(DISPLAYED) $(PYTHON_VENV) -m pytest -n $(PYTEST_WORKERS) --dist loadfile $(PYTEST_ARGS)

slow: setup
	@$(DISPLAYED) $(PYTHON_VENV) -m pytest -n $(PYTEST_WORKERS) --dist loadfile -m 'slow or not slow' $(PYTEST_ARGS)

hard-cases: setup
	@$(DISPLAYED) $(PYTHON_VENV) -m csm hard-cases --out hard-cases $(HARD_CASES_ARGS)

sanitize: setup
	@scripts/sanitize.sh $(PYTEST_ARGS)

wheels: setup-dev
	@$(DISPLAYED) $(PYTHON_VENV) scripts/wheels.py

bench: setup-dev
	@$(PYTHON_VENV) benchmarks/bench_fit.py
	@$(PYTHON_VENV) benchmarks/bench_passes.py

lint: setup-dev
	@scripts/lint.sh

format: setup-dev
	@$(PYTHON_VENV) -m ruff format .
	@$(PYTHON_VENV) -m ruff check --fix .
	@clang-format -i $(C_FILES)

clean:
	rm -rf build dist *.egg-info csm/_core.*.so
