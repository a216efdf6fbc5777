"""One page about both halves of an arena, self-contained: tables with their best cells marked, and the pictures."""

import base64
import html
import json
import re
from pathlib import Path

import tables

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
_CONVENTIONAL = """Every image and every number below comes from one simulated camera whose ground truth is computed to
0.001 px: a retrofocus lens of 28 mm, traced surface by surface. Detectors see rendered images with the noise of a
sensor. Calibrators see the same boards; they are judged over the whole image at four distances, not by the
residuals on their own points. Green marks the smallest number of a column. The twin is this project's own lens, fitted
from drawings that are off: from exact corners its truth is among its models, which is no merit. Elsewhere it gains what
its owner knows of his lens, which the others are not told; its deviations are those of noise."""
_CASES = {
    "exact": "exact positions J at f/8: what is left is the model's",
    "noise": "Gaussian noise of 0.1 px; root mean square over the repeats",
    "few": "the same noise, five boards",
    "detected": "positions that OpenCV SB finds in rendered images",
    "open": "exact positions at f/2.8: coma and vignetting",
    "tilted": "exact positions, the lens tilted by 3 and -2 degrees against the sensor",
}
_PLENOPTIC = """Calibrations see twelve boards at three distances. Field and depth: largest of the three; beyond: half a
step before or behind them; outside: where no board was; chief and marginal: near the middle and the edge of
micro-images. Turn and place are those of the boards. Baselines are fitted from the first-order truth on: what is left
is the model's. The twin is fitted to at most 800 of the rows, from drawings of the camera that are off: it knows the
lens, which the others are not told. Less mirrored: without boards that the program takes for tilted the other way.
Views: what each takes from micro-images instead of what it should, and how far from there its viewpoint lies."""


def write_page(out: Path) -> Path:
    """Write page.html about what a folder has: results.json with its pictures, and plenoptic/results.json."""
    body = [_HEAD]
    if (first := out / "results.json").exists():
        results = json.loads(first.read_text(encoding="utf-8"))
        made, pictures = tables.conventional(results), [out / "detectors.png", out / "fields.png"]
        body.append(half("Conventional cameras", _CONVENTIONAL, results, _CASES, made, pictures))
    if (second := out / "plenoptic/results.json").exists():
        results = json.loads(second.read_text(encoding="utf-8"))
        meanings = results["rigs"] | results["flaws"]
        body.append(half("Plenoptic cameras", _PLENOPTIC, results, meanings, tables.plenoptic(results), []))
    place = out / "page.html"
    place.write_text("\n".join([*body, "</body></html>\n"]), encoding="utf-8")
    return place


def half(
    title: str,
    introduction: str,
    results: tables.Results,
    meanings: dict[str, str],
    made: list[tables.Table],
    pictures: list[Path],
) -> str:
    """One half of the page."""
    about = ", ".join(f"{key}: {value}" for key, value in results["about"].items())
    terms = "".join(f"<dt>{html.escape(name)}</dt><dd>{html.escape(what)}</dd>" for name, what in meanings.items())
    shown = [_picture(path) for path in pictures if path.exists()]
    marks_best = title.startswith("Conventional")
    parts = [f"<h2>{title}</h2><p>{introduction}</p><p>{html.escape(about)}</p><dl>{terms}</dl>", *shown]
    return "\n".join([*parts, *(table(*one, marks_best=marks_best) for one in made if one[2])])


def _picture(path: Path) -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    return f'<p><img alt="{path.stem}" src="data:image/png;base64,{data}"></p>'


def table(title: str, head: list[str], rows: list[list[str]], *, marks_best: bool = True) -> str:
    """A table as HTML, with the smallest number of each column marked, unless it tells of honesty."""
    is_marked = marks_best and not title.startswith("Honesty")
    best = [_best([row[i] for row in rows]) if is_marked else None for i in range(len(head))]
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
