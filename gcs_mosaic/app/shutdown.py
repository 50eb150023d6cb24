"""How a flight is told to end."""

from __future__ import annotations

import threading
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Shutdown:
    """`stop` asks for the end, `hurry` for leaving out what may be left out."""

    stop: threading.Event
    hurry: threading.Event
