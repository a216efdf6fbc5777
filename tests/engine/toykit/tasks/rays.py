"""The dear task: two outputs, one of them in a folder."""


def run(params, inputs, out):
    """Write two planes."""
    lens = inputs["lens"]["lens.txt"].read_text()
    (out / "near.bin").write_bytes(f"near {lens} {params['samples']}".encode() * 100)
    (out / "planes").mkdir()
    (out / "planes" / "far.bin").write_bytes(f"far {lens} {params['samples']}".encode() * 100)
