"""Numba, configured once. The only module that imports it.

Kernels are nogil float64 without fastmath (which would let the compiler assume that NaN does not occur) and without
parallel sums (which would depend on the number of threads).
"""

import ast
import hashlib
import os
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")


def cache_folder() -> Path:
    """Where compiled kernels are kept: $PIPELINE_JIT_CACHE, or `jit/` in the user's cache folder.

    Keyed by a digest of all our sources: Numba's own cache does not notice that a callee in another file changed.
    """
    home = os.environ.get("PIPELINE_JIT_CACHE")
    root = Path(home) if home else _user_cache() / "jit"
    return root / _source_digest()


def _user_cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "plenoptic-pipeline"


def _source_digest() -> str:
    package = Path(__file__).resolve().parent
    digest = hashlib.sha256()
    for room in ("optics", "camera", "target", "truth", "jit.py"):
        files = sorted((package / room).rglob("*.py")) or [package / room]
        for file in files:
            text = file.read_text(encoding="utf-8")
            if "pipeline.jit" in text or file.name == "jit.py":
                digest.update(ast.dump(ast.parse(text)).encode())
    return digest.hexdigest()[:16]


os.environ["NUMBA_CACHE_DIR"] = str(cache_folder())

import numba.extending  # noqa: E402  (the cache folder must be set before numba is imported)


def kernel(function: Any) -> Any:
    """Compile a driver: a function that loops over many rays or pixels, called from Python."""
    return numba.njit(cache=True, nogil=True, error_model="numpy")(function)


def inline(function: Any) -> Any:
    """Compile a scalar function that kernels call; LLVM inlines it into their loops."""
    return numba.njit(nogil=True, error_model="numpy")(function)


def _fma(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    double = numba.float64

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return double(double, double, double), code


fma: Any = numba.extending.intrinsic(_fma)
"""For kernels: a b + c, rounded once. The same bits everywhere; slow on machines without the instruction."""
