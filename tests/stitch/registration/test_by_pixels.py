"""What the pictures must say before an overlap is proved by them; the pictures are told here."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
import pytest

from gcs_mosaic.stitch.arrays import Matrix3x3, PointsNx2
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.registration import by_pixels
from gcs_mosaic.stitch.registration.agreement import Agreement, PixelPair
from gcs_mosaic.stitch.registration.by_pixels import (
    is_one_of_many,
    looked_at,
    proved_by_pixels,
    should_have_matched,
    with_patches,
)
from gcs_mosaic.stitch.registration.frame_pair import ALL, FramePair, frame_pair
from gcs_mosaic.stitch.registration.outcome import NO_MATCHES, Registration
from gcs_mosaic.stitch.registration.patches import Patches
from gcs_mosaic.stitch.registration.proposals import Proposal
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

SETTINGS = RegistrationSettings()
WIDTH, HEIGHT = 400, 300
GRID = np.stack(np.meshgrid(np.arange(60.0, 340, 40), np.arange(60.0, 240, 40)), -1).reshape(-1, 2)
NO_PATCHES = Patches(np.empty((0, 2)), np.empty((0, 2)), 0)


def frame(count: int = 0, *, scale: float = 1.0, sharpness: float = 1.0, is_faint: bool = False) -> Features:
    points = np.resize(GRID, (count, 2)).astype(np.float32)
    descriptors = np.zeros((count, 128), np.uint8)
    return Features(points, descriptors, WIDTH, HEIGHT, scale, sharpness=sharpness, is_faint=is_faint)


def agreement(b_from_a: Matrix3x3, *, correlation: float = 0.5, evidence: float = 9.0, alone: float = 3.0) -> Agreement:
    return Agreement(b_from_a, correlation, 5000, 0.1, 30.0, evidence, alone)


def moved(x: float, y: float = 0.0) -> Matrix3x3:
    return np.array([[1, 0, x], [0, 1, y], [0, 0, 1.0]])


@dataclass
class Pictures:
    """Two pictures that agree as `seen` tells by the shift across, and beyond what matched by so many decades."""

    seen: dict[float, Agreement] = field(default_factory=dict)
    beyond: float = 5.0
    detail: float = 0.0
    known: bool = True
    asked: list[float] = field(default_factory=list)

    def agreement(self, b_from_a: Matrix3x3) -> Agreement | None:
        self.asked.append(float(b_from_a[0, 2]))
        return self.seen.get(self.asked[-1])

    def evidence_beyond(self, found: Agreement, matched: PointsNx2) -> float:
        return self.beyond

    def finest(self, found: Agreement) -> float:
        return self.detail

    @property
    def pair(self) -> PixelPair:
        return cast(PixelPair, self)


def pair_of(a: Features, b: Features) -> FramePair:
    return frame_pair(a, b, ALL, ALL, NO_MATCHES)


@pytest.fixture
def ground(monkeypatch: pytest.MonkeyPatch) -> None:
    """Patches are found all over, wherever one frame is laid on the other."""

    def found(a: Features, b: Features, b_from_a: Matrix3x3) -> Patches:
        return Patches(GRID, GRID + b_from_a[:2, 2], len(GRID))

    monkeypatch.setattr(by_pixels, "patches", found)


def proved(pictures: Pictures, *proposals: Proposal, settings: RegistrationSettings = SETTINGS) -> Registration | None:
    a, b = frame(), frame()
    return proved_by_pixels(pair_of(a, b), pictures.pair, a, b, proposals, settings)


def far(shift: float, evidence: float = 0.0) -> Proposal:
    return Proposal(moved(shift), evidence)


DETAILED = frame(200)  # 1,667 features per megapixel


@pytest.mark.parametrize(
    ("a", "b", "correlation", "detail", "should"),
    [
        (DETAILED, DETAILED, 0.75, 0.0, True),
        (DETAILED, DETAILED, 0.65, 0.2, True),
        (DETAILED, DETAILED, 0.65, 0.1, False),
        (frame(150), DETAILED, 0.75, 0.2, False),
        (DETAILED, frame(150), 0.75, 0.2, False),
        (
            frame(100, scale=2.0),
            DETAILED,
            0.75,
            0.0,
            True,
        ),  # features of the smaller picture, in which they were sought
        (frame(200, is_faint=True), DETAILED, 0.75, 0.2, False),
        (DETAILED, frame(200, is_faint=True), 0.75, 0.2, False),
        (DETAILED, frame(200, sharpness=1.4), 0.75, 0.0, True),
        (DETAILED, frame(200, sharpness=1.6), 0.75, 0.2, False),
        (frame(200, sharpness=1.6), DETAILED, 0.75, 0.2, False),
    ],
)
def test_pictures_that_agree_in_detail_have_keypoints_in_common_or_are_not_one_place(
    a: Features, b: Features, correlation: float, detail: float, should: bool
) -> None:
    """Unless few details are there, or noise hides them, or blur."""
    found = agreement(np.eye(3), correlation=correlation)
    assert should_have_matched(found, Pictures(detail=detail).pair, a, b) is should


@pytest.mark.parametrize(
    ("detail", "alone", "should"), [(0.8, 4.4, True), (0.8, 7.0, False), (0.6, 4.4, False)], ids=["", "alone", "less"]
)
@pytest.mark.parametrize("excused", [frame(100), frame(200, sharpness=1.6), frame(200, is_faint=True)])
def test_what_agrees_to_its_finest_details_elsewhere_too_has_no_excuse(
    excused: Features, detail: float, alone: float, should: bool
) -> None:
    """As rows of graves do that differ by less than the noise: they were joined for having few keypoints, or taken for blurred
    because what the grass shows varies."""
    found = agreement(np.eye(3), correlation=0.98, alone=alone)
    assert should_have_matched(found, Pictures(detail=detail).pair, DETAILED, excused) is should


@pytest.mark.usefixtures("ground")
def test_what_is_proposed_and_seen_is_proved() -> None:
    found = proved(Pictures({30.0: agreement(moved(30))}), far(30))
    assert found is not None
    assert np.allclose(found.b_from_a, moved(30), atol=1e-6)
    assert (found.evidence, found.beyond, len(found.pixels_a)) == (9.0, 5.0, len(GRID))


@pytest.mark.usefixtures("ground")
@pytest.mark.parametrize(
    ("proposed", "seen", "beyond"),
    [
        (0.0, agreement(moved(30), evidence=7.9), 5.0),
        (-1.5, agreement(moved(30)), 5.0),
        (0.0, agreement(moved(30), alone=0.9), 5.0),
        (0.0, agreement(moved(30)), 1.9),
    ],
    ids=["too little in all", "the proposal is unlikely", "another shift is as good", "the rest does not agree"],
)
def test_each_of_what_the_pictures_must_show_is_needed(proposed: float, seen: Agreement, beyond: float) -> None:
    assert proved(Pictures({30.0: seen}, beyond), far(30, proposed)) is None


@pytest.mark.usefixtures("ground")
@pytest.mark.parametrize(
    ("proposed", "seen"),
    [(0.0, agreement(moved(30), evidence=8.0)), (-1.0, agreement(moved(30))), (0.0, agreement(moved(30), alone=1.0))],
)
def test_just_as_much_as_is_needed_is_enough(proposed: float, seen: Agreement) -> None:
    assert proved(Pictures({30.0: seen}, beyond=2.0), far(30, proposed)) is not None


@pytest.mark.usefixtures("ground")
def test_after_a_proposal_that_comes_to_nothing_the_next_one_is_tried() -> None:
    nothing, other_place = moved(30), agreement(moved(90), alone=0.5)
    pictures = Pictures({90.0: other_place, 150.0: agreement(moved(150))})
    found = proved(pictures, far(150), Proposal(nothing, 2.0), far(90, 1.0))
    assert pictures.asked == [30.0, 90.0, 150.0]
    assert found is not None
    assert found.b_from_a[0, 2] == pytest.approx(150.0)


@pytest.mark.usefixtures("ground")
def test_of_proposals_that_are_drawn_to_one_peak_one_is_tried() -> None:
    """Nearer than a twentieth of the diagonal, 25 px."""
    pictures = Pictures()
    assert proved(pictures, far(30, 1.0), far(54), far(56), far(6)) is None
    assert pictures.asked == [30.0, 56.0]


@pytest.mark.usefixtures("ground")
def test_what_no_pictures_could_prove_or_no_camera_see_is_not_looked_at() -> None:
    """The most that pictures can say is 12 decades of the 8 that are needed."""
    pictures = Pictures()
    upside_down = np.diag([1.0, -1.0, 1.0])
    too_large = np.diag([6.0, 6.0, 1.0])
    assert proved(pictures, far(30, -4.1), far(90, -4.0), Proposal(upside_down, 9.0), Proposal(too_large, 9.0)) is None
    assert pictures.asked == [90.0]


@pytest.mark.parametrize("count", [7, 8])
def test_a_pose_needs_eight_places_apart(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    some = GRID[[0, 6, 28, 34, 3, 31, 14, 20][:count]]
    monkeypatch.setattr(by_pixels, "patches", lambda a, b, h: Patches(some, some + np.array([30.0, 0.0]), count))
    assert (proved(Pictures({30.0: agreement(moved(30))}), far(30)) is not None) is (count == 8)


def test_without_patches_and_matches_nothing_is_laid(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(by_pixels, "patches", lambda a, b, h: NO_PATCHES)
    assert proved(Pictures({30.0: agreement(moved(30))}), far(30)) is None


def test_patches_off_the_plane_are_kept_as_displaced(monkeypatch: pytest.MonkeyPatch) -> None:
    lifted = GRID + np.array([30.0, 0.0])
    lifted[[5, 17]] += [0.0, 9.0]
    monkeypatch.setattr(by_pixels, "patches", lambda a, b, h: Patches(GRID, lifted, len(GRID)))
    found = proved(Pictures({30.0: agreement(moved(30))}), far(30))
    assert found is not None
    assert found.displaced_a.tolist() == GRID[[5, 17]].tolist()
    assert found.displaced_b.tolist() == lifted[[5, 17]].tolist()
    assert len(found.pixels_a) == len(found.pixels_b) == len(GRID) - 2


def registration(independent: int) -> Registration:
    return Registration(GRID[:4], GRID[:4], np.zeros((4, 2), np.intp), np.eye(3), independent, 9.0)


@pytest.mark.parametrize(
    ("evidence", "detail", "alone", "many"),
    [(19.0, 0.8, 0.9, True), (20.0, 0.8, 0.9, False), (19.0, 0.6, 0.9, False), (19.0, 0.8, 1.0, False)],
    ids=["", "plainly", "other details", "alone"],
)
def test_keypoints_that_prove_little_on_rows_of_one_make_are_not_believed(
    evidence: float, detail: float, alone: float, many: bool
) -> None:
    found, seen = replace(registration(15), evidence=evidence), {0.0: agreement(np.eye(3), alone=alone)}
    assert is_one_of_many(found, Pictures(seen, detail=detail).pair, SETTINGS) is many
    assert not is_one_of_many(found, Pictures(detail=detail).pair, SETTINGS), "the pictures do not agree"
    assert not is_one_of_many(found, Pictures(seen, detail=detail, known=False).pair, SETTINGS)


@pytest.mark.usefixtures("ground")
@pytest.mark.parametrize(
    ("independent", "known", "always", "added"),
    [(23, True, False, True), (24, True, False, False), (24, True, True, True), (23, False, True, False)],
)
def test_patches_are_sought_where_matches_are_few_or_always(
    independent: int, known: bool, always: bool, added: bool
) -> None:
    found = with_patches(
        registration(independent), Pictures(known=known).pair, frame(), frame(), SETTINGS, always=always
    )
    assert len(found.pixels_a) == 4 + added * len(GRID)


@pytest.mark.parametrize(("always", "displaced"), [(False, 0), (True, 1)])
def test_patches_join_a_registration_within_its_tolerance(
    monkeypatch: pytest.MonkeyPatch, always: bool, displaced: int
) -> None:
    """Four pixels of the feature picture, which has half as many here."""
    off = GRID[:3] + np.array([[0.0, 0.0], [7.9, 0.0], [8.1, 0.0]])
    monkeypatch.setattr(by_pixels, "patches", lambda a, b, h: Patches(GRID[:3], off, 3))
    frames = frame(), frame(scale=2.0)
    found = with_patches(registration(5), Pictures().pair, *frames, SETTINGS, always=always)
    assert found.pixels_b[4:].tolist() == off[:2].tolist()
    assert len(found.displaced_a) == displaced


def looked(seen: Agreement | None, *, beyond: float = 5.0, detail: float = 0.0) -> Registration | None:
    pictures = Pictures({0.0: seen} if seen else {}, beyond, detail)
    return looked_at(registration(12), pair_of(DETAILED, DETAILED), pictures.pair, DETAILED, DETAILED, SETTINGS)


@pytest.mark.usefixtures("ground")
def test_an_overlap_that_keypoints_leave_in_doubt_is_borne_out_by_the_pictures() -> None:
    found = looked(agreement(np.eye(3), alone=1.0), beyond=2.0)
    assert found is not None
    assert (found.beyond, len(found.pixels_a)) == (2.0, 4 + len(GRID))


@pytest.mark.usefixtures("ground")
@pytest.mark.parametrize(
    ("seen", "beyond", "detail"),
    [
        (None, 5.0, 0.0),
        (agreement(np.eye(3), alone=0.9), 5.0, 0.0),
        (agreement(np.eye(3)), 1.9, 0.0),
        (agreement(np.eye(3)), 5.0, 0.2),
        (agreement(moved(61)), 5.0, 0.0),
    ],
    ids=["not alike", "another shift is as good", "the rest does not agree", "keypoints should", "another place"],
)
def test_pictures_do_not_bear_it_out_if(seen: Agreement | None, beyond: float, detail: float) -> None:
    assert looked(seen, beyond=beyond, detail=detail) is None


@pytest.mark.usefixtures("ground")
@pytest.mark.parametrize(("apart", "same"), [(59.0, True), (61.0, False)])
def test_crowns_lie_as_far_from_the_ground_as_is_allowed(apart: float, same: bool) -> None:
    """In the middle of the frame, an eighth of the diagonal of 500 px."""
    assert (looked(agreement(moved(apart))) is not None) is same


def test_without_a_registration_nothing_is_looked_at() -> None:
    pictures = Pictures({0.0: agreement(np.eye(3))})
    assert looked_at(None, pair_of(DETAILED, DETAILED), pictures.pair, DETAILED, DETAILED, SETTINGS) is None
    assert pictures.asked == []


def test_matches_that_agree_with_what_the_pictures_show_tell_the_pose_with_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Within three tolerances, which few of four pixels are; matches elsewhere are left out."""
    monkeypatch.setattr(by_pixels, "patches", lambda a, b, h: NO_PATCHES)
    there = GRID + np.array([30.0, 0.0])
    there[20:] += [20.0, 0.0]
    a = frame(len(GRID))
    b = replace(a, kept_points=there.astype(np.float32))
    both = np.stack([np.arange(len(GRID))] * 2, axis=1)
    pictures = Pictures({30.0: agreement(moved(30))})
    pair = frame_pair(a, b, ALL, ALL, both)
    found = proved_by_pixels(pair, pictures.pair, a, b, [far(30)], SETTINGS)
    assert found is not None
    assert found.features.tolist() == both[:20].tolist()
    assert np.allclose(found.b_from_a, moved(30), atol=1e-6)
