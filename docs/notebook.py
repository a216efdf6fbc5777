"""Runs a notebook from its first cell to its last, as Jupyter does, and compares what it says with what it holds.

python docs/notebook.py docs/tutorial.ipynb           runs it, and says which cell prints something else
python docs/notebook.py docs/tutorial.ipynb --write   puts what it prints and draws into the file

No Jupyter is needed. Cells share their names; the value of the last expression is shown in its richest form, and
figures of matplotlib below the cell. Files go to a temporary folder.
"""

import argparse
import ast
import base64
import contextlib
import io
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

FORMS = (("image/svg+xml", "_repr_svg_"), ("text/html", "_repr_html_"), ("image/png", "_repr_png_"))
"""Rich forms of a value, as notebooks ask for them."""
_DPI = 60
"""Resolution of figures in the file [1/inch]: small enough to be committed."""


def main() -> int:
    """Run the notebook; 1 where a cell fails or prints something else."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("notebook", type=Path)
    parser.add_argument("--write", action="store_true", help="keep what it prints and draws")
    asked = parser.parse_args()
    text = asked.notebook.read_text(encoding="utf-8")
    book = json.loads(text)
    before = [printed(cell.get("outputs", [])) for cell in book["cells"]]
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        run(book["cells"])
    if asked.write:
        asked.notebook.write_text(json.dumps(book, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        return 0
    wrong = [i for i, cell in enumerate(book["cells"]) if printed(cell.get("outputs", [])) != before[i]]
    for i in wrong:
        print(f"cell {i + 1} prints {printed(book['cells'][i]['outputs'])!r}, the file says {before[i]!r}")
    return 1 if wrong else 0


def printed(outputs: list[dict[str, Any]]) -> list[str]:
    """Texts of the outputs of a cell, without pictures."""
    found = [one["text"] if one["output_type"] == "stream" else one["data"].get("text/plain", "") for one in outputs]
    return ["".join(text) for text in found]


def run(cells: list[dict[str, Any]]) -> None:
    """Run all cells of code, and put what they print and draw into them."""
    os.environ.setdefault("MPLBACKEND", "Agg")
    names: dict[str, Any] = {"__name__": "__main__"}
    number = 0
    for i, cell in enumerate(cells):
        if cell["cell_type"] != "code":
            continue
        number += 1
        cell["execution_count"] = number
        cell["outputs"] = outputs_of("".join(cell["source"]), f"cell {i + 1}", number, names)


def outputs_of(source: str, name: str, number: int, names: dict[str, Any]) -> list[dict[str, Any]]:
    """Run a cell; its outputs in the form of a notebook."""
    tree, said = ast.parse(source, name), io.StringIO()
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    value = None
    with contextlib.redirect_stdout(said):
        exec(compile(tree, name, "exec"), names)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), name, "eval"), names)
    outputs: list[dict[str, Any]] = []
    if said.getvalue():
        outputs.append({"output_type": "stream", "name": "stdout", "text": said.getvalue().splitlines(keepends=True)})
    figures = drawn()
    if value is not None and not figures:
        shown = {"output_type": "execute_result", "execution_count": number, "metadata": {}, "data": rich(value)}
        outputs.append(shown)
    for picture in figures:
        outputs.append({"output_type": "display_data", "metadata": {}, "data": {"image/png": picture}})
    return outputs


def rich(value: Any) -> dict[str, Any]:
    """A value in all forms that it has."""
    found: dict[str, Any] = {"text/plain": [repr(value) if not has_form(value) else f"<{type(value).__name__}>"]}
    for kind, method in FORMS:
        form = getattr(value, method, lambda: None)()
        if form is not None:
            found[kind] = base64.b64encode(form).decode() if isinstance(form, bytes) else form.splitlines(keepends=True)
    return found


def has_form(value: Any) -> bool:
    """Whether a value is more than its text: its text may then be long."""
    return any(hasattr(value, method) for _, method in FORMS)


def drawn() -> list[str]:
    """Open figures of matplotlib as PNG, base64; they are closed."""
    if "matplotlib.pyplot" not in sys.modules:
        return []
    from matplotlib import pyplot

    found = []
    for number in pyplot.get_fignums():
        file = io.BytesIO()
        pyplot.figure(number).savefig(file, format="png", dpi=_DPI, metadata={"Software": None})
        found.append(base64.b64encode(file.getvalue()).decode())
    pyplot.close("all")
    return found


if __name__ == "__main__":
    sys.exit(main())
