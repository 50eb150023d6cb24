"""A flight that was placed in two parts, each by itself, becomes the map that it would have become in one."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from stitch_ground import Image, fly, map_error

from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.graph.candidates import Search
from gcs_mosaic.stitch.graph.union import Renamed
from gcs_mosaic.stitch.mosaic import Mosaic
from gcs_mosaic.stitch.registration.outcome import Registration
from gcs_mosaic.store.checkpoint import decoded, encoded

pytestmark = pytest.mark.long

AS_THEY_ARE = Renamed(name_of=lambda name: name, aircraft_of=lambda aircraft: aircraft)
FRAMES = 6  # of either part
LEVEL = [(400 + 130 * i, 500) for i in range(FRAMES)] + [(400 + 130 * i, 700) for i in range(FRAMES)][::-1]
TILTS = np.random.default_rng(5).normal(0, [0.02, 0.05, 0.03, 0.03], (2 * FRAMES, 4))
TRUTH = [Pose(*place, *tilt) for place, tilt in zip(LEVEL, TILTS.tolist(), strict=True)]
PAIRS = [(f"{a:03}", f"{b:03}") for a, b in product(range(FRAMES), range(FRAMES, 2 * FRAMES))]


@pytest.fixture(scope="module")
def parts(ground: Image) -> list[bytes]:
    """Both parts as they are kept."""
    kept = []
    for first in (0, FRAMES):
        mosaic = Mosaic()
        fly(mosaic, ground, TRUTH[first : first + FRAMES], first)
        mosaic.adjust(everything=True)
        kept.append(encoded(mosaic.saved()))
    return kept


@pytest.fixture
def united(parts: list[bytes]) -> Mosaic:
    """Both parts, on an island each."""
    mosaic = Mosaic()
    for part in parts:
        one = Mosaic()
        one.load(decoded(part))
        mosaic.take_over(one, AS_THEY_ARE)
    assert [placement.island for placement in mosaic.placements()] == [0] * FRAMES + [1] * FRAMES
    return mosaic


def test_what_is_known_to_look_alike_joins_them(united: Mosaic) -> None:
    assert united.connect(PAIRS)
    linked, _ = united.link(PAIRS)
    united.adjust(everything=True)
    assert linked >= FRAMES
    assert {placement.island for placement in united.placements()} == {0}
    assert map_error(united.placements(), TRUTH) < 1.5
    assert not united.connect(PAIRS)
    assert united.link(PAIRS)[0] == 0


def test_what_one_camera_took_has_one_lens(united: Mosaic) -> None:
    united.connect(PAIRS)
    united.adjust(everything=True)
    assert len({placement.camera for placement in united.placements()}) == 1


def test_what_does_not_look_alike_joins_nothing(united: Mosaic) -> None:
    assert not united.connect([("000", f"{FRAMES:03}")])  # the ends, far from each other


def test_a_registration_that_says_something_else_is_no_link(united: Mosaic, monkeypatch: pytest.MonkeyPatch) -> None:
    united.connect(PAIRS)
    register = Search.register

    def beside(search: Search, frame: int, other: int) -> Registration | None:
        found = register(search, frame, other)
        return found and replace(found, pixels_b=found.pixels_b + 200)

    monkeypatch.setattr(Search, "register", beside)
    linked, astray = united.link(PAIRS)
    assert linked == 0
    assert astray >= FRAMES
