"""A path in a command that somebody is told to type: a shell would break it off at a space or an ampersand."""

from __future__ import annotations

import os
import re
import shlex
from pathlib import Path

PLAIN_ON_WINDOWS = re.compile(r"[\w:.\\/-]+")


def typed(path: Path | str) -> str:
    """As this system's shell takes it for one word; a plain path is left as it is."""
    return typed_on_windows(str(path)) if os.name == "nt" else shlex.quote(str(path))


def typed_on_windows(text: str) -> str:
    """No name there has a double quote, within which a space and an ampersand are as any letter."""
    return text if PLAIN_ON_WINDOWS.fullmatch(text) else f'"{text}"'
