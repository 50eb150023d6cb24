"""Whoever looks on is told what happened, and what is told is true."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from stitch_ground import Image, seen

from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.graph.observer import Observers, Residuals, island_residuals
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.mapping.resection import PlausibilitySettings
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings
from gcs_mosaic.stitch.registration.outcome import NotRegistered, Registration


class Notes:
    """An observer that writes everything down."""

    def __init__(self) -> None:
        self.pairs: list[tuple[str, str, Registration | NotRegistered]] = []
        self.disbeliefs: list[tuple[str, str, str]] = []
        self.placements: list[Placement] = []
        self.adjustments: list[tuple[int, Sequence[Residuals]]] = []

    def registered(self, a: str, b: str, found: Registration | NotRegistered) -> None:
        self.pairs.append((a, b, found))

    def disbelieved(self, name: str, beside: str, reason: str) -> None:
        self.disbeliefs.append((name, beside, reason))

    def placed(self, placement: Placement) -> None:
        self.placements.append(placement)

    def adjusted(self, island: int, residuals: Callable[[], Sequence[Residuals]]) -> None:
        self.adjustments.append((island, residuals()))


TRUTH = [Pose(400 + 130 * i, 500) for i in range(3)]


def fly(mosaic: Mosaic, *grounds: Image) -> Mosaic:
    for i, (ground, pose) in enumerate(zip(grounds, TRUTH, strict=True)):
        mosaic.place(seen(ground, pose, mosaic.settings.features), str(i))
    mosaic.adjust(everything=True)
    return mosaic


@pytest.mark.long
def test_pairs_and_placements_are_told_as_they_happen(ground: Image, other_ground: Image) -> None:
    notes = Notes()
    fly(Mosaic(observer=notes), ground, ground, other_ground)
    (a, b, found), *others = notes.pairs
    assert (a, b) == ("1", "0")
    assert isinstance(found, Registration)
    shift = found.pixels_b - found.pixels_a  # both look straight down from the same height
    assert np.median(shift, axis=0) == pytest.approx([130, 0], abs=1)
    assert {a for a, _, _ in others} == {"2"}
    assert all(isinstance(refused, NotRegistered) and refused.reason for _, _, refused in others)
    assert [placement.name for placement in notes.placements] == ["0", "1"]
    assert all(isinstance(placement, Placement) for placement in notes.placements)


@pytest.mark.long
def test_a_refused_pair_tells_which_pixels_agreed_all_the_same(ground: Image) -> None:
    notes, registration = Notes(), StitchSettings().registration
    strict = StitchSettings(registration=type(registration)(least_evidence=1e6))
    fly(Mosaic(strict, observer=notes), ground, ground, ground)
    refused = notes.pairs[0][2]
    assert isinstance(refused, NotRegistered)
    assert len(refused.pixels_a) == len(refused.pixels_b) >= refused.inliers > 40
    assert np.median(refused.pixels_b - refused.pixels_a, axis=0) == pytest.approx([130, 0], abs=1)


@pytest.mark.long
def test_a_pose_that_is_not_believed_is_told_with_its_reason(ground: Image) -> None:
    notes = Notes()
    nothing_fits = StitchSettings(plausibility=PlausibilitySettings(most_residual_px=1e-6))
    fly(Mosaic(nothing_fits, observer=notes), ground, ground, ground)
    name, beside, reason = notes.disbeliefs[0]
    assert (name, beside) == ("1", "0")
    assert "misses its matches by" in reason


@pytest.mark.long
def test_residuals_are_what_two_frames_put_one_point_apart(ground: Image) -> None:
    notes = Notes()
    mosaic = fly(Mosaic(observer=notes), ground, ground, ground)
    island, residuals = notes.adjustments[-1]
    assert island == 0
    assert {frame.name for frame in residuals} == {"0", "1", "2"}
    assert all(np.median(np.linalg.norm(frame.misses, axis=1)) < 0.5 for frame in residuals)
    graph = mosaic._graph
    pose = graph.pose_of(2)
    graph.put(2, Pose(pose.x + 7, pose.y, pose.log_gsd, pose.yaw, pose.pitch, pose.roll), 0)
    moved = {frame.name: frame for frame in island_residuals(graph, 0)}
    assert np.median(moved["2"].misses, axis=0) == pytest.approx([-7, 0], abs=0.5)  # the others stayed behind


@pytest.mark.long
def test_several_are_told_the_same(ground: Image, other_ground: Image) -> None:
    first, second = Notes(), Notes()
    fly(Mosaic(observer=Observers(first, None, second)), ground, ground, other_ground)
    assert first.pairs == second.pairs
    assert first.placements == second.placements
    assert [island for island, _ in first.adjustments] == [island for island, _ in second.adjustments] == [0]
    assert len(first.pairs) > 1


@pytest.mark.long
def test_what_is_left_over_is_worked_out_only_for_whoever_asks(ground: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    class Uninterested(Notes):
        def adjusted(self, island: int, residuals: Callable[[], Sequence[Residuals]]) -> None:
            self.adjustments.append((island, ()))

    asked: list[ViewGraph] = []

    def noting(graph: ViewGraph, island: int) -> list[Residuals]:
        asked.append(graph)
        return []

    monkeypatch.setattr("gcs_mosaic.stitch.mosaic.island_residuals", noting)
    notes = Uninterested()
    fly(Mosaic(observer=notes), ground, ground, ground)
    assert notes.adjustments
    assert not asked


@pytest.mark.long
def test_one_that_raises_looks_on_no_more_and_changes_nothing(ground: Image, caplog: pytest.LogCaptureFixture) -> None:
    class Broken(Notes):
        def registered(self, a: str, b: str, found: Registration | NotRegistered) -> None:
            raise ValueError("no more paper")

    broken, notes = Broken(), Notes()
    mosaic = Mosaic(observer=Observers(broken, notes))
    for i in range(3):
        outcome = mosaic.place(seen(ground, Pose(400 + 130 * i, 500), mosaic.settings.features), str(i))
        assert isinstance(outcome, Placement)
    assert len(notes.placements) == 3
    assert len(broken.placements) == 1
    assert caplog.messages == ["Broken has failed, and looks on no more"]
