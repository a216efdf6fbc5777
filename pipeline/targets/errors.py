"""What can be wrong with a target."""

from pipeline.errors import PipelineError


class TargetError(PipelineError):
    """A target that cannot be built, or that would not have one orientation.

    Attributes
    ----------
    code : str
        Name of the kind of problem, as `pipeline check` prints it.
    """

    def __init__(self, what: str, *, hint: str | None = None, code: str = "bad-target") -> None:
        super().__init__(what, hint=hint)
        self.code = code
