"""Why there is no integral, each in a sentence that says what to do."""

from __future__ import annotations

from collections.abc import Sequence


def nobody_sees(island: int, x: float, y: float) -> str:
    """A place off the map."""
    return f"No frame of island {island} sees ({x:g}, {y:g}): give a place on its map."


def too_few(count: int, lost: Sequence[str]) -> str:
    """Of so many frames that see a place; `lost`: those whose originals cannot be read."""
    if count < 2:
        return "Only one frame sees this place, and an integral needs two at least: open the original instead."
    return (
        f"Of the {count} frames that see this place, the originals of {len(lost)} cannot be read ({lost[0]} is the first), and "
        "an integral needs two at least: bring them back with gcs-mosaic check --repair --frames DIR."
    )


def beyond(height: float, lowest: float, highest: float) -> str:
    """A focus where nothing is sought; shares of the flying height."""
    return (
        f"A focus at {height:.0%} of the flying height is beyond what can be sought: give one from {lowest:.0%} "
        f"(below the map's ground, which over woods may lie by the crowns) to {highest:.0%}."
    )


def apart(height: float, seen: int, looks: int) -> str:
    """Looks that do not overlap at a height."""
    return (
        f"At {height:.0%} of the flying height {seen} of {looks} frames see the middle of it, and an integral needs two at "
        "least: move the focus towards the ground, or open the aperture."
    )
