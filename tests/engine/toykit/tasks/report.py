"""Reads all images."""


def run(params, inputs, out):
    """Write a page."""
    pages = [inputs[role]["image.txt"].read_text() for role in sorted(inputs)]
    (out / "index.html").write_text("\n".join(pages))
