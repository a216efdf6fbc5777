"""The default folder of results and compiled kernels."""

import os
from pathlib import Path

from pipeline.errors import EnvironmentFault


def user_cache() -> Path:
    """`plenoptic-pipeline/` in $XDG_CACHE_HOME, else in `.cache/` of the user's home.

    Raises
    ------
    EnvironmentFault
        The user has no home, as in a container that runs under a user number without a name.
    """
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        return (Path(base) if base else Path.home() / ".cache") / "plenoptic-pipeline"
    except RuntimeError:
        raise EnvironmentFault(
            f"user {os.geteuid()} has no home: HOME is not set, and no entry of the system says where it is",
            hint="set XDG_CACHE_HOME to a folder that you may write to: results and compiled kernels are kept there",
        ) from None
