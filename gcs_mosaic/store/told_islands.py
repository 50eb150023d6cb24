"""The islands of a mosaic.json, whoever has written it: numbers that cannot be an island's are refused before they are used."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gcs_mosaic.errors import UsageError
from gcs_mosaic.render.tile_grid import FINEST_LEVEL, HALF_SPAN
from gcs_mosaic.store.reading import MOSAIC_NAME, read_document

MOST_ISLANDS = 10**9  # numbers of islands are names of folders


def told_islands(flight: Path) -> list[dict[str, Any]]:
    """The entries of a flight's mosaic.json; empty if it ended before its first frame. Raises UsageError."""
    path = flight / MOSAIC_NAME
    try:
        return checked_islands(read_document(path))
    except FileNotFoundError:
        return []
    except (OSError, ValueError) as error:
        why = f"{path} is not a map that this gcs-mosaic can read ({error})"
        raise UsageError(f"{why}: update it, or see gcs-mosaic check") from error


def checked_islands(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Its entries. Raises ValueError if one is none."""
    entries = document.get("islands")
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise ValueError("its islands are no list of objects")
    for entry in entries:
        if not _is_island(entry):
            raise ValueError(f"island {str(entry.get('id'))[:20]} has numbers that no island has")
    return entries


def _is_island(entry: Mapping[str, Any]) -> bool:
    bounds, into = entry.get("bounds"), entry.get("merged_into")
    if not isinstance(bounds, list) or len(bounds) != 4 or not all(map(_is_on_canvas, bounds)):
        return False
    if not (bounds[0] <= bounds[2] and bounds[1] <= bounds[3]):
        return False
    levels, counts = (entry.get("minzoom"), entry.get("maxzoom")), (entry.get("id"), entry.get("frames"))
    return (
        all(_is_count(level, FINEST_LEVEL) for level in levels)
        and all(_is_count(count, MOST_ISLANDS) for count in counts)
        and (into is None or _is_count(into, MOST_ISLANDS))
    )


def _is_on_canvas(edge: object) -> bool:
    if not isinstance(edge, int | float) or isinstance(edge, bool):
        return False
    return abs(edge) <= 2 * HALF_SPAN  # which NaN is not


def _is_count(number: object, most: int) -> bool:
    return isinstance(number, int) and not isinstance(number, bool) and 0 <= number <= most
