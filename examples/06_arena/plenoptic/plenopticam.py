"""plenopticam 0.9.3: centres of micro-images in a white image.

Of PyPI, without the exact versions that it asks for (pyinstaller is one of them). It reads white.png. Its list has y,
x, row, column of each centre, pixels from 0. Two of its steps fail on bright micro-images without a peak. It takes them
for 313, 8 and 9 pixels wide (r12, paper, lytro: 23, 22, 10), so that it is given the width. And it finds two maxima in
one micro-image, from which its sorting derives a pitch that is too small and goes astray; the weaker one is dropped.
"""

import json
import shutil
import subprocess
import venv
from pathlib import Path

import numpy as np

_PACKAGES = (
    "plenopticam==0.9.3 certifi charset-normalizer color-matcher==0.6.0 color-space-converter==0.1.4"
    " colour-demosaicing==0.2.5 colour-science==0.4.4 ddt==1.7.2 depthy==0.4.0 docutils idna ImageIO==2.38.1"
    " lazy-loader networkx numpy==1.26.4 packaging pillow==13.0.0 requests scikit-image==0.22.0 scipy==1.12.0"
    " tifffile==2022.4.8 typing_extensions urllib3"
)
"""Without their dependencies: pip finds no set of versions in ten minutes; plenopticam pins pyinstaller 5.13.1."""
_PROGRAM = """
import json, sys
import numpy as np
from PIL import Image
from plenopticam.cfg import PlenopticamConfig
from plenopticam.lfp_calibrator import LfpCalibrator
from plenopticam.lfp_calibrator.centroid_extractor import CentroidExtractor
from scipy.spatial import cKDTree
def without_doubles(self):
    places = np.array(self._centroids)
    light, kept = self._peak_img[tuple(places.T)], np.ones(len(places), bool)
    for pair in cKDTree(places).query_pairs(0.6 * self._M):
        if kept[list(pair)].all():
            kept[min(pair, key=lambda row: light[row])] = False
    return list(places[kept])
CentroidExtractor.centroids = property(without_doubles)
config = PlenopticamConfig()
config.default_values()
config.params[config.cal_path], config.params[config.opt_prnt] = sys.argv[1], False
config.params[config.cal_meth] = sys.argv[2]
white = np.asarray(Image.open(sys.argv[1]).convert("L"), float)
calibrator = LfpCalibrator(white, config)
calibrator._M = int(sys.argv[3])
calibrator.main()
found = np.asarray(config.calibs[config.mic_list]).tolist()
pattern, pitch = config.calibs[config.pat_type], np.ravel(config.calibs[config.ptc_mean]).tolist()
print("FOUND" + json.dumps([found, str(pattern), pitch]))
"""


def build(snapshots: Path, folder: Path) -> None:
    """Make an environment of its own; nothing of `snapshots` is needed."""
    del snapshots
    place = folder / "plenopticam"
    if not (place / "installed").exists():
        venv.create(place, with_pip=True)
        install = [str(place / "bin/pip"), "install", "-q", "--no-deps", *_PACKAGES.split()]
        subprocess.run(install, check=True, capture_output=True)
        (place / "installed").touch()


def run(folder: Path, task: Path) -> dict[str, object]:
    """Let it find centres, by its method `area`, the best of those tried."""
    work = folder / "runs/plenopticam"
    work.mkdir(parents=True, exist_ok=True)
    shutil.copy(task / "white.png", work)  # it writes its list beside the image
    pitch_px = json.loads((task / "task.json").read_text(encoding="utf-8"))["pitch_px"]
    width = str(2 * int((pitch_px - 1) / 2) + 1)  # odd, as its windows are, and none reaches into the next micro-image
    command = [str(folder / "plenopticam/bin/python"), "-c", _PROGRAM, "white.png", "area", width]
    said = subprocess.run(command, cwd=work, capture_output=True, text=True, check=True).stdout
    centres, pattern, pitch = json.loads(said.partition("FOUND")[2])
    rows = np.array(centres)
    return {"centres_px": rows[:, [1, 0]], "index": rows[:, [3, 2]].astype(int), "pattern": pattern, "pitch_px": pitch}
