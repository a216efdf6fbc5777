"""Calibration images through real lenses and microlens arrays, with exact ground truth.

`pipeline.build(path)` builds a dataset stage, `pipeline.open_dataset(path)` reads one into plain records,
`pipeline.open_output(out)` opens the folder of a build, `pipeline.ready(source)` makes a camera ready to project points
and to back-project pixels, and `pipeline.Prescription`, `pipeline.Camera` and related records are the physics, usable
without USD. Nothing heavy is imported before it is used (PEP 562), and importing this changes nothing in your process.
"""

import sys

if "t" in getattr(sys, "abiflags", ""):
    raise ImportError("USD crashes on free-threaded Python: use a Python 3.11 to 3.14 with its global lock")

TYPE_CHECKING = False
if TYPE_CHECKING:  # importing `typing` takes time, and Ctrl-C means nothing yet: the command begins here
    from typing import Any

    from pipeline.app.build import build as build

__version__ = "0.1.0"

_HOMES = {
    "Surface": "pipeline.optics.prescription",
    "Prescription": "pipeline.optics.prescription",
    "Camera": "pipeline.camera.parts.camera",
    "Sensor": "pipeline.camera.parts.camera",
    "MicrolensArray": "pipeline.camera.parts.microlens_array",
    "bundle": "pipeline.camera.bundle",
    "Checkerboard": "pipeline.targets.patterns.checkerboard",
    "Target": "pipeline.targets.target",
    "open_dataset": "pipeline.scene.load",
    "open_output": "pipeline.results.output",
    "ready": "pipeline.results.opening",
    "build": "pipeline.app.build",
}
__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> "Any":
    if name in _HOMES:
        from importlib import import_module

        if name == "build":
            from pipeline.machine.processor import pin

            pin()  # what imports it loads NumPy
        if name == "ready":  # whoever waits for a compiler is told so
            waits = import_module("pipeline.jit.waits")
            waits.before_compiling[:] = [lambda: import_module("pipeline.app.build").warm_up()]
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
