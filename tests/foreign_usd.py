"""USD without our schemas, in a process of its own: what programs of others see of our layers."""

import json
import os
import subprocess
import sys
from pathlib import Path


def foreign(script: str, layer: Path):
    """What a process without our schemas prints of a layer."""
    bare = {key: value for key, value in os.environ.items() if not key.startswith("PXR_")}
    run = [sys.executable, "-c", script, str(layer)]
    return json.loads(subprocess.run(run, capture_output=True, text=True, check=True, env=bare).stdout)
