"""Errors of cameras."""

from pipeline.errors import PipelineError


class CameraError(PipelineError):
    """A camera that cannot be built from its parts."""
