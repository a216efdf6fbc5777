"""Writes a link instead of a file."""


def run(params, inputs, out):
    """Point at a file of the machine."""
    (out / "passwd").symlink_to("/etc/passwd")
