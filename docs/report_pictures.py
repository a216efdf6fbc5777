"""Pictures of the report of a build, by a headless Chromium: images.png, overview.png and more in a folder.

python docs/report_pictures.py build/02_plenoptic docs/report [--theme dark] [--width 1400]
"""

import argparse
import subprocess
import sys
from pathlib import Path

from chromium import browser, found

KEYS = {"images": ("2", "3", "n", "-", "-", "-")}
"""Keys that are pressed before the picture of a section."""


def main() -> int:
    """Write the report, open it, and take the pictures; 1 without a browser."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="the output folder of a build")
    parser.add_argument("folder", type=Path, help="where the pictures go")
    parser.add_argument("--theme", choices=("light", "dark"), default="light")
    parser.add_argument("--width", type=int, default=1400, help="of the window [px]")
    parser.add_argument("--sections", nargs="+", default=["images"], help="names as in the address of the page")
    asked = parser.parse_args()
    program = found()
    if program is None:
        print("no Chromium here: apt install chromium", file=sys.stderr)
        return 1
    command = [sys.executable, "-m", "pipeline", "report", str(asked.out)]
    page = Path(subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip())
    asked.folder.mkdir(parents=True, exist_ok=True)
    with browser(program) as tab:
        tab.look_as(asked.width, 900, asked.theme)
        tab.open(page)
        tab.run("document.documentElement.style.scrollBehavior = 'auto'")
        for name in asked.sections:
            tab.run(f"document.querySelector('#{name}').scrollIntoView()")
            tab.settle(f"document.querySelector('#{name}').innerHTML.length")
            for key in KEYS.get(name, ()):
                if key == "n":
                    tab.run("document.querySelector('.viewer-stage').focus({preventScroll: true})")
                tab.press(key)
            tab.settle("document.querySelector('.viewer-stage').dataset.corner ?? ''")
            print(tab.picture(asked.folder / f"{name}.png"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
