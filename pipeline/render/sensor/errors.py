"""Errors about sensors."""

from pipeline.errors import PipelineError


class SensorError(PipelineError):
    """A sensor that cannot be, or light that it cannot take."""
