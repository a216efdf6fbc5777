"""The reference of the schema: docs/schema/*.md, from schemas/plenScene and docs/schema.toml.

    python docs/schema_reference.py            say which pages are stale
    python docs/schema_reference.py --write    write them

The schema says what a model simulates and what each attribute means; docs/schema.toml says where the model begins, what
comes out of it, and on which page it stands.
"""

import argparse
import re
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from pxr import Sdf

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "schemas/plenScene/resources/plenScene/schema.usda"
PAGES, BESIDE = ROOT / "docs/schema", ROOT / "docs/schema.toml"
FACT = re.compile(r"^(Range|Entries|Units|Needed with|Only with): (.*(?:\n(?!\w[\w ]*: ).*)*)$", re.MULTILINE)
"""A line of a doc that `pipeline check` enforces, or the unit."""
DO_NOT_EDIT = "<!-- python docs/schema_reference.py --write -->"


@dataclass(frozen=True)
class Model:
    """A page: some classes of the schema that one model reads."""

    page: str
    title: str
    classes: list[str]
    begins: str
    outputs: str
    more: str

    @property
    def path(self) -> Path:
        """The file of the page."""
        return PAGES / f"{self.page}.md"


def models() -> list[Model]:
    """The pages in their order; `outputs` and `more` are Markdown. A class has those that inherit it on its page."""
    with BESIDE.open("rb") as file:
        rows = tomllib.load(file)["model"]
    return [Model(**{**row, "classes": [heir for name in row["classes"] for heir in with_heirs(name)]}) for row in rows]


@cache
def schema() -> Sdf.Layer:
    """The schema; its classes live as long as it does."""
    return Sdf.Layer.FindOrOpen(SOURCE.as_posix())


def classes() -> dict[str, Sdf.PrimSpec]:
    """Classes of the schema by name."""
    return {spec.name: spec for spec in schema().rootPrims if spec.name.startswith("Plen")}


def with_heirs(name: str) -> list[str]:
    """A class and those that inherit it, in the order of the schema."""
    base = Sdf.Path(f"/{name}")
    heirs = [spec.name for spec in classes().values() if base in spec.inheritPathList.GetAddedOrExplicitItems()]
    return [name, *heirs]


def page_of(model: Model) -> str:
    """A page as Markdown."""
    known = classes()
    specs = [known[name] for name in model.classes]
    simulated = [paragraphs(spec.documentation) for spec in specs]
    what = (
        simulated[0]
        if len(specs) == 1
        else "\n\n".join(f"**`{spec.name}`.** {text}" for spec, text in zip(specs, simulated, strict=True))
    )
    parts = ["---\ntocdepth: 2\n---\n", DO_NOT_EDIT, f"# {model.title}", "## What it simulates", what]
    parts += ["## Where the model begins", model.begins.strip(), "## Outputs", model.outputs.strip()]
    parts += [part for spec in specs for part in of_class(spec)]
    return "\n\n".join([*parts, "## More", model.more.strip()]) + "\n"


def of_class(spec: Sdf.PrimSpec) -> Iterator[str]:
    """Attributes of a class: a table, then each of them in the order of the schema."""
    inherits = [path.name for path in spec.inheritPathList.GetAddedOrExplicitItems()]
    base = next((name for name in inherits if name.startswith("Plen")), "")
    yield f"## {spec.name}"
    if base:
        yield f"It has all attributes of [{base}](#{base.lower()}), and:"
    yield "\n".join(["| attribute | type | unit | default |", "|---|---|---|---|", *map(row, spec.properties)])
    yield from map(entry, spec.properties)


def row(spec: Sdf.PropertySpec) -> str:
    """An attribute in the table of its class."""
    unit = facts(spec.documentation).get("Units", "")
    return f"| [`{spec.name}`](#{anchor(spec)}) | {kind(spec)} | {unit} | {default(spec)} |"


def entry(spec: Sdf.PropertySpec) -> str:
    """An attribute with its meaning and what `pipeline check` asks of it."""
    known = facts(spec.documentation)
    choices = (spec.GetInfo("allowedTokens") or []) if isinstance(spec, Sdf.AttributeSpec) else []
    told = [f"one of {', '.join(f'`{choice}`' for choice in choices)}"] if choices else []
    told += [f"{name.lower()} {value}" for name, value in known.items() if name in ("Range", "Entries")]
    told += [f"{name.lower()} `{value}`" for name, value in known.items() if name in ("Needed with", "Only with")]
    checked = f"\n\n*Checked:* {'; '.join(told)}." if told else ""
    return f"({anchor(spec)})=\n\n### {spec.name}\n\n{paragraphs(spec.documentation)}{checked}"


def anchor(spec: Sdf.PropertySpec) -> str:
    """Where an attribute is described: names such as plen:columns belong to several classes."""
    return f"{spec.path.GetPrimPath().name}-{spec.name.replace(':', '-')}".lower()


def kind(spec: Sdf.PropertySpec) -> str:
    """Type of a property."""
    return f"`{spec.typeName}`" if isinstance(spec, Sdf.AttributeSpec) else "relationship"


def default(spec: Sdf.PropertySpec) -> str:
    """Fallback of an attribute."""
    value = spec.default if isinstance(spec, Sdf.AttributeSpec) else None
    if value is None:
        return "–"
    if isinstance(value, str):
        return f"`{value}`" if value else "empty"
    return f"`{list(value) if hasattr(value, '__len__') else value}`"


def facts(doc: str) -> dict[str, str]:
    """Lines of a doc such as `Range:` by their names."""
    return {match[1]: " ".join(match[2].split()) for match in FACT.finditer(outdented(doc))}


def paragraphs(doc: str) -> str:
    """The sentences of a doc, without those lines, as Markdown."""
    prose = FACT.sub("", outdented(doc)).strip()
    text = "\n\n".join(" ".join(part.split()) for part in re.split(r"\n\s*\n", prose) if part.strip())
    return re.sub(r"(?<![\w`*])(plen:[\w:]*\w)", r"`\1`", re.sub(r"([<>*_\[\]])", r"\\\1", text))


def outdented(doc: str) -> str:
    """A doc without the indent of the schema's text."""
    return "\n".join(line.strip() for line in doc.splitlines())


def stale() -> dict[Path, str]:
    """Pages that are not what they should be, with what they should be; nothing for a page that should not exist."""
    wanted = {model.path: page_of(model) for model in models()}
    found = {path: path.read_text(encoding="utf-8") for path in PAGES.glob("*.md")}
    return {path: wanted.get(path, "") for path in sorted({*wanted, *found}) if wanted.get(path) != found.get(path)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write the pages")
    write = parser.parse_args().write
    pages = stale()
    for path, text in pages.items() if write else ():
        PAGES.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8") if text else path.unlink()
    print("wrote:" if write else "stale:", ", ".join(path.name for path in pages) or "nothing")
    return 1 if pages and not write else 0


if __name__ == "__main__":
    sys.exit(main())
