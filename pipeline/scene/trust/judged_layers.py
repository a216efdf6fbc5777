"""Layers of the very bytes that were looked at, whatever lies under their names meanwhile."""

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
    """A layer of the bytes of a file; None if nothing knows its format, which USD says with its place.

    Parameters
    ----------
    confined : bool
        Whether this process can neither write a copy nor read anything that a stage may not.

    Raises
    ------
    Tf.ErrorException
        USD cannot read these bytes.
    StageError
        USD had to open the file by its name, and got another one.
    """
    known = Sdf.Layer.Find(identifier)
    kind = Sdf.FileFormat.FindByExtension(resolved)
    if known or kind is None:
        return known  # a caller may have it open
    if file.is_package or not hasattr(os, "memfd_create"):  # USD makes no packages of bytes
        return Sdf.Layer.FindOrOpen(identifier) if confined else _by_name(identifier, resolved, file)
    layer = Sdf.Layer.New(kind, resolved)
    with os.fdopen(os.memfd_create("layer"), "wb") as copy:
        copy.write(file.data)
        copy.flush()
        layer.Import(f"/proc/self/fd/{copy.fileno()}")
    return layer


def _by_name(identifier: str, resolved: str, file: LayerFile) -> Sdf.Layer | None:
    """A layer that USD opens itself, if it says what a copy of the bytes says that nobody else can write to."""
    name = file_of(resolved)
    with _private_copy(file.data, Path(name).suffix) as copy:
        judged = Sdf.Layer.FindOrOpen(resolved.replace(name, copy, 1))
        try:
            layer = Sdf.Layer.FindOrOpen(identifier)
        except Tf.ErrorException:
            layer = None  # what it quotes is of another file
        if _said(layer) != _said(judged):
            raise StageError([changed(name)])
        return layer


@contextmanager
def _private_copy(data: bytes, suffix: str) -> Iterator[str]:
    """The name of a file of some bytes, in a folder for this user alone, in a form that messages of `opening` know."""
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
