"""Shutdown signals of a flight."""

from __future__ import annotations

import threading
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Shutdown:
    """`stop` requests the end, `hurry` also skips optional work."""

    stop: threading.Event
    hurry: threading.Event
