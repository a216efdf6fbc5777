"""One page about both halves of an arena, self-contained: tables with their best cells marked, and the pictures."""

import base64
import html
import json
import re
from pathlib import Path
from typing import Any

from drawn import PICTURES
from plenoptic.report import all_tables
from tables import DETECTORS, by_condition, calibrations

_HEAD = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>Arena</title>
<style>
body { font: 15px/1.5 system-ui, sans-serif; color: #1c1c1c; max-width: 76rem; margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.7rem; margin-bottom: .2rem } h2 { font-size: 1.15rem; margin: 2.2rem 0 .4rem }
h3 { font-size: .95rem; margin: 1.5rem 0 .3rem; font-weight: 600 }
p, dl { max-width: 46rem }
.wide { overflow-x: auto } img { max-width: 100%; height: auto }
table { border-collapse: collapse; font-size: .82rem; font-variant-numeric: tabular-nums }
th, td { padding: .2rem .6rem; border-bottom: 1px solid #ddd; text-align: right; white-space: nowrap }
th:first-child, td:first-child { text-align: left } th { border-bottom: 2px solid #888 }
td.best { background: #dff3e3; font-weight: 600 } td.none { color: #999 }
dt { font-weight: 600 } dd { margin: 0 0 .3rem 1rem }
</style></head>
<body>
<h1>The arena</h1>"""
_INTRODUCTION = """Every image and every number below comes from one simulated camera whose ground truth is computed to
0.001 px: a retrofocus lens of 28 mm, traced surface by surface. Detectors see rendered images with the noise of a
sensor. Calibrators see the same boards; they are judged over the whole image at four distances, not by the
residuals on their own points. Green marks the smallest number of a column."""

_PLENOPTIC = """Calibrations see twelve boards at three distances. Field and depth: largest of the three; beyond: half a
step before or behind them; outside: where no board was; chief and marginal: near the middle and the edge of
micro-images. Turn and place are those of the boards. Baselines are fitted from the first-order truth on: what is left
is the model's."""


def write_page(out: Path) -> Path:
    """Write page.html about what a folder has: results.json with its pictures, and plenoptic/results.json."""
    body = []
    if (first := out / "results.json").exists():
        results = json.loads(first.read_text(encoding="utf-8"))
        body.append(conventional(results, [out / name for name in PICTURES]))
    if (second := out / "plenoptic/results.json").exists():
        body.append(plenoptic(json.loads(second.read_text(encoding="utf-8"))))
    place = out / "page.html"
    place.write_text("\n".join([_HEAD, *body, "</body></html>\n"]), encoding="utf-8")
    return place


def conventional(results: dict[str, Any], pictures: list[Path]) -> str:
    """The half of conventional cameras."""
    about = results["about"]
    shown = {path.stem: _picture(path) for path in pictures if path.exists()}
    parts = [
        f"<p>{_INTRODUCTION}</p><p>{about['date']}, {about['cpu_s']} s of processor time; {about['repeats']} images of "
        f"each view, {about['noisy']} calibrations with noise.</p>",
        _missing(results["missing"]),
    ]
    if results["detectors"]:
        parts += ["<h2>Detectors</h2>", shown.get("detectors", ""), _definitions(results["conditions"])]
        parts += [table(title, *by_condition(results, cell)) for title, cell in DETECTORS.items()]
    if results["calibrators"]:
        parts += ["<h2>Calibrators</h2>", _CASES, shown.get("fields", "")]
        parts += [
            table(title, head, rows, marks_best="Honesty" not in title)
            for title, head, rows in calibrations(results)
            if rows
        ]
    return "\n".join(parts)


def plenoptic(results: dict[str, Any]) -> str:
    """The half of plenoptic cameras."""
    about = results["about"]
    shown = (table(title, head, rows, marks_best=False) for title, head, rows in all_tables(results) if rows)
    return "\n".join(
        [
            f"<h2>Plenoptic cameras</h2><p>{about['date']}, {about['wall_s']} s.</p>",
            f"<p>{_PLENOPTIC}</p>",
            _definitions(results["rigs"] | results["flaws"]),
            *shown,
        ]
    )


_CASES = """<dl><dt>exact</dt><dd>exact positions J at f/8: what is left is the model's</dd>
<dt>noise</dt><dd>Gaussian noise of 0.1 px; root mean square over the repeats</dd>
<dt>few</dt><dd>the same noise, five boards</dd>
<dt>detected</dt><dd>positions that OpenCV SB finds in rendered images</dd>
<dt>open</dt><dd>exact positions at f/2.8: coma and vignetting</dd>
<dt>tilted</dt><dd>exact positions, the lens tilted by 3 and -2 degrees against the sensor</dd></dl>"""


def _definitions(meanings: dict[str, str]) -> str:
    rows = "".join(f"<dt>{html.escape(name)}</dt><dd>{html.escape(what)}</dd>" for name, what in meanings.items())
    return f"<dl>{rows}</dl>"


def _missing(reasons: dict[str, str]) -> str:
    return "\n".join(f"<p><b>Missing: {html.escape(name)}</b>: {html.escape(why)}</p>" for name, why in reasons.items())


def _picture(path: Path) -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    return f'<p><img alt="{path.stem}" src="data:image/png;base64,{data}"></p>'


def table(title: str, head: list[str], rows: list[list[str]], *, marks_best: bool = True) -> str:
    """A table as HTML, with the smallest number of each column marked."""
    best = [_best([row[i] for row in rows]) if marks_best else None for i in range(len(head))]
    lines = [f"<tr>{''.join(f'<th>{html.escape(cell)}</th>' for cell in head)}</tr>"]
    for row in rows:
        kinds = ["none" if cell == "-" else "best" if cell == best[i] else "" for i, cell in enumerate(row)]
        cells = [f'<td class="{kind}">{html.escape(cell)}</td>' for kind, cell in zip(kinds, row, strict=True)]
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return f'<h3>{html.escape(title)}</h3><div class="wide"><table>{"".join(lines)}</table></div>'


def _best(cells: list[str]) -> str | None:
    """The cell of the smallest number, of columns that hold one unsigned number per cell."""
    numbers = {cell: float(cell) for cell in cells if re.fullmatch(r"\d+\.\d+", cell)}
    return min(numbers, key=lambda cell: numbers[cell]) if len(numbers) > 1 else None
