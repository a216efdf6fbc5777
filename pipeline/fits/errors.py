"""Errors of fits."""

from pipeline.errors import UsageError


class FitError(UsageError):
    """A camera that a model cannot stand for, or a model that does not exist."""
