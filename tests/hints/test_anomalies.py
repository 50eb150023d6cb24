"""What stands out, is rare, looks like a colour, or moves."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_mosaic.hints.anomalies import LARGEST, appearance, blobs
from gcs_mosaic.hints.hint_file import FoundThing, HintsRead, KnownHint
from gcs_mosaic.hints.hint_places import HintPlace
from gcs_mosaic.hints.other_looks import KEPT_FRAMES, OtherLooks, Verdict
from gcs_mosaic.hints.ranking import ranked
from gcs_mosaic.hints.rarity import FlightRarity
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.hints.sought import SoughtColour, of_colour

ORANGE = (40, 110, 235)
Picture = NDArray[np.uint8]


def ground(seed: int = 1, size: tuple[int, int] = (300, 400)) -> Picture:
    """Grass: green of changing lightness."""
    rng = np.random.default_rng(seed)
    light = rng.normal(0, 9, size)[..., None]
    return np.clip(np.array([60, 120, 90]) + light, 0, 255).astype(np.uint8)


def with_thing(picture: Picture, x: int, y: int, colour: tuple[int, int, int] = ORANGE, side: int = 8) -> Picture:
    changed = picture.copy()
    changed[y : y + side, x : x + side] = colour
    return changed


def test_the_odd_thing_is_found_where_it_is_and_nothing_on_bare_ground() -> None:
    rarity, bare, seen = FlightRarity(), appearance(ground()), appearance(with_thing(ground(), 120, 200))
    for one in (bare, seen):
        rarity.add(one)
    oddity = rarity.oddity(seen)
    found, *others = blobs(oddity, 4.5, 16)
    assert len(others) <= 2  # of 120,000 pixels of noise
    assert all(oddity[found.y, found.x] > oddity[one.y, one.x] + 1 for one in others)
    assert abs(found.left + found.width / 2 - 124) <= 2
    assert abs(found.top + found.height / 2 - 204) <= 2
    assert len(blobs(rarity.oddity(bare), 4.5, 16)) <= 2


def test_what_is_large_or_a_speck_is_no_small_thing() -> None:
    oddity = np.zeros((300, 400), np.float32)
    oddity[10 : 10 + LARGEST + 1, 10:30] = 9  # a car
    oddity[200, 200] = 9  # noise
    oddity[100:110, 300:306] = 5
    oddity[250:256, 50:56] = 7
    assert [(one.left, one.top) for one in blobs(oddity, 4.5, 16)] == [(50, 250), (300, 100)]
    assert len(blobs(oddity, 4.5, 1)) == 1


def test_a_colour_becomes_common_as_the_flight_shows_more_of_it() -> None:
    rarity, orange = FlightRarity(), np.array([[40, 110, 235]], np.uint8)
    first = appearance(with_thing(ground(), 120, 200))
    lab = first.lab[204, 124]
    rarity.add(first)
    rare = float(rarity.of_colours(lab))
    for _ in range(5):
        rarity.add(appearance(np.broadcast_to(orange, (300, 400, 3)).astype(np.uint8)))
    assert rare > 3 > 1.5 > float(rarity.of_colours(lab))


def test_a_picked_colour_is_found_in_sun_and_shade_and_others_are_not() -> None:
    picture = with_thing(with_thing(with_thing(ground(), 50, 50), 200, 80, (25, 70, 150)), 300, 200, (200, 120, 40))
    found = of_colour(appearance(picture), SoughtColour(number=1, bgr=ORANGE, tolerance=30.0), 9)
    assert [(round(blob.left, -1), round(blob.top, -1)) for blob, _ in found] == [(50, 50), (200, 80)]
    assert 1 >= found[0][1] > found[1][1] >= 0


def test_what_only_one_look_shows_is_told_from_what_all_show() -> None:
    looks = OtherLooks()
    looks.keep(1, appearance(with_thing(ground(1), 120, 200)))
    looks.keep(2, appearance(ground(2)))
    contrast = float(appearance(with_thing(ground(3), 120, 200)).contrast.max())
    assert looks.verdict(1, 124, 204, 8, contrast) == Verdict(1, 1)
    assert looks.verdict(2, 124, 204, 8, contrast) == Verdict(1, 0)
    assert looks.verdict(2, 3, 204, 8, contrast) == looks.verdict(2, float("nan"), 204, 8, contrast) == Verdict(0, 0)
    for number in range(3, 3 + KEPT_FRAMES):
        looks.keep(number, appearance(ground(size=(40, 40))))
    assert 1 not in looks
    assert len(looks.frames) == KEPT_FRAMES


def hint(number: int, contrast: float = 9.0, lab: tuple[int, int, int] = (90, 200, 180), **rest: object) -> KnownHint:
    values = {
        "kind": "odd",
        "frame": 1,
        "x": 0.0,
        "y": 0.0,
        "width": 8.0,
        "height": 8.0,
        "lab": lab,
        "contrast": contrast,
    }
    return KnownHint(id=number, utc=0.0, found=FoundThing(**{**values, **rest}))  # type: ignore[arg-type]


def test_hints_are_so_many_a_minute_and_what_was_dismissed_leaves_its_place_empty() -> None:
    read = HintsRead([hint(number, lab=(number, 99, 99)) for number in range(60)], None, 1, 0, "f")
    assert len(ranked(read, {}, 20, 2.0)) == 40
    assert len(ranked(read, {}, 20, 0.0)) == 20
    first = ranked(read, {}, 20, 1.0)
    dismissed = read.key(first[0].hint)
    assert [one.hint for one in ranked(read, {}, 20, 1.0, {dismissed})] == [one.hint for one in first[1:]]


def test_one_who_walks_on_comes_once_before_all_others() -> None:
    rarity = FlightRarity()
    rarity.add(appearance(ground()))
    read = HintsRead([hint(1, 12.0), hint(2, 11.0), hint(3, 6.0, (30, 99, 99))], rarity, 1, 0, "f")
    near = {1: HintPlace(0, 0, 0, 8), 2: HintPlace(0, 100, 0, 8), 3: HintPlace(0, 50, 0, 8)}
    far = {**near, 2: HintPlace(0, 9000, 0, 8)}
    other = {**near, 2: HintPlace(1, 100, 0, 8)}
    assert [one.hint.id for one in ranked(read, near, 20, 1)] == [1, 3, 2]
    assert (
        [one.hint.id for one in ranked(read, far, 20, 1)]
        == [one.hint.id for one in ranked(read, other, 20, 1)]
        == [1, 2, 3]
    )


def test_what_moves_is_worth_more_and_each_hint_says_why() -> None:
    still, moving = hint(1, 9.0, verdict=Verdict(3, 3)), hint(2, 9.0, verdict=Verdict(3, 0))
    sought = hint(3, kind="sought", what=1, score=0.5)
    read = HintsRead([still, moving, sought], None, 1, 0, "f")
    assert [(one.hint.id, one.reason) for one in ranked(read, {}, 20, 1)] == [
        (3, "sought"),
        (2, "moves"),
        (1, "stands out"),
    ]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [({"per_minute": 0}, "per_minute"), ({"confidence": 2}, "confidence"), ({"megapixels": -1}, "megapixels")],
)
def test_settings_are_checked(wrong: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        HintSettings(**wrong)  # type: ignore[arg-type]
