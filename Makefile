# Each target does the set-up it needs. Needs python3 (3.11 or newer) with venv, and network once.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready

.PHONY: setup demo test quick check format lock opencv4 coverage mutation install-service

setup: $(READY)

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes -r constraints.txt
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	$(BIN)/python -m compileall -q followerd # else some environments compile it at each start
	touch $@

demo: $(READY) ## a robot follows a person down a corridor, nothing plugged in
	$(BIN)/followerd demo

test: $(READY) ## everything, quick tests first
	$(BIN)/pytest -q -m "not slow"
	$(BIN)/pytest -q -m "slow and realtime" --numprocesses=0
	$(BIN)/pytest -q -m "slow and not realtime"

quick: $(READY) ## what to run while working
	$(BIN)/pytest -q -m "not slow"

check: $(READY) ## lint, format, types, layers
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

format: $(READY)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

IMAGE_TESTS := $(addprefix tests/test_,bench_film.py blobs.py camera.py camera_calibration.py \
  camera_files.py camera_v4l2.py colour.py head.py hotspot.py hpf.py hybrid.py kinect.py ofkf.py \
  patches.py render.py stereo.py track.py windows.py)

opencv4: $(READY) ## the image code on the oldest OpenCV that is supported
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --upgrade --target build/opencv4 "opencv-python-headless==4.10.*"
	PYTHONPATH=build/opencv4 $(BIN)/pytest -q -m "not slow" $(IMAGE_TESTS)

coverage: $(READY) ## every branch of the protocols and of the guard is tested
	$(BIN)/pytest -q -m "not slow" --cov=followerd.hw --cov=followerd.control --cov-branch --cov-report= \
	  $(addprefix tests/test_,p2os_protocol.py lms200_protocol.py vcc50i_protocol.py camera.py guard.py clearance.py mode.py pipeline.py)
	$(BIN)/coverage report --include="followerd/hw/*/protocol.py,followerd/control/guard.py,followerd/control/mode.py,followerd/control/transitions.py" --fail-under=100

mutation: $(READY) ## is every small change of the guard and of the modes noticed; some ten minutes
	$(BIN)/python -m tests.mutation

install-service: ## as root: the systemd unit and the udev rules, which keep what you wrote into them
	install -d $(DESTDIR)/etc/systemd/system $(DESTDIR)/etc/udev/rules.d $(DESTDIR)/etc/followerd
	install -m 644 systemd/followerd.service $(DESTDIR)/etc/systemd/system/
	test -e $(DESTDIR)/etc/udev/rules.d/60-followerd.rules || \
	  install -m 644 systemd/60-followerd.rules $(DESTDIR)/etc/udev/rules.d/
	if [ -z "$(DESTDIR)" ] && [ -d /run/systemd/system ]; then systemctl daemon-reload; fi

lock: ## write constraints.txt anew from pyproject.toml
	$(PYTHON) -m venv build/lock
	build/lock/bin/pip install --quiet pip-tools
	build/lock/bin/pip-compile --quiet --generate-hashes --allow-unsafe --strip-extras --all-extras \
	  --no-emit-index-url --no-emit-trusted-host --no-emit-find-links --no-header --no-annotate \
	  --output-file constraints.txt pyproject.toml
