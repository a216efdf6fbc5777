"""Folders of the data that ships with the package: `schemas/` and `stages/`."""

from pathlib import Path


def share(name: str) -> Path:
    """Folder `name` of the shipped data.

    In an installed wheel it is in `pipeline/_share/`, in a checkout beside the package.
    """
    package = Path(__file__).resolve().parent
    installed = package / "_share" / name
    return installed if installed.is_dir() else package.parent / name
