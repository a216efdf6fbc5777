"""The error of this room."""

from pipeline.errors import UsageError


class ExportError(UsageError):
    """A build that a format cannot hold, or a wrong request."""
