"""Texts from outside, as SQLite can store them."""

from __future__ import annotations

Stored = str | bytes | None


def stored(text: str | None) -> Stored:
    """External text as SQLite can store it: file names may contain undecodable bytes."""
    if text is None:
        return None
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        return text.encode("utf-8", "surrogatepass")
    return text


def restored(value: Stored) -> str | None:
    """Inverse of `stored`."""
    return value.decode("utf-8", "surrogatepass") if isinstance(value, bytes) else value
