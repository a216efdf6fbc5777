"""Arrays at the borders have shapes: public parameters and fields are annotated, and tests check every call."""

import ast
import importlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import checked_shapes
import jaxtyping
import numpy as np
import pytest

from pipeline.camera.pupil.chief_ray import chief_slopes
from pipeline.camera.rig import Rig
from pipeline.frames import apply

PACKAGE = Path(__file__).parents[2] / "pipeline"
KERNELS = {"kernel", "opaque", "unit", "inline", "DeviceKernel"}
"""Decorators of functions that Numba compiles: they take what it infers."""
ROOMS = ("camera", "optics", "targets", "truth", "render")


def public(body: list[ast.stmt], before: str = "") -> Iterator[tuple[str, ast.expr]]:
    """Annotations of parameters of functions, and of fields of records, that other modules may see."""
    for node in body:
        if isinstance(node, ast.FunctionDef) and (not node.name.startswith("_") or node.name == "__init__"):
            decorators = {getattr(one, "id", "") for one in node.decorator_list}
            for one in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs):
                if one.annotation is not None and not decorators & KERNELS:
                    yield f"{before}{node.name}: {one.arg}", one.annotation
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_") and not is_for_kernels(node):
            is_record = any("dataclass" in ast.unparse(one) for one in node.decorator_list)
            body = [one for one in node.body if is_record or not isinstance(one, ast.AnnAssign)]
            yield from public(body, f"{before}{node.name}.")
        elif isinstance(node, ast.AnnAssign) and before and isinstance(node.target, ast.Name):
            yield f"{before}{node.target.id}", node.annotation


def is_for_kernels(node: ast.ClassDef) -> bool:
    return "NamedTuple" in map(ast.unparse, node.bases)


def test_public_arrays_have_shapes() -> None:
    """Kernels are exempt, and NamedTuples, which they take; arrays in containers have no one shape."""
    bare = []
    for path in sorted(file for room in ROOMS for file in (PACKAGE / room).rglob("*.py")):
        tree = ast.parse(path.read_bytes())
        bare += [
            f"{path.relative_to(PACKAGE)}: {name}"
            for name, annotation in public(tree.body)
            if set(map(str.strip, ast.unparse(annotation).split("|"))) & {"np.ndarray"}
        ]
    assert bare == []


def test_a_wrong_shape_at_a_border_is_caught() -> None:
    """By the number of axes, the length of one, two that differ, and the kind of number; of records, too."""
    table, points = np.zeros((3, 20)), np.zeros((4, 3))
    with pytest.raises(jaxtyping.TypeCheckError, match="points_mm"):
        chief_slopes(table, 1, points[:, :2])
    with pytest.raises(jaxtyping.TypeCheckError, match="table"):
        chief_slopes(table[0], 1, points)
    with pytest.raises(jaxtyping.TypeCheckError, match="points_mm"):
        chief_slopes(table, 1, points.astype(np.float32))
    with pytest.raises(jaxtyping.TypeCheckError):
        apply(np.eye(3), points)


def test_all_modules_are_checked() -> None:
    """Every function and record with a shape, in modules that are imported while the tests run."""
    for path in sorted(file for room in ROOMS for file in (PACKAGE / room).rglob("*.py")):
        module = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
        if path.stem == "__init__" or "device" in path.stem:
            continue
        importlib.import_module(module)
        tree = ast.parse(path.read_bytes())
        shaped = {name for name, annotation in public(tree.body) if "[np.ndarray, " in ast.unparse(annotation)}
        for name in shaped:
            owner = name.partition(":")[0] if ":" in name else name.rpartition(".")[0]
            assert f"{module}.{owner}" in checked_shapes.CHECKED | {f"{module}.{owner}.__init__"}, name


def test_nothing_of_it_is_imported_at_run_time() -> None:
    program = f"import sys, {Rig.__module__}; print(sorted({{'jaxtyping', 'beartype'}} & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert found.stdout == "[]\n"
