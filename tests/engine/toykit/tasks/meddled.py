"""While it runs, somebody writes to what it reads, as often as it is told."""

import os
from pathlib import Path


def run(params, inputs, out):
    """Flip a bit of the input, read it, and maybe put it back: same size, same mtime."""
    path, tries = inputs["lens"]["lens.txt"], Path(params["folder"])
    if len(list(tries.iterdir())) < params["times"]:
        (tries / f"try{len(list(tries.iterdir()))}").touch()
        right, times = path.read_bytes(), path.stat()
        path.chmod(0o644)
        path.write_bytes(bytes([right[0] ^ 1]) + right[1:])
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        (out / "read.txt").write_bytes(path.read_bytes())
        if params["put_back"]:
            path.write_bytes(right)
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    else:
        (out / "read.txt").write_bytes(path.read_bytes())
