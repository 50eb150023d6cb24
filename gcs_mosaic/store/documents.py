"""JSON files that other programs read while they are being written: dataclasses whose annotations tell units and limits.

A field that has None as its default is left out while it is that.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from gcs_mosaic.store.disk import write_beside

Document = dict[str, object]


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What a value may be that is asked or answered, beside its type in an annotation."""

    least: float | None = None
    most: float | None = None
    shortest: int | None = None  # characters
    longest: int | None = None
    pattern: str | None = None  # of the whole text
    lines: bool = False  # a text may have line ends


def write_json(path: Path, document: object) -> None:
    """Write a document atomically. Raises DiskFull, and ValueError for NaN or infinity."""
    write_beside(path, compact(document).encode("ascii"))


def compact(document: object) -> str:
    """JSON on one line, in ASCII. Raises ValueError for NaN or infinity."""
    return json.dumps(document, allow_nan=False, separators=(",", ":"), default=told_of)


def told_of(value: Any) -> dict[str, Any]:
    """What `json.dumps` makes a dataclass of: `from_` is `from`. Raises TypeError for anything else."""
    told = ((one, getattr(value, one.name)) for one in fields(value))
    return {one.name.rstrip("_"): each for one, each in told if each is not None or one.default is not None}


def finite(value: float) -> float | None:
    """The number, or None (null) for NaN and infinity."""
    return float(value) if math.isfinite(value) else None


def iso_utc(seconds: float) -> str:
    """Seconds since 1970 as ISO 8601 with milliseconds, such as 2024-05-01T12:00:00.250Z."""
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
