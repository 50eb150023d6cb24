"""What is known of each look at a person, from the picture without people, and whether the reader of fixed rule found it in the
one with people."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.detection.clutter import (
    FilteredPicture,
    GroundStatistics,
    disagreement,
    filtered,
    scores,
    statistics,
)
from gcs_mosaic.detection.looks import look_at
from gcs_mosaic.detection.model import DIRECTION_DEG, EACH, kept_contrast
from gcs_mosaic.detection.persons import POSTURES, Person
from gcs_mosaic.stitch.features.sharpness import sharpness
from gcs_mosaic.views.sharpness import relative_sharpness
from sitl.flight import Flight
from sitl.geometry import ground_from_pixels, pixels_from_ground
from tests.benchmarks.detection_scene import Floats, Peopled, Setting, on_the_floor

ALONE = 1.5  # sides around the middle of a person, within which all of one lies
MESH = 12  # columns and rows over which a picture is laid on another


@dataclass(frozen=True)
class Looks:
    """Of looks (n,) at people: whose, what is known, whether the reader found it. `direction`: number of a square of
    directions."""

    person: Floats
    in_sun: Floats
    in_shade: Floats
    kept: Floats
    texture: Floats
    disagreement: Floats
    direction: Floats
    found: Floats


@dataclass(frozen=True)
class Measured:
    """A frame for one posture, without and with people."""

    empty: FilteredPicture
    full: FilteredPicture
    ground: GroundStatistics
    clutter: NDArray[np.float32]  # scores without people


def measured(setting: Setting, cache: Path | None = None) -> Looks:
    """All looks of a flight; `cache`: folder of painted worlds."""
    peopled = Peopled(setting, cache)
    flight, lens = peopled.flight, peopled.scene.camera.lens
    pictures = [peopled.pictures(index) for index in range(len(flight.states))]
    shares = sharpness_of(flight, [one for one, _ in pictures])
    rows: list[Floats] = []
    for posture in POSTURES:
        side_px = Person(posture=posture).side_m * lens.focal_px / setting.height
        frames = [_measured(empty, full, side_px) for empty, full in pictures]
        threshold = _threshold(frames)
        for index, frame in enumerate(frames):
            differs = _differs(flight, frames, index)
            rows += _rows(peopled, index, frame, differs, shares[index], posture, threshold)
    table = np.array(rows)
    return Looks(*table.T)


def sharpness_of(flight: Flight, pictures: Sequence[NDArray[np.uint8]]) -> Floats:
    """Of each frame, beside those around."""
    lens = flight.scene.camera.lens
    corners = np.array([(0, 0), (lens.width, 0), (lens.width, lens.height), (0, lens.height)], float)
    outlines = np.array([ground_from_pixels(lens, state, corners) for state in flight.states])
    boxes = np.hstack([outlines.min(axis=1), outlines.max(axis=1)])
    return relative_sharpness(np.zeros(len(boxes), int), boxes, [sharpness(one) for one in pictures])


def _measured(empty: NDArray[np.uint8], full: NDArray[np.uint8], side_px: float) -> Measured:
    one, other = filtered(empty, side_px), filtered(full, side_px)
    ground = statistics(one)
    return Measured(one, other, ground, scores(one, ground.covariances))


def _threshold(frames: Sequence[Measured]) -> float:
    """What the pictures without people exceed once in `EACH` places."""
    every = np.concatenate([one.clutter[:: one.empty.side, :: one.empty.side].ravel() for one in frames])
    return float(np.quantile(every, 1 - 1 / EACH))


def _differs(flight: Flight, frames: Sequence[Measured], index: int) -> Floats:
    """From the frame before (of the first: after)."""
    other = index - 1 if index else 1
    lens, one = flight.scene.camera.lens, frames[index]
    x, y = np.meshgrid(np.linspace(0, lens.width - 1, MESH), np.linspace(0, lens.height - 1, MESH))
    ground = ground_from_pixels(lens, flight.states[index], np.stack([x, y], axis=-1).reshape(-1, 2))
    there = pixels_from_ground(lens, flight.states[other], ground).reshape(MESH, MESH, 2)
    scale = frames[other].empty.scale
    step = round(one.ground.step_px * one.empty.scale)
    return disagreement(one.empty, frames[other].empty, np.asarray((there + 0.5) * scale - 0.5, np.float32), step)


def _rows(
    peopled: Peopled,
    index: int,
    frame: Measured,
    differs: Floats,
    sharp: float,
    posture: str,
    threshold: float,
) -> Iterator[Floats]:
    lens, state = peopled.scene.camera.lens, peopled.flight.states[index]
    for number, one in enumerate(peopled.people):
        place = np.array([[one.target.x, one.target.y]])
        pixel = on_the_floor(lens, state, place)
        if one.person.posture != posture or not ((pixel > 0) & (pixel < [lens.width - 1, lens.height - 1])).all():
            continue
        look = look_at(frame.ground, differs, pixel, one.person)
        away = float(np.hypot(*(place[0] - [state.x, state.y])))
        side_px = one.person.side_m * lens.focal_px / state.height / (1 + (away / state.height) ** 2) ** 0.75
        kept = kept_contrast(np.array([side_px]), np.array([sharp if np.isfinite(sharp) else 1.0]))
        east, south = np.degrees(np.arctan2(place[0] - [state.x, state.y], state.height))
        squares = np.floor([east / DIRECTION_DEG, south / DIRECTION_DEG])
        values = (number, look.in_sun, look.in_shade, kept, look.texture, look.disagreement, squares @ [1000, 1])
        yield np.array([*(float(np.squeeze(value)) for value in values), float(_read(frame, pixel[0]) > threshold)])


def _read(frame: Measured, pixel: Floats) -> float:
    """The reader's score of whoever is at a pixel of the original. Of the others nothing is left: so many as are laid out to be
    counted would stand between the reader and the ground, which plain ground shows most."""
    column, row = (pixel + 0.5) * frame.empty.scale - 0.5
    around, near = _box(row, column, ALONE * frame.empty.side), _box(row, column, frame.empty.side / 2 + 0.5)
    local = frame.empty.local.copy()
    local[around] = frame.full.local[around]
    alone = replace(frame.empty, local=local)
    return float(scores(alone, statistics(alone).covariances)[near].max(initial=0))


def _box(row: float, column: float, reach: float) -> tuple[slice, slice]:
    middle = row, column
    down, across = (slice(max(0, round(at - reach)), max(0, round(at + reach) + 1)) for at in middle)
    return down, across
