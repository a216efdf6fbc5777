"""Layers made of exactly the inspected bytes, even if the files change meanwhile."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pxr import Sdf, Tf

from pipeline.errors import EnvironmentFault
from pipeline.scene.trust.asset_roots import file_of
from pipeline.scene.usd.layer_files import LayerFile
from pipeline.scene.usd.opening import changed
from pipeline.scene.usd.problems import StageError


def layer_of(identifier: str, resolved: str, file: LayerFile, *, confined: bool) -> Sdf.Layer | None:
    """A layer made of the bytes of a file; None if its format is unknown, which USD reports with its place.

    Parameters
    ----------
    confined : bool
        Whether this process is confined: it cannot write a copy, nor read files that a stage may not read.

    Raises
    ------
    Tf.ErrorException
        USD cannot read these bytes.
    StageError
        USD had to open the file by its name, and its content had changed.
    """
    known = Sdf.Layer.Find(identifier)
    kind = Sdf.FileFormat.FindByExtension(resolved)
    if known or kind is None:
        return known  # a caller may have it open
    if file.is_package or not hasattr(os, "memfd_create"):  # USD cannot make a package from bytes
        return Sdf.Layer.FindOrOpen(identifier) if confined else _by_name(identifier, resolved, file)
    layer = Sdf.Layer.New(kind, resolved)
    with os.fdopen(os.memfd_create("layer"), "wb") as copy:
        copy.write(file.data)
        copy.flush()
        layer.Import(f"/proc/self/fd/{copy.fileno()}")
    return layer


def _by_name(identifier: str, resolved: str, file: LayerFile) -> Sdf.Layer | None:
    """A layer that USD opens by name, accepted if it equals a private copy of the inspected bytes."""
    name = file_of(resolved)
    with _private_copy(file.data, Path(name).suffix) as copy:
        judged = Sdf.Layer.FindOrOpen(resolved.replace(name, copy, 1))
        try:
            layer = Sdf.Layer.FindOrOpen(identifier)
        except Tf.ErrorException:
            layer = None  # its message would quote another file
        if _said(layer) != _said(judged):
            raise StageError([changed(name)])
        return layer


@contextmanager
def _private_copy(data: bytes, suffix: str) -> Iterator[str]:
    """Path of a private file with these bytes, in a form that `opening` recognises in messages."""
    try:
        folder = tempfile.TemporaryDirectory()
        (Path(folder.name) / f"judged{suffix}").write_bytes(data)
    except OSError as error:
        raise EnvironmentFault(f"cannot keep a copy of a package: {error}", hint="TMPDIR may name a folder") from None
    with folder as place:
        anchor = os.open(place, os.O_RDONLY | os.O_CLOEXEC)
        try:
            known = Path(f"/proc/self/fd/{anchor}")
            yield str((known if known.exists() else Path(place)) / f"judged{suffix}")
        finally:
            os.close(anchor)


def _said(layer: Sdf.Layer | None) -> str | None:
    return None if layer is None else layer.ExportToString()
