"""Errors of targets."""

from pipeline.errors import PipelineError


class TargetError(PipelineError):
    """A target that cannot be built, or that would not have one orientation."""

    code = "bad-target"
