"""plenopticam 0.9.3: centres of micro-images in a white image, and views of an unfocused camera.

Of PyPI, without the exact versions that it asks for (pyinstaller is one of them). It reads white.png. Its list has y,
x, row, column of each centre, pixels from 0. Two of its steps fail on bright micro-images without a peak. It takes them
for 313, 8 and 9 pixels wide (r12, paper, lytro: 23, 22, 10), so that it is given the width. And it finds two maxima in
one micro-image, from which its sorting derives a pitch that is too small and goes astray; the weaker one is dropped.

Its views are cut from an image that says of each pixel where it lies in its micro-image, so that each says of itself
what it is made of. That is not turned, whitened or scaled; its width of micro-images is its own choice.
"""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from environments import called, installed

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
found = [np.asarray(config.calibs[config.mic_list]).tolist(), []]
if len(sys.argv) > 4:
    from plenopticam.lfp_aligner import LfpAligner, LfpResampler
    from plenopticam.lfp_extractor import LfpCropper, LfpRearranger
    LfpResampler._write_lfp_align = lambda self: None
    config.params[config.opt_vign] = config.params[config.opt_rota] = False
    aligner = LfpAligner(np.load(sys.argv[4]), config)
    aligner.main()
    cropper = LfpCropper(lfp_img_align=aligner.lfp_img, cfg=config)
    cropper.main()
    rearranger = LfpRearranger(cropper.lfp_img_align, cfg=config)
    rearranger.main()
    views = rearranger.vp_img_arr[:, :, 2:-2, 2:-2, :2]
    middle = len(views) // 2
    for aside in (0, 2):
        view = views[middle, middle + aside].reshape(-1, 2)
        found[1].append([aside, view.mean(axis=0).tolist(), view.std(axis=0).tolist()])
print("FOUND" + json.dumps(found))
"""


def build(snapshots: Path, programs: Path) -> None:
    """Make an environment of its own; nothing of `snapshots` is needed."""
    installed(tuple(_PACKAGES.split()), programs, "--no-deps")


def run(programs: Path, task: Path, facts: dict[str, Any]) -> dict[str, Any]:
    """Let it find centres, by its method `area`, the best of those tried; and cut the middle view and one beside it."""
    work = programs / "runs/plenopticam"
    work.mkdir(parents=True, exist_ok=True)
    shutil.copy(task / "white.png", work)  # it writes its list beside the image
    # The width is odd, as its windows are, and none reaches into the next micro-image.
    width = 2 * int((facts["pitch_px"] - 1) / 2) + 1
    python = installed(tuple(_PACKAGES.split()), programs, "--no-deps")
    coded = [task / "coded.npy"] if "views" in facts else []
    printed = called([python, "-W", "ignore", "-c", _PROGRAM, "white.png", "area", width, *coded], cwd=work)
    centres, views = json.loads(printed.partition("FOUND")[2])
    return {"centres_px": np.array(centres)[:, [1, 0]], "views": views}
