"""Calibration images through real lenses and microlens arrays, with exact ground truth.

`pipeline.build(path)` builds a dataset stage, `pipeline.open_dataset(path)` reads one into plain records,
`pipeline.Prescription`, `pipeline.Camera` and their friends are the physics, usable without USD.
Nothing heavy is imported before it is asked for (PEP 562). Importing this tells NumPy, OpenBLAS and Numba, by the
environment, what to compute with, so that results do not depend on the processor: docs/engine.md, The machine.
"""

from pipeline.processor import pin

TYPE_CHECKING = False
if TYPE_CHECKING:  # the command begins here, and Ctrl-C means something else until it has looked after that
    from typing import Any

pin()  # before anybody imports NumPy

__version__ = "0.1.0"

_HOMES = {
    "Surface": "pipeline.optics.prescription",
    "Prescription": "pipeline.optics.prescription",
    "Camera": "pipeline.camera.camera",
    "Sensor": "pipeline.camera.camera",
    "MicrolensArray": "pipeline.camera.camera",
    "Checkerboard": "pipeline.target.checkerboard",
    "Target": "pipeline.target.target",
    "open_dataset": "pipeline.scene.load",
    "build": "pipeline.tasks.build",
}
__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> "Any":
    if name in _HOMES:
        from importlib import import_module

        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
