"""JSON files that other programs read while they are being written."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime
from pathlib import Path

from gcs_mosaic.store.disk import write_beside

FORMAT = 1  # of every JSON file in the output folder; raised on incompatible changes

Document = dict[str, object]


def write_json(path: Path, document: Document) -> None:
    """Write a document atomically. Raises DiskFull, and ValueError for NaN or infinity."""
    write_beside(path, compact(document).encode("ascii"))


def compact(document: Document) -> str:
    """JSON on one line, in ASCII. Raises ValueError for NaN or infinity."""
    return json.dumps(document, allow_nan=False, separators=(",", ":"))


def finite(value: float) -> float | None:
    """The number, or None (null) for NaN and infinity."""
    return float(value) if math.isfinite(value) else None


def iso_utc(seconds: float) -> str:
    """Seconds since 1970 as ISO 8601 with milliseconds, such as 2024-05-01T12:00:00.250Z."""
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
