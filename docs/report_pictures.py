"""Pictures of the reports of the examples, by a headless Chromium: those of docs/reports.md, in docs/report.

python docs/report_pictures.py                   builds the examples, as far as they are not, and takes all
python docs/report_pictures.py --only 02         of one example
python docs/report_pictures.py --out build/mine --folder pictures --sections overview lens [--theme dark] [--width 1400]
"""

import argparse
import io
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from chromium import Tab, browser, found
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
HEIGHT_PX = 900
SMALL_BYTES = 300_000
"""Most bytes of a picture in the repository."""


@dataclass(frozen=True)
class Shot:
    """A picture of a section of a report: the kind of image is chosen, and `keys` are pressed, n in the image."""

    build: str
    section: str
    theme: str = "light"
    keys: tuple[str, ...] = ()
    kind: str = "image"

    @property
    def name(self) -> str:
        """Name of the file, e.g. 02_images.png."""
        return f"{self.build.split('_')[0]}_{self.section}.png"


SHOTS = (
    Shot("01_conventional", "overview"),
    Shot("01_conventional", "optics"),
    Shot("01_conventional", "residuals", "dark"),
    Shot("02_plenoptic", "images", keys=("2", "3", "n", "-", "-", "-")),
    Shot("02_plenoptic", "lens"),
    Shot("04_stereo_colour", "images", keys=("5", "n", "-", "-", "-", "-", "-"), kind="all channels: image"),
    Shot("04_stereo_colour", "scene"),
    Shot("05_scene", "images", "dark", keys=("n", "-", "-", "-", "-", "-", "-"), kind="all channels: image"),
    Shot("05_scene", "build"),
)

CHOOSE = """(one => { one.value = [...one.options].find((other) => other.text === KIND).value;
  one.dispatchEvent(new Event('change')) })(document.querySelector('.viewer select'))"""
"""Chooses a kind of image."""


def main() -> int:
    """Build, write the reports, open them, and take the pictures; 1 without a browser."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="output folder of another build, which is not built")
    parser.add_argument("--folder", type=Path, default=ROOT / "docs/report", help="where the pictures go")
    parser.add_argument("--only", help="beginning of the name of an example")
    parser.add_argument("--theme", choices=("light", "dark"), default="light")
    parser.add_argument("--width", type=int, default=1400, help="of the window [px]")
    parser.add_argument("--sections", nargs="+", default=["images"], help="names as in the address of the page")
    asked = parser.parse_args()
    program = found()
    if program is None:
        print("no Chromium here: apt install chromium", file=sys.stderr)
        return 1
    asked.folder.mkdir(parents=True, exist_ok=True)
    shots = [shot for shot in SHOTS if shot.build.startswith(asked.only or "")]
    if asked.out:
        shots = [Shot(asked.out.name, section, asked.theme) for section in asked.sections]
    with browser(program) as tab:
        for build in dict.fromkeys(shot.build for shot in shots):
            page = page_of(asked.out or ROOT / "build" / build, make=asked.out is None)
            for shot in (one for one in shots if one.build == build):
                tab.look_as(asked.width, HEIGHT_PX, shot.theme)
                print(taken(tab, page, shot, asked.folder / shot.name))
    return 0


def page_of(out: Path, *, make: bool) -> Path:
    """The report of a build, written now."""
    if make:
        stage = ROOT / "examples" / out.name / "dataset.usda"
        subprocess.run([sys.executable, "-m", "pipeline", "build", str(stage), "-q", "-o", str(out)], check=True)
    command = [sys.executable, "-m", "pipeline", "report", str(out)]
    return Path(subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip())


def taken(tab: Tab, page: Path, shot: Shot, path: Path) -> Path:
    """Open a page, go to its section, press keys, and take the picture."""
    tab.open(page)
    tab.run("document.documentElement.style.scrollBehavior = 'auto'")
    for _ in range(2):  # what is filled in late moves what lies below it
        tab.run(f"document.querySelector('#{shot.section}').scrollIntoView()")
        tab.settle(f"document.querySelector('#{shot.section}').innerHTML.length")
    if shot.section == "images":
        tab.run(CHOOSE.replace("KIND", repr(shot.kind)))
        tab.settle("document.querySelector('.viewer-stage').dataset.corner ?? ''")
    for key in shot.keys:
        if key == "n":
            tab.run("document.querySelector('.viewer-stage').focus({preventScroll: true})")
        tab.press(key)
    tab.settle("document.querySelector('.viewer-stage').dataset.corner ?? ''")
    return small(tab.picture(path))


def small(path: Path) -> Path:
    """The picture in 256 colours if it has too many bytes."""
    if path.stat().st_size > SMALL_BYTES:
        file = io.BytesIO()
        Image.open(path).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(file, "png", optimize=True)
        path.write_bytes(file.getvalue())
    return path


if __name__ == "__main__":
    sys.exit(main())
