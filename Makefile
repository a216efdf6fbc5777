# Two commands for a newcomer: `make demo` and `make test`. Both make their own virtual environment.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# What a build needs, and with it what tests and developers need. Byte code is made of what is imported, when it is.
CORE := $(VENV)/.core
STAMP := $(VENV)/.installed
INSTALL = $(BIN)/python -m pip install -q --disable-pip-version-check --no-compile -c constraints.txt
# Each process needs 10 s to load what tests share. Proofs have one more than cores: they wait for programs that they start.
WORKERS = $(shell $(PYTHON) -c 'import os; print(min(os.cpu_count() or 1, 4))')
proofs referees: WORKERS = $(shell $(PYTHON) -c 'import os; print(min((os.cpu_count() or 1) + 1, 4))')
# Which tests make a run long.
PYTEST = $(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal --durations=15 --durations-min=2
# Byte code is kept also where the user wants none: each process would compile all libraries and rewrite all tests.
export PYTHONDONTWRITEBYTECODE =
# Standard error of a missing venv module is noise beside the one line that helps.
NEED := needs git, make, Python 3.11 to 3.14 with venv (Debian, Ubuntu: apt install python3-venv) and about 1.0 GB of disk, for tests 1.6 GB

.PHONY: demo test proofs referees lint warm faults bench evaluation picture web site wheel clean

demo: $(CORE)
	$(BIN)/pipeline build examples/02_plenoptic/dataset.usda
	@echo "Open build/02_plenoptic.report/index.html: one page about all of it"
	@echo "Open build/02_plenoptic/frames/0002/Rig.Camera/image.png: a board through microlenses"
	@echo "Open build/02_plenoptic/cameras/Rig.Camera/white.png: a white scene, one disc per microlens"

test: $(STAMP)
	$(MAKE) -j2 lint warm
	$(PYTEST)

# The long siblings of some tests: slow twins of all arrays, hostile values, real clusters, benchmarks.
proofs: $(STAMP) warm
	$(INSTALL) emva1288 mitsuba openimageio optiland -e '.[docs]'
	$(PYTEST) -m heavy

# What docs/ says of images, with the figures: programs, walks and closed forms that share nothing with the renderer.
referees: $(STAMP) warm
	$(INSTALL) emva1288 mitsuba openimageio
	$(BIN)/python -m pytest -q -rP -n $(WORKERS) -m "heavy or not heavy" tests/plugins/scenes/test_mitsuba.py \
		tests/published/test_emva1288.py tests/laws/test_colours.py tests/plugins/scenes/test_reflection.py \
		tests/laws/test_radiometry.py tests/laws/test_diffraction.py \
		tests/render/test_raw_colours.py tests/rerun/test_raw_images.py
	$(BIN)/python benchmarks/sensor.py
	$(BIN)/python benchmarks/diffraction.py

# Byte code and kernels for the many processes of the tests, each of which would compile them alone.
warm: $(STAMP)
	$(BIN)/python -m compileall -q pipeline
	$(BIN)/pipeline warm

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python schemas/generate.py --check
	$(BIN)/python web/record_types.py --check

# Kills, cuts, flips, full disks and more, at every place of a build: ten to twenty minutes.
faults: $(STAMP)
	$(BIN)/python tests/faults/run.py

# Each writes benchmarks/results/: what it found now, and most of them what the commit before gives in the same run.
bench: $(STAMP)
	$(INSTALL) batoid optiland
	$(BIN)/python benchmarks/cold.py
	$(BIN)/python benchmarks/chain.py
	$(BIN)/python benchmarks/trace.py
	$(BIN)/python benchmarks/truth.py
	$(BIN)/python benchmarks/images.py --before 54ef84b --rows 96 --json benchmarks/results/images.json
	$(BIN)/python benchmarks/single.py
	$(BIN)/python benchmarks/direct.py
	$(BIN)/python benchmarks/shutter.py
	$(BIN)/python benchmarks/derivatives.py
	$(BIN)/python benchmarks/sampling.py
	$(BIN)/python benchmarks/positions.py
	$(BIN)/python benchmarks/schedule.py --method direct
	$(BIN)/python benchmarks/memory.py
	$(BIN)/python benchmarks/engine.py

# The paper's evaluation, tables and figures of example 03: ten minutes of computing time.
evaluation: $(STAMP)
	$(BIN)/python examples/03_paper_evaluation/evaluate.py --out examples/03_paper_evaluation

# The pictures of README.md and of the examples.
picture: $(STAMP)
	$(BIN)/pipeline build examples/01_conventional/dataset.usda
	$(BIN)/pipeline build examples/02_plenoptic/dataset.usda
	$(BIN)/python docs/picture.py examples/01_conventional/picture.png \
		build/01_conventional/frames/0006/Rig.Camera --window 50 125 430 310 --zoom 2
	$(BIN)/python docs/picture.py examples/02_plenoptic/picture.png \
		$(patsubst %,build/02_plenoptic/frames/%/Rig.Camera,0002 0001 0003) --window 366 230 78 78 --zoom 4
	$(BIN)/pipeline build examples/04_stereo_colour/dataset.usda
	$(BIN)/python docs/picture.py examples/04_stereo_colour/picture.png --preview raw.png \
		$(patsubst %,build/04_stereo_colour/frames/0002/%.Camera,Left Right) --window 130 120 300 260
	$(BIN)/pipeline build examples/05_scene/dataset.usda
	$(BIN)/python examples/05_scene/draw.py
	$(BIN)/python docs/picture.py examples/07_rolling_shutter/picture.png \
		build/07_rolling_shutter/frames/0001/Instant.Camera build/07_rolling_shutter/frames/0001/Rolling.Camera \
		build/07_rolling_shutter/frames/0001/Exposed.Camera --window 60 60 560 360 --zoom 1
	$(BIN)/python docs/picture.py examples/08_focus_pull/picture.png \
		build/08_focus_pull/frames/0001/Rig.Camera.0001 build/08_focus_pull/frames/0003/Rig.Camera.0003 \
		build/08_focus_pull/frames/0005/Rig.Camera.0004
	$(BIN)/pipeline build examples/09_underwater/dataset.usda
	$(BIN)/python docs/picture.py examples/09_underwater/picture.png \
		build/09_underwater/frames/0001/Flat.Camera build/09_underwater/frames/0001/Dome.Camera
	$(BIN)/pipeline build examples/10_fisheye/dataset.usda
	$(BIN)/python docs/picture.py examples/10_fisheye/picture.png \
		build/10_fisheye/frames/0001/Rig.Camera --zoom 2
	$(BIN)/pipeline ensemble examples/11_as_built/dataset.usda --count 60
	$(BIN)/python examples/11_as_built/picture.py build/11_as_built.ensemble
	$(BIN)/pipeline build examples/12_best_poses/dataset.usda
	$(BIN)/pipeline new dataset build/first.usda --rig examples/12_best_poses/rig.usda \
		--target targets/charuco_8x5.usda --poses 6 --fit
	$(BIN)/pipeline build build/first.usda
	$(BIN)/python examples/12_best_poses/draw.py build/12_best_poses build/first
	$(BIN)/pipeline build examples/13_design/dataset.usda
	$(BIN)/python docs/picture.py examples/13_design/picture.png \
		$(patsubst %,build/13_design/frames/000%/Rig.Camera,1 2 3) --window 345 250 110 100 --zoom 4
	$(BIN)/python examples/14_twin/twin.py
	cp build/14_twin/picture.png examples/14_twin/picture.png
	$(BIN)/python examples/14_twin/plenoptic.py
	cp build/14_plenoptic/picture.png examples/14_twin/plenoptic.png
	$(BIN)/python docs/picture.py docs/micro_images.png \
		build/02_plenoptic/frames/0002/Rig.Camera --window 330 225 140 84 --zoom 7
	$(BIN)/python docs/raw_picture.py docs/raw.png build/02_plenoptic/frames/0002/Rig.Camera \
		--window 330 225 70 84 --zoom 4
	$(BIN)/python docs/target_sheet.py docs/targets.png
	$(BIN)/python docs/report_pictures.py

# The scripts of the report page, by npm; what they are bundled into is committed, so that nothing else needs npm.
web: $(STAMP)
	$(BIN)/python web/record_types.py
	cd web && npm ci --no-audit --no-fund && npm run check && npm run build

# The documentation site: build/site/index.html.
site: $(STAMP)
	$(INSTALL) -e '.[docs]'
	$(BIN)/python docs/schema_reference.py
	$(BIN)/python -m sphinx -q -j auto -W --keep-going -b html -c docs . build/site
	@echo "Open build/site/index.html"

wheel: $(STAMP)
	$(BIN)/python -m build --wheel --outdir dist

clean:
	rm -rf $(VENV) build dist

$(VENV)/.made:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' 2>/dev/null || { echo "pipeline $(NEED); $(PYTHON) is `$(PYTHON) --version 2>&1`. Try: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { echo "pipeline $(NEED); $(PYTHON) has no venv: apt install python3-venv"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(CORE): pyproject.toml constraints.txt | $(VENV)/.made
	$(INSTALL) -e .
	@touch $@

$(STAMP): pyproject.toml constraints.txt | $(VENV)/.made
	$(INSTALL) -e '.[dev]'
	@touch $(CORE) $@
