"""Write the records of the report page as TypeScript, src/records.ts: Python states them once.

python web/record_types.py [--check]
"""

import argparse
import dataclasses
import inspect
import sys
import types
import typing
from pathlib import Path

from pipeline.plugins.report import records

PLACE = Path(__file__).parent / "src/records.ts"
_WORDS = {int: "number", float: "number", str: "string", bool: "boolean", type(None): "null", typing.Any: "any"}


def type_of(hint: object) -> str:
    """TypeScript of an annotation."""
    if hint in _WORDS:
        return _WORDS[typing.cast(type, hint)]
    if dataclasses.is_dataclass(hint):
        return typing.cast(type, hint).__name__
    origin, kinds = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return " | ".join(type_of(kind) for kind in kinds)
    if origin is dict:
        return f"Record<string, {type_of(kinds[1])}>"
    if origin is tuple and kinds[-1] is Ellipsis:
        inner = type_of(kinds[0])
        return f"({inner})[]" if "|" in inner else f"{inner}[]"
    if origin is tuple:
        return f"[{', '.join(type_of(kind) for kind in kinds)}]"
    raise TypeError(f"no TypeScript for {hint!r}")


def text() -> str:
    """The whole module."""
    kinds = [kind for kind in vars(records).values() if dataclasses.is_dataclass(kind)]
    lines = ["// Written by web/record_types.py from pipeline/plugins/report/records.py: edit that.", ""]
    for kind in kinds:
        hints = typing.get_type_hints(kind)
        lines += [f"/** {(inspect.getdoc(kind) or '').splitlines()[0]} */", f"export interface {kind.__name__} {{"]
        lines += [f"  {one.name}: {type_of(hints[one.name])};" for one in dataclasses.fields(kind)]
        lines += ["}", ""]
    return "\n".join(lines)


def main() -> int:
    """Write or check; 1 if it is stale."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="only say whether the file is fresh")
    asked = parser.parse_args()
    if asked.check:
        fresh = PLACE.is_file() and PLACE.read_text(encoding="utf-8") == text()
        if not fresh:
            print(f"{PLACE} is stale: run python web/record_types.py", file=sys.stderr)
        return 0 if fresh else 1
    PLACE.write_text(text(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
