"""Derive generatedSchema.usda and plugInfo.json from plenScene/resources/plenScene/schema.usda.

Needs usd-core >= 26.8, whose wheel carries the templates of usdGenSchema, and jinja2.
With --check nothing is written, and stale files are an error.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

RESOURCES = Path(__file__).resolve().parent / "plenScene" / "resources"
SOURCE = RESOURCES / "plenScene" / "schema.usda"
DERIVED = ("generatedSchema.usda", "plugInfo.json")


def main() -> int:
    """Write what is stale, or only name it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing, fail if a file is stale")
    check = parser.parse_args().check
    if find_spec("jinja2") is None:
        sys.exit("schemas/generate.py needs jinja2: pip install jinja2")
    stale = stale_files()
    if not check:
        for name, data in stale.items():
            (RESOURCES / name).write_bytes(data)
    print("stale:" if check else "wrote:", ", ".join(stale) or "nothing")
    return 1 if check and stale else 0


def stale_files() -> dict[str, bytes]:
    """Contents of the derived files that differ from what lies beside the source."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        run_generator(out)
        restore_docs(out / "generatedSchema.usda")
        mend_plug_info(out / "plugInfo.json")
        fresh = {name: (out / name).read_bytes() for name in DERIVED}
    return {name: data for name, data in fresh.items() if _bytes_of(RESOURCES / name) != data}


def run_generator(out: Path) -> None:
    """Run usdGenSchema in a process of its own.

    It switches the schema registry off by an environment variable that only works before pxr is imported.
    """
    command = [sys.executable, "-m", "pxr.Usd.usdGenSchema", "--quiet", str(SOURCE), str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(done.stdout + done.stderr)


def restore_docs(path: Path) -> None:
    """Put back the full `doc` texts, of which usdGenSchema keeps one sentence.

    Sentences that come with USD's own properties are not ours to ship and are taken out.
    """
    from pxr import Sdf

    source = Sdf.Layer.FindOrOpen(SOURCE.as_posix())
    generated = Sdf.Layer.FindOrOpen(path.as_posix())
    for schema in generated.rootPrims:
        ancestry = list(_ancestry(source, schema.path))
        if ancestry and ancestry[0].documentation:
            schema.documentation = ancestry[0].documentation
        for prop in schema.properties:
            ours = next((c.properties[prop.name] for c in ancestry if prop.name in c.properties), None)
            if ours is None:
                prop.ClearInfo("customData")
            else:
                prop.documentation = ours.documentation
    generated.Save()
    # Line ends must not depend on the system that ran the generator.
    path.write_bytes(path.read_text(encoding="utf-8").rstrip("\n").encode() + b"\n")


def _ancestry(source: Any, path: Any) -> Iterator[Any]:
    """The class at `path` and its bases, as far as schema.usda defines them."""
    spec = source.GetPrimAtPath(path)
    while spec:
        yield spec
        bases = spec.inheritPathList.GetAddedOrExplicitItems()
        spec = source.GetPrimAtPath(bases[0]) if bases else None


def mend_plug_info(path: Path) -> None:
    """Fill the placeholders of a build system that we do not have, and drop the comments: JSON has none."""
    lines = path.read_text(encoding="utf-8").splitlines()
    info = json.loads("\n".join(line for line in lines if not line.lstrip().startswith("#")))
    for plugin in info["Plugins"]:
        plugin.update(Type="resource", Root="..", ResourcePath="resources", LibraryPath="")
    path.write_bytes((json.dumps(info, indent=4, sort_keys=True) + "\n").encode())


def _bytes_of(path: Path) -> bytes | None:
    return path.read_bytes() if path.exists() else None


if __name__ == "__main__":
    raise SystemExit(main())
