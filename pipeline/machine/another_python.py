"""Command of another Python process that finds the same modules as this one, and none in the working directory."""

import json
import sys

_BOOT = "import json, sys; sys.path[:] = json.loads(sys.argv.pop(1)); from {0} import {1}; {1}()"


def command(function: str, *arguments: str) -> list[str]:
    """Command of a process that calls `module:name`, a function of ours without parameters, with these `sys.argv`.

    `-P`, because Python with `-c` looks for modules in the working directory first,
    where a json.py of somebody else would take the place of Python's.
    """
    return [sys.executable, "-P", "-c", _BOOT.format(*function.split(":")), json.dumps(sys.path), *arguments]
