"""Who may read what a flight writes."""

from __future__ import annotations

import os
from typing import Literal

Readers = Literal["owner", "group", "all"]
UMASKS: dict[Readers, int] = {"owner": 0o077, "group": 0o027, "all": 0o022}


def restrict(readers: Readers) -> None:
    """Let only these users of the computer read what this process and its children write from now on; nobody else writes.

    A stricter umask of the user stays as it is, and so do files and folders that are there already.
    """
    os.umask(os.umask(0o077) | UMASKS[readers])
