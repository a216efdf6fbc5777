"""Meets a full disk."""

import errno


def run(params, inputs, out):
    """Raise what the operating system raises."""
    raise OSError(errno.ENOSPC, "No space left on device")
