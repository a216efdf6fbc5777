"""A lens is a rounded power: near values give the same bytes."""

from toykit import physics


def run(params, inputs, out):
    """Write the power."""
    (out / "lens.txt").write_text(str(physics.doubled(round(params["power"]))))
