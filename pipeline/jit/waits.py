"""Functions to call before kernels are compiled. The command imports this module first, so it imports little itself."""

from collections.abc import Callable

before_compiling: list[Callable[[], None]] = []
"""Functions called once, before this process compiles a kernel that the cache lacks. A command explains the wait."""
