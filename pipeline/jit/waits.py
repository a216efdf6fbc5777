"""What is done before kernels are compiled; apart, because the command begins with it, and imports little."""

from collections.abc import Callable

before_compiling: list[Callable[[], None]] = []
"""Functions called once, before this process compiles a kernel that the cache lacks. A command explains the wait."""
