"""Errors of glasses. Each has the stable name under which `check` reports it."""

from pipeline.errors import PipelineError


class GlassError(PipelineError):
    """A medium whose index cannot be known."""

    code = "glass"


class UnknownGlass(GlassError):
    """No catalogue entry of this name."""

    code = "unknown-glass"


class AmbiguousGlass(GlassError):
    """A name without a vendor that several vendors use."""

    code = "ambiguous-glass"


class GlassMismatch(GlassError):
    """A catalogue entry whose index or Abbe number is not the printed one."""

    code = "glass-mismatch"


class OutOfRange(GlassError):
    """A wavelength for which the dispersion formula does not hold."""

    code = "wavelength-out-of-range"


class BadFormula(GlassError):
    """A written dispersion formula that cannot be evaluated."""

    code = "glass-formula"


class UnknownAbsorption(GlassError):
    """A glass whose absorption is in no table."""

    code = "unknown-absorption"


class BadAbsorption(GlassError):
    """An internal transmittance that no glass has."""

    code = "internal-transmittance"
