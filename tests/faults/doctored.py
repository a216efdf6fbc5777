"""Output folders that somebody doctored so that every digest of the manifest fits, and odd things in place of files."""

import hashlib
import json
import os
import random
import re
import shutil
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

Doctor = Callable[[Path, random.Random], None]


def sign(out: Path, *names: str) -> None:
    """Write the digests of files, as they are now, into the manifest."""
    path = out / "manifest.json"
    manifest = json.loads(path.read_text(encoding="utf-8"))
    for name in names:
        data = (out / name).read_bytes()
        manifest["files"][name] = {"sha256": hashlib.sha256(data).hexdigest(), "size": len(data)}
    path.unlink()
    path.write_text(json.dumps(manifest), encoding="utf-8")


def tables(out: Path) -> list[Path]:
    """All tables of correspondences of a folder."""
    return sorted(out.glob("frames/*/*/correspondences.csv"))


def edit_rows(path: Path, edit: Callable[[list[dict[str, str]]], list[dict[str, str]]]) -> None:
    """Rewrite the rows of a table, each a dict of cells."""
    lines = path.read_text(encoding="utf-8").splitlines()
    start = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    names = lines[start].split(",")
    rows = edit([dict(zip(names, line.split(","), strict=True)) for line in lines[start + 1 :]])
    path.unlink()
    path.write_text("\n".join([*lines[: start + 1], *(",".join(row.values()) for row in rows), ""]), encoding="utf-8")


def in_all_rows(column: str, change: Callable[[str], str]) -> Doctor:
    """Another value of a column in every row of every table; empty cells stay."""

    def edit(rows: list[dict[str, str]]) -> list[dict[str, str]]:
        return [{**row, column: change(row[column]) if row[column] else ""} for row in rows]

    def doctor(out: Path, chance: random.Random) -> None:
        for path in tables(out):
            edit_rows(path, edit)
        sign(out, *(path.relative_to(out).as_posix() for path in tables(out)))

    return doctor


def with_counts(edit: Callable[[list[dict[str, str]]], list[dict[str, str]]]) -> Doctor:
    """Other rows in one table; comments and manifest count them as if they were right."""

    def doctor(out: Path, chance: random.Random) -> None:
        path = chance.choice(tables(out))
        counts: dict[str, list[int]] = {}

        def counted(rows: list[dict[str, str]]) -> list[dict[str, str]]:
            for found in (rows, new := edit(rows)):
                for target in {row["target"] for row in rows}:
                    counts.setdefault(target, []).append(sum(row["target"] == target for row in found))
            counts["rows"] = [len(new), len({(row["target"], row["point_id"]) for row in new})]
            return new

        edit_rows(path, counted)
        frame, camera = path.parent.parent.name, path.parent.name
        rows, seen = counts.pop("rows")
        text = path.read_text(encoding="utf-8")
        for before, after in counts.values():
            text = text.replace(f" rows {before}", f" rows {after}", 1)
        path.unlink()
        path.write_text(text, encoding="utf-8")
        sign(out, path.relative_to(out).as_posix())
        manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
        for entry in manifest["points"][camera]["frames"]:
            if entry["frame"] == int(frame):
                entry.update(rows=rows, seen={next(iter(counts)): seen})
        (out / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")

    return doctor


def times(factor: float) -> Callable[[str], str]:
    """A number multiplied."""
    return lambda cell: repr(float(cell) * factor)


def plus(summand: float) -> Callable[[str], str]:
    """A number moved."""
    return lambda cell: repr(float(cell) + summand)


def scaled_blur(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    """Blur and its radius 30 % wider, so that they agree with each other."""
    for row in rows:
        for name in ("blur_xx_px2", "blur_xy_px2", "blur_yy_px2"):
            row[name] = repr(1.69 * float(row[name])) if row[name] else ""
        xx, yy = row["blur_xx_px2"], row["blur_yy_px2"]
        if xx:
            radius = (2 * (float(xx) + float(yy))) ** 0.5
            row["rho_px"] = repr(radius if float(row["rho_px"]) > 0 else -radius)
    return rows


def swapped_methods(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    """Rows of position images said to be direct, and the reverse."""
    others = {"direct": "moments", "moments": "direct"}
    return [{**row, "method": others[row["method"]]} for row in rows]


def all_tables(edit: Callable[[list[dict[str, str]]], list[dict[str, str]]]) -> Doctor:
    """The same edit in every table."""

    def doctor(out: Path, chance: random.Random) -> None:
        for path in tables(out):
            edit_rows(path, edit)
        sign(out, *(path.relative_to(out).as_posix() for path in tables(out)))

    return doctor


def signed(name: str, change: Callable[[bytes], bytes]) -> Doctor:
    """Other bytes of a file, with their digest in the manifest."""

    def doctor(out: Path, chance: random.Random) -> None:
        path = out / name
        data = change(path.read_bytes())
        path.unlink()
        path.write_bytes(data)
        sign(out, name)

    return doctor


LIES: dict[str, Doctor] = {
    "frame": in_all_rows("frame", lambda cell: str(int(cell) + 1)),
    "camera": in_all_rows("camera", lambda cell: "Other"),
    "target": in_all_rows("target", lambda cell: "Other"),
    "point_id": in_all_rows("point_id", lambda cell: str((int(cell) + 1) % 6)),
    "microlens_k": in_all_rows("microlens_k", lambda cell: str(int(cell) + 1)),
    "microlens_l": in_all_rows("microlens_l", lambda cell: str(int(cell) - 1)),
    "microlens_type": in_all_rows("microlens_type", lambda cell: str((int(cell) + 1) % 3)),
    "x_px": in_all_rows("x_px", plus(0.02)),
    "y_px": in_all_rows("y_px", plus(-0.02)),
    "sigma_x_px": in_all_rows("sigma_x_px", lambda cell: "0.01"),
    "sigma_y_px": in_all_rows("sigma_y_px", lambda cell: "0.01"),
    "target_x_mm": in_all_rows("target_x_mm", plus(0.01)),
    "target_y_mm": in_all_rows("target_y_mm", plus(0.01)),
    "target_z_mm": in_all_rows("target_z_mm", plus(0.01)),
    "camera_x_mm": in_all_rows("camera_x_mm", plus(0.01)),
    "camera_y_mm": in_all_rows("camera_y_mm", plus(0.01)),
    "camera_z_mm": in_all_rows("camera_z_mm", plus(0.01)),
    "hit_fraction": in_all_rows("hit_fraction", times(0.98)),
    "visibility": in_all_rows("visibility", lambda cell: "0.9"),
    "blur_xx_px2": in_all_rows("blur_xx_px2", times(1.2)),
    "blur_xy_px2": in_all_rows("blur_xy_px2", plus(0.01)),
    "blur_yy_px2": in_all_rows("blur_yy_px2", times(1.2)),
    "rho_px": in_all_rows("rho_px", times(-1)),
    "blur and rho": all_tables(scaled_blur),
    "method": all_tables(swapped_methods),
    "empty cells": in_all_rows("hit_fraction", lambda cell: ""),
    "rows dropped": with_counts(lambda rows: rows[: len(rows) // 2]),
    "rows three times": with_counts(lambda rows: [row for row in rows for _ in range(3)]),
    "no row left": with_counts(lambda rows: []),
    "rows in another order": all_tables(lambda rows: rows[::-1]),
    "another pose": signed(
        "dataset.usda", lambda data: re.sub(rb"(translate.*?\n\s*1: \(-?\d+)", rb"\g<1>1", data, count=1)
    ),
    "another seed": signed("dataset.usda", lambda data: re.sub(rb"(plen:seed = \d+)", rb"\g<1>1", data)),
}
"""What a folder may say that is not true: what it is about, and how it is put there."""


def put(make: Callable[[Path], object]) -> Callable[[Path], None]:
    """Something else in the place of a file."""

    def act(path: Path) -> None:
        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
        make(path)

    return act


def _socket(path: Path) -> None:
    """A socket; its name must be short, so it is made from within its folder."""
    here = Path.cwd()
    os.chdir(path.parent)
    try:
        socket.socket(socket.AF_UNIX).bind(path.name)
    finally:
        os.chdir(here)


def _grown(path: Path) -> None:
    with path.open("wb") as stream:
        stream.truncate(1 << 40)


ODDITIES: dict[str, Callable[[Path], None]] = {
    "lost": lambda path: path.unlink(),
    "FIFO": put(os.mkfifo),
    "socket": put(_socket),
    "folder": put(Path.mkdir),
    "link to nothing": put(lambda path: path.symlink_to("/nonexistent")),
    "link to /dev/zero": put(lambda path: path.symlink_to("/dev/zero")),
    "link to itself": put(lambda path: path.symlink_to(path)),
    "link to another file": put(lambda path: path.symlink_to("/etc/passwd")),
    "a terabyte of holes": put(_grown),
    "empty": lambda path: path.write_bytes(b""),
    "cut": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    "not UTF-8": lambda path: path.write_bytes(b"\xff\xfe" + path.read_bytes()),
    "NUL": lambda path: path.write_bytes(b"\0" * 4096),
    "deep": lambda path: path.write_bytes(b"[" * 100_000),
}
"""What may lie in the place of a file."""


def odd_files(out: Path) -> Iterator[tuple[str, str]]:
    """Each file of a folder with each oddity."""
    listed = sorted(json.loads((out / "manifest.json").read_text(encoding="utf-8"))["files"])
    for name in ["manifest.json", *listed]:
        for what in ODDITIES:
            yield name, what


HEAD = '#usda 1.0\n(\n    defaultPrim = "A"\n    metersPerUnit = 0.001\n    upAxis = "Y"\n)\n'
STAGES: dict[str, bytes] = {
    "nothing": b"",
    "another language": b"\xff\xfe#usda 1.0",
    "no dataset": f'{HEAD}def Xform "A"\n{{\n}}\n'.encode(),
    "100,000 nested prims": (HEAD + 'def Xform "A"\n{\n' * 100_000 + "}\n" * 100_000).encode(),
    "a file outside": f'{HEAD}def "A" (prepend references = @/etc/passwd@)\n{{\n}}\n'.encode(),
    "a file of the folder": f'{HEAD}def "A" (prepend references = @./manifest.json@)\n{{\n}}\n'.encode(),
    "itself": f'{HEAD}def "A" (prepend references = @./dataset.usda@</A>)\n{{\n}}\n'.encode(),
}
"""Stages that no build made."""


def damaged_files(out: Path) -> Iterator[tuple[str, str, Doctor]]:
    """Every file cut, emptied, flipped or of another kind, with digests that fit: name, what, and how."""
    listed = sorted(json.loads((out / "manifest.json").read_text(encoding="utf-8"))["files"])
    for name in listed:
        yield name, "cut", signed(name, lambda data: data[: len(data) // 2])
        yield name, "empty", signed(name, lambda data: b"")
        yield name, "deep", signed(name, lambda data: b"[" * 100_000)
        yield name, "not UTF-8", signed(name, lambda data: b"\xff\xfe" + data)
        if name.endswith(".exr"):
            yield name, "one bit", signed(name, lambda data: data[:-100] + bytes([data[-100] ^ 1]) + data[-99:])


MANIFESTS: dict[str, bytes] = {
    "a list": b"[]",
    "deep": b"[" * 100_000,
    "deep files": b'{"format": 1, "tasks": {}, "files": ' + b'{"a":' * 100_000,
    "no files": b'{"format": 1, "tasks": {}, "files": {}}',
    "files of another type": b'{"format": 1, "tasks": {}, "files": [1, 2]}',
    "a path that leaves": b'{"format": 1, "tasks": {}, "files": {"dataset.usda": 1, "../../etc/passwd": {}}}',
    "NaN": b'{"format": NaN}',
    "a huge number": b'{"format": ' + b"9" * 5000 + b"}",
}
"""Manifests that are none."""


def entries(**changes: object) -> Callable[[dict], None]:
    """Changes of a manifest's entry for dataset.usda."""
    return lambda manifest: manifest["files"]["dataset.usda"].update(changes)


ENTRIES: dict[str, Callable[[dict], None]] = {
    "size a text": entries(size="1"),
    "size negative": entries(size=-1),
    "size true": entries(size=True),
    "size of an exabyte": entries(size=1 << 60),
    "digest a number": entries(sha256=5),
    "digest short": entries(sha256="ab"),
    "a path that leaves": lambda manifest: manifest["files"].update({"../x": {"sha256": "0" * 64, "size": 1}}),
    "an absolute path": lambda manifest: manifest["files"].update({"/etc/passwd": {"sha256": "0" * 64, "size": 1}}),
    "half a character": lambda manifest: manifest["files"].update({"\ud800": {"sha256": "0" * 64, "size": 1}}),
    "a long path": lambda manifest: manifest["files"].update({"x" * 5000: {"sha256": "0" * 64, "size": 1}}),
    "a path of a file": lambda manifest: manifest["files"].update({"dataset.usda/x": {"sha256": "0" * 64, "size": 1}}),
    "escapes": lambda manifest: manifest["files"].update({"\x1b[31mx": {"sha256": "0" * 64, "size": 1}}),
    "no tables": lambda manifest: [
        manifest["files"].pop(name) for name in list(manifest["files"]) if name.startswith("frames/")
    ],
    "points of another type": lambda manifest: manifest.update(points=[1]),
    "frames of another type": lambda manifest: manifest.update(points={"Rig.Camera": {"frames": 5}}),
    "no points": lambda manifest: manifest.pop("points"),
}
"""Manifests with one wrong entry."""
