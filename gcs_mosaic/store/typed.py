"""A path in a command that somebody is told to type: a shell would break it off at a space or an ampersand."""

from __future__ import annotations

import os
import shlex
import subprocess
from pathlib import Path


def typed(path: Path | str) -> str:
    """As this system's shell takes it for one word; a plain path is left as it is."""
    text = str(path)
    return subprocess.list2cmdline([text]) if os.name == "nt" else shlex.quote(text)
