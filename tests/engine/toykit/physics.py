"""What the toy tasks call."""


def doubled(x):
    """Twice x."""
    return x * 2
