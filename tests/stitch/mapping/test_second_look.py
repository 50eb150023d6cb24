"""A second look: frames that nothing connects at first are connected by finer features; what cannot be is left, and soon."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from stitch_ground import SMALL_CAMERA, Image, map_error, photograph

from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract
from gcs_mosaic.stitch.mapping.second_look import SecondLookSettings
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings

FEW = StitchSettings(features=FeatureSettings(count=60))
APART = [Pose(500 + 340 * i, 600) for i in range(3)]  # three tenths of a frame in common


class Pictures:
    """Photographs by name, and whose finer features were asked for."""

    def __init__(self, ground: Image, poses: list[Pose], settings: StitchSettings) -> None:
        self.taken = {f"{n:03}": photograph(ground, pose, SMALL_CAMERA) for n, pose in enumerate(poses)}
        self._settings = settings.second_look.features(settings.features)
        self.asked: list[str] = []

    def finer(self, name: str) -> Features | None:
        self.asked.append(name)
        return extract(self.taken[name], self._settings)


def flown(pictures: Pictures, settings: StitchSettings, finer: Callable[[str], Features | None] | None) -> Mosaic:
    """Placed by few features, without textures: keypoints alone judge."""
    mosaic = Mosaic(settings, finer=finer)
    for name, image in pictures.taken.items():
        mosaic.place(replace(extract(image, settings.features), kept_texture=None), name)
    return mosaic


def in_a_pause(mosaic: Mosaic) -> int:
    """Connect what can be; how many steps that takes."""
    for step in range(200):
        if not mosaic.connect_some():
            return step
    raise AssertionError("it does not end")


@pytest.fixture
def pictures(ground: Image) -> Pictures:
    return Pictures(ground, APART, FEW)


@pytest.mark.long
def test_frames_that_would_be_lost_are_connected(pictures: Pictures) -> None:
    mosaic = flown(pictures, FEW, pictures.finer)
    assert len(mosaic.placements()) < len(APART)
    in_a_pause(mosaic)
    mosaic.adjust(everything=True)
    assert not mosaic.waiting()
    assert mosaic.frame_counts() == {0: 3}
    assert map_error(mosaic.placements(), APART) < 2


@pytest.mark.long
def test_frames_on_the_map_are_not_looked_at_again(ground: Image) -> None:
    overlapping = [Pose(500 + 120 * i, 600) for i in range(4)]
    settings = StitchSettings()
    pictures = Pictures(ground, overlapping, settings)
    mosaic = flown(pictures, settings, pictures.finer)
    in_a_pause(mosaic)
    assert mosaic.frame_counts() == {0: 4}
    assert not pictures.asked


@pytest.mark.parametrize("settings", [None, replace(FEW, second_look=SecondLookSettings(megapixels=0))])
def test_without_finer_pictures_nothing_is_looked_at_again(pictures: Pictures, settings: StitchSettings | None) -> None:
    mosaic = flown(pictures, settings or FEW, pictures.finer if settings else None)
    in_a_pause(mosaic)
    assert mosaic.waiting()
    assert not pictures.asked


def test_a_picture_that_is_gone_is_asked_for_no_more(pictures: Pictures) -> None:
    mosaic = flown(pictures, FEW, lambda name: pictures.asked.append(name))
    in_a_pause(mosaic)
    asked = len(pictures.asked)
    assert asked > 0
    in_a_pause(mosaic)
    assert len(pictures.asked) == asked


def test_a_picture_that_raises_ends_no_search(pictures: Pictures) -> None:
    def failing(name: str) -> Features | None:
        if name == "000":
            raise MemoryError
        return pictures.finer(name)

    mosaic = flown(pictures, FEW, failing)
    raised = 0
    for _ in range(100):
        try:
            if not mosaic.connect_some():
                break
        except MemoryError:
            raised += 1
    assert raised > 0
    assert not mosaic.connect_some()
    assert max(mosaic.frame_counts().values()) == 2  # the other two


@pytest.mark.long
def test_little_is_looked_at_in_vain(ground: Image) -> None:
    """Twelve frames of which no two show one place."""
    far_apart = [Pose(300 + 600 * (i % 4), 300 + 600 * (i // 4)) for i in range(12)]
    settings = replace(FEW, second_look=SecondLookSettings(in_vain=2, in_vain_per_frame=0.25))
    pictures = Pictures(ground, far_apart, settings)
    mosaic = flown(pictures, settings, pictures.finer)
    in_a_pause(mosaic)
    assert len(mosaic.waiting()) >= 10
    assert len(pictures.asked) <= 2 * (2 + 0.25 * 12)


def test_what_was_looked_at_is_remembered(pictures: Pictures) -> None:
    mosaic = flown(pictures, FEW, lambda name: None)
    in_a_pause(mosaic)
    other = Mosaic(FEW, finer=pictures.finer)
    other.load(mosaic.saved())
    in_a_pause(other)
    assert not pictures.asked
