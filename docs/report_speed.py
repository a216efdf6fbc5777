"""Figures of the report in a browser: weight, time to the first image, and pictures per second while zooming.

python docs/report_speed.py

The dataset is synthetic: frames of noise of 12 megapixels, which no PNG shrinks, as tiles, each with a table of rows,
below the report of a small build. Chromium draws by software; on a computer with a graphics card all of it is faster.
"""

import argparse
import dataclasses
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from chromium import Tab, browser, found

from pipeline.files.png import write_png
from pipeline.records.plain import to_plain
from pipeline.report.page.images import picture_of
from pipeline.results.folder import BuiltFolder

ROOT = Path(__file__).resolve().parents[1]
STAGE = ROOT / "tests/data/tiny_conventional/dataset.usda"
SIZE_PX = (4000, 3000)
"""Width and height of the frames: 12 megapixels."""
ROWS = 2000
"""Rows of the table of a frame: a board of 50 x 40 corners."""
SECONDS = 6
"""Time of zooming [s]: in and out several times."""
ZOOM = """(async () => {
  const press = (name) => [...document.querySelectorAll('.zoom button')].find((one) => one.ariaLabel === name).click();
  const begun = performance.now(); let last = begun, frames = 0, longest = 0, turn = 0;
  const pushed = setInterval(() => press(['Zoom in', 'Zoom in', 'Zoom out', 'Zoom out'][turn++ % 4]), 250);
  await new Promise((done) => requestAnimationFrame(function next(now) {
    frames++; longest = Math.max(longest, now - last); last = now;
    if (now - begun < SECONDS * 1000) requestAnimationFrame(next); else done();
  }));
  clearInterval(pushed);
  return {frames, seconds: (last - begun) / 1000, longest};
})()"""
"""Zooms by the buttons of the page, and counts the pictures that the browser draws meanwhile."""


def main() -> int:
    """Make the dataset, open it, and print the figures; 1 without a browser."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=3, help="frames of 12 megapixels")
    asked = parser.parse_args()
    program = found()
    if program is None:
        print("no Chromium here: apt install chromium", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as place:
        report = synthetic(Path(place), asked.frames)
        with browser(program) as tab:
            for line in figures(tab, report):
                print(line)
    return 0


def synthetic(place: Path, frames: int) -> Path:
    """A report whose camera has large frames; returns its folder."""
    command = [sys.executable, "-m", "pipeline"]
    kept = {**os.environ, "PIPELINE_REPORT": "yes"}
    subprocess.run([*command, "build", str(STAGE), "-q", "-o", str(place / "out")], check=True, env=kept)
    subprocess.run([*command, "report", str(place / "out")], check=True, stdout=subprocess.DEVNULL)
    report = place / "out.report"
    page = content(report / "data/page.js")
    (camera,) = page["cameras"]
    width, height = SIZE_PX
    views, random = [], np.random.default_rng(5)
    for number in range(1, frames + 1):
        grey = random.integers(0, 256, (height, width), dtype=np.uint8)
        write_png(report / "frame.png", grey)
        folder = BuiltFolder(path=report, stage="", digests={"frame.png": f"{number:02x}" * 32})
        picture = to_plain(picture_of(folder, "frame.png", "image", report))
        data = f"rows.synthetic.{number:04d}"
        columns = {
            f"{name}_px": random.uniform(0, size, ROWS).tolist() for name, size in zip("xy", SIZE_PX, strict=True)
        }
        table = {"rows": ROWS, "same": {"frame": number, "target": "Board"}, "columns": columns}
        written(report / f"data/{data}.js", data, table)
        view = {**camera["views"][0], "frame": number, "rows": ROWS, "data": f"data/{data}.js", "pictures": [picture]}
        views.append(view)
    (report / "frame.png").unlink()
    camera.update(width_px=width, height_px=height, views=views)
    page["frames"] = list(range(1, frames + 1))
    written(report / "data/page.js", "page", page)
    return report


def content(path: Path) -> dict[str, Any]:
    """What a script hands to the page."""
    text = path.read_text(encoding="utf-8").partition(",")[2]
    found_: dict[str, Any] = json.loads(text.rstrip().removesuffix(");"))
    return found_


def written(path: Path, name: str, value: dict[str, Any]) -> None:
    """Write a script that hands a value to the page."""
    path.write_text(f"plenopticReport({json.dumps(name)},{json.dumps(value)});\n", encoding="utf-8")


@dataclasses.dataclass(frozen=True)
class Load:
    """Bytes that a page asked for, by the ends of their addresses."""

    sizes: dict[Path, int]

    def of(self, *ends: str) -> float:
        """Kilobytes of the files with these ends."""
        return sum(size for path, size in self.sizes.items() if path.name.endswith(ends)) / 1000


def figures(tab: Tab, report: Path) -> list[str]:
    """Lines with the figures."""
    tab.look_as(1400, 900)
    tab.open(report / "index.html")
    ready_ms = tab.run("performance.now()")
    tab.wait("performance.getEntriesByName('first image').length")
    first_ms = tab.run("performance.getEntriesByName('first image')[0].startTime")
    shown = [Path(url.removeprefix("file://")) for url in dict.fromkeys(tab.requests) if url.startswith("file://")]
    load = Load({path: path.stat().st_size for path in shown if path.is_file()})
    tab.run("document.documentElement.style.scrollBehavior = 'auto'")
    tab.run("document.querySelector('#images').scrollIntoView()")
    tab.wait("document.querySelector('.viewer-stage').dataset.rows > 0")
    tab.settle("document.querySelector('.viewer-stage').dataset.scale")
    zoomed = tab.run(ZOOM.replace("SECONDS", str(SECONDS)))
    megapixels = SIZE_PX[0] * SIZE_PX[1] / 1e6
    scripts = load.of("report.js", "report.css", "index.html")
    return [
        f"page: {scripts:.0f} kB of scripts and style, {load.of('.js') - load.of('report.js'):.0f} kB of data,"
        f" {load.of('.png'):.0f} kB of images until the first one of {megapixels:.0f} megapixels is seen",
        f"ready after {ready_ms / 1000:.2f} s, first image after {first_ms / 1000:.2f} s",
        f"zooming: {zoomed['frames'] / zoomed['seconds']:.0f} pictures per second, the longest wait"
        f" {zoomed['longest']:.0f} ms, {ROWS} rows drawn over the image",
        f"console: {len(tab.errors)} errors; network: {sum(url.startswith('http') for url in tab.requests)} requests",
    ]


if __name__ == "__main__":
    sys.exit(main())
