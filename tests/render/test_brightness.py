"""What frames are told of each other's brightness: it outlasts what happens to them between two steps of repainting, and each
aircraft has a vignetting of its own."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
from painting_parts import painted, picture

from gcs_mosaic.archive.exposure_compensation import curves_of
from gcs_mosaic.render.agreement import Aircraft, Overlap, overlap_of
from gcs_mosaic.render.brightness import Brightness
from gcs_mosaic.render.exposure import ExposureSettings
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.vignetting import OUTWARDS, Vignetting, VignettingSettings, radii
from gcs_mosaic.stitch.arrays import Levels
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER
from gcs_mosaic.stitch.camera.geometry import Camera
from gcs_mosaic.store.array_shelf import ArrayShelf
from gcs_mosaic.store.checkpoint import decoded, encoded

LENS = Camera(96, 72, focal=1.2)
FALLS = {
    1: (0.0, -0.6, 0.0),
    2: (0.0, 0.0, 0.0),
}  # log brightness of either aircraft's lens; that of the second is even


def test_an_overlap_outlasts_the_moving_of_one_island_to_another() -> None:
    """Of two frames whose island has been joined to another one, only the first is painted there when a border is found."""
    brightness = Brightness(ExposureSettings(), VignettingSettings(), lambda size: NO_BORDER)
    light, dark = picture(0).astype(np.float32), (picture(0) * 0.7).astype(np.float32)
    one = brightness.settled(painted(0), light, [])
    other = brightness.settled(painted(1), dark, [one])
    assert other.gain != one.gain
    there = {one.name: one, other.name: other}
    known = brightness.final(there)
    moved = replace(one, island=1, pose=replace(one.pose, x=5000.0))
    brightness.compare_again(there | {one.name: moved}, there)
    assert brightness.final(there) == known


def test_thumbnails_on_a_shelf_tell_the_same_and_come_whole_into_a_checkpoint(tmp_path: Path) -> None:
    """One fits into memory, so that the others are read again."""
    frames = flown_by_two()
    told = []
    with closing(ArrayShelf(frames[0][1].nbytes, tmp_path)) as shelf:
        for shelve in (None, shelf.shelve):
            brightness = Brightness(ExposureSettings(), VignettingSettings(), lambda camera: NO_BORDER, shelve)
            settled: list[RenderItem] = []
            for frame, small, aircraft in frames:
                settled.append(brightness.settled(frame, small, settled, aircraft))
            told.append((settled, brightness.final({one.name: one for one in settled})))
        saved = decoded(encoded(brightness.saved()))["_thumbnails"]
    assert told[0] == told[1]
    for frame, small, _ in frames:
        assert np.array_equal(saved[frame.name].picture, small)


def flown_by_two() -> list[tuple[RenderItem, Levels, int]]:
    """Frames that two aircraft take in turn over one ground, with their thumbnails and whose they are."""
    rng = np.random.default_rng(4)
    ground = rng.normal(110, 15, (300, 400, 3)).astype(np.float32)
    pixels = np.stack(np.meshgrid(np.arange(LENS.width), np.arange(LENS.height)), axis=-1).reshape(-1, 2)
    outwards = radii(pixels.astype(np.float64), LENS.width, LENS.height)
    taken = []
    for order in range(16):
        x, y, aircraft = 10 * order, 30 * (order // 2 % 2), 1 + order % 2
        fall = np.exp(outwards @ np.array(FALLS[aircraft])).reshape(LENS.height, LENS.width, 1)
        small = ground[y : y + LENS.height, x : x + LENS.width] * fall
        taken.append((painted(order, x, y, camera=LENS), small.astype(np.float32), aircraft))
    return taken


def apart(curves: Vignetting, aircraft: int) -> float:
    """The greatest error in log brightness from the middle to the corners, in any band."""
    return float(np.abs(np.subtract(curves, FALLS[aircraft]) @ OUTWARDS.T).max())


def errors(*, told_apart: bool) -> list[float]:
    """How wrong the vignetting of each frame is, with or without knowing whose it is."""
    brightness, beside = (
        Brightness(ExposureSettings(), VignettingSettings(), lambda size: NO_BORDER),
        list[RenderItem](),
    )
    for one, thumbnail, aircraft in flown_by_two():
        brightness.settled(one, thumbnail, beside[-4:], aircraft if told_apart else None)
        beside.append(one)
    return [apart(brightness.curves_of(one), aircraft) for one, _, aircraft in flown_by_two()]


def test_each_aircraft_has_a_vignetting_of_its_own() -> None:
    assert max(errors(told_apart=True)) < 0.05
    assert max(errors(told_apart=False)) > 0.2  # one for both is wrong


def test_an_archive_tells_them_apart_too() -> None:
    flown = flown_by_two()
    overlaps: list[Overlap] = [
        (one.name, other.name, means)
        for k, (one, small, _) in enumerate(flown)
        for other, beside, _ in flown[max(k - 4, 0) : k]
        if (means := overlap_of(one, small, other, beside)) is not None
    ]
    whose: dict[str, Aircraft] = {one.name: aircraft for one, _, aircraft in flown}
    found = curves_of(whose, [one for one, _, _ in flown], overlaps, VignettingSettings())
    assert max(apart(found[one.name], aircraft) for one, _, aircraft in flown) < 0.05
