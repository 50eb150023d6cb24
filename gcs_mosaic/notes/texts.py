"""Names and times as they are shown."""

from __future__ import annotations

from datetime import UTC, datetime


def shown(text: str) -> str:
    """A name that may hold undecodable bytes or control characters, for showing."""
    told = text.encode("utf-8", "replace").decode("utf-8")
    return "".join(letter if letter.isprintable() else "\ufffd" for letter in told)


def iso(utc: float) -> str:
    """Seconds since 1970 as ISO 8601, in UTC."""
    return datetime.fromtimestamp(utc, UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
