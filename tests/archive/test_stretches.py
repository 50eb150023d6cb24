"""What is placed in stretches is what would have been placed in one."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.archive.adjustment import adjustment
from gcs_mosaic.archive.artefacts import Artefacts, Lost
from gcs_mosaic.archive.files import files_at
from gcs_mosaic.archive.islands import chunk_matches, islands, stricter
from gcs_mosaic.archive.look_up import NumberedFrame, PairBook
from gcs_mosaic.archive.pairs import KnownPairs, pair_group
from gcs_mosaic.archive.relief import relief
from gcs_mosaic.archive.stretches import KnownPair, joined, stretch, together
from gcs_mosaic.archive.tasks import listed
from gcs_mosaic.stitch.arrays import FloatRows
from gcs_mosaic.stitch.bundle.island import island_task
from gcs_mosaic.stitch.bundle.matched_points import matched, sightings
from gcs_mosaic.stitch.bundle.relief import displacements
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels, similarity_between
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.placement import Outcome, Placement
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings
from gcs_mosaic.store.checkpoint import decoded, encoded
from sitl.path import Plan, fly
from tests.benchmarks.flight_of_points import LENS, features_of_flight, features_of_states

SETTINGS = StitchSettings()
WITHOUT_RELIEF = replace(SETTINGS.adjustment, relief=replace(SETTINGS.adjustment.relief, cells=0))
FRAMES = 16
# Cells of two grounds, north-west and south-east.
CORNERS = {*((x, y) for x in (-3, -2, -1) for y in (1, 2)), *((x, y) for x in (0, 1, 2) for y in (-3, -2))}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Features of a flight, and the registrations of all pairs of its frames."""
    folder = tmp_path_factory.mktemp("artefacts")
    found = Artefacts(files_at(str(folder)))
    for number, features in zip(range(FRAMES), features_of_flight(FRAMES), strict=False):
        kept(found, number, features)
    compared(found, FRAMES)
    return folder


def kept(artefacts: Artefacts, number: int, features: Features) -> None:
    places = replace(features, kept_descriptors=features.descriptors[:, :0])
    nothing = dict.fromkeys(("faint", "texture", "learned"))
    artefacts.put(f"frame/{number}", {"places": places, "descriptors": features.descriptors} | nothing)


def compared(artefacts: Artefacts, frames: int, near: int = FRAMES) -> None:
    """Register frames with those of at most so many frames before."""
    for number in range(frames):
        others = range(max(0, number - near), number)
        pairs = tuple(((f"frame/{other}", NO_BORDER), (f"frame/{number}", NO_BORDER)) for other in others)
        artefacts.put(f"pairs/{number}", pair_group(artefacts, pairs, SETTINGS.registration))


@pytest.fixture
def artefacts(made: Path, tmp_path: Path) -> Artefacts:
    return Artefacts(files_at(str(shutil.copytree(made, tmp_path / "artefacts"))))


def frames_from(artefacts: Artefacts, start: int, end: int) -> str:
    return listed(artefacts, [numbered(number) for number in range(start, end)])


def numbered(number: int, folder: int = 0) -> NumberedFrame:
    return NumberedFrame(number, str(number), f"frame/{number}", NO_BORDER, folder)


def pairs_of(artefacts: Artefacts, firsts: range, seconds: range) -> str:
    """Pairs of a first frame with an earlier second one."""
    found = list[KnownPair]()
    for one in firsts:
        of_one = artefacts.part(f"pairs/{one}", "found")
        for other in (number for number in seconds if (f"frame/{number}", f"frame/{one}") in of_one):
            is_one = not isinstance(of_one[f"frame/{other}", f"frame/{one}"], str)
            found.append(((other, one), (f"pairs/{one}", is_one)))
    return listed(artefacts, found)


def none_of(artefacts: Artefacts) -> str:
    return listed(artefacts, [])


def placed(artefacts: Artefacts, start: int, end: int) -> str:
    frames, pairs = frames_from(artefacts, start, end), pairs_of(artefacts, range(start, end), range(start, end))
    artefacts.put(key := f"placed/{start}-{end}", stretch(artefacts, frames, pairs, SETTINGS))
    return key


def map_of(artefacts: Artefacts, *parts: str, pairs: str) -> dict[str, Placement]:
    """All frames on the only island, after its adjustment."""
    artefacts.put("islands", islands(artefacts, parts, pairs, SETTINGS))
    artefacts.put("adjusted", adjustment(artefacts, "islands", 0, spread=False))
    chunks = range(len(artefacts.part("adjusted", "summary")))
    found = [placement for chunk in chunks for placement in artefacts.part("adjusted", f"placements {chunk}")]
    return {placement.name: placement for placement in found}


def apart(one: dict[str, Placement], other: dict[str, Placement]) -> float:
    """Largest distance of the corners of frames, after one similarity; pixels."""
    corners = np.array([[0.0, 0.0], [LENS.width, 0.0], [LENS.width, LENS.height], [0.0, LENS.height]])
    here, there = (
        np.concatenate([canvas_from_pixels(places[name].pose, places[name].camera, corners) for name in sorted(one)])
        for places in (one, other)
    )
    scale, angle, shift = similarity_between(here, there)
    c, s = np.cos(angle), np.sin(angle)
    return float(np.linalg.norm(scale * here @ np.array([[c, s], [-s, c]]) + shift - there, axis=1).max())


@pytest.mark.long
@pytest.mark.thorough
def test_four_stretches_that_are_joined_twice_are_the_map_of_one(artefacts: Artefacts) -> None:
    whole = map_of(artefacts, placed(artefacts, 0, FRAMES), pairs=none_of(artefacts))
    quarters = [range(at, at + FRAMES // 4) for at in range(0, FRAMES, FRAMES // 4)]
    parts = [placed(artefacts, one.start, one.stop) for one in quarters]
    halves = list[str]()
    for number in (0, 2):
        between = pairs_of(artefacts, quarters[number + 1], quarters[number])
        artefacts.put(
            key := f"joined/{number}", joined(artefacts, tuple(parts[number : number + 2]), between, SETTINGS)
        )
        halves.append(key)
    left = pairs_of(artefacts, range(FRAMES // 2, FRAMES), range(FRAMES // 2))
    found = map_of(artefacts, *halves, pairs=left)
    assert len(found) == len(whole) == FRAMES
    assert apart(found, whole) < 3 * max(placement.corner_deviation_px for placement in whole.values()) < 3.0


@pytest.fixture
def unfolded(monkeypatch: pytest.MonkeyPatch) -> list[Mosaic]:
    """What was placed, each time before it was folded."""
    found, fold = list[Mosaic](), Mosaic.fold

    def watched(mosaic: Mosaic) -> None:
        whole = Mosaic(SETTINGS)
        whole.load(decoded(encoded(mosaic.saved())))
        found.append(whole)
        fold(mosaic)

    monkeypatch.setattr(Mosaic, "fold", watched)
    return found


@pytest.mark.long
def test_what_a_stretch_leaves_in_the_store_is_found_there_when_it_is_joined(
    artefacts: Artefacts, unfolded: list[Mosaic]
) -> None:
    found = together(artefacts, [placed(artefacts, 0, FRAMES)], none_of(artefacts), SETTINGS).mosaic._graph
    whole = unfolded[0]._graph
    assert len(found.frames) == len(whole.frames) == FRAMES
    assert found.links.keys() == whole.links.keys()
    for frame, (here, there) in enumerate(zip(found.frames, whole.frames, strict=True)):
        assert np.array_equal(here.features.points, there.features.points)
        assert found.matched_before(frame).any()
        assert np.array_equal(found.matched_before(frame), whole.matched_before(frame))
    one, other = (island_task(graph, 0, WITHOUT_RELIEF) for graph in (found, whole))
    assert one is not None
    assert other is not None
    assert np.array_equal(one.problem.pixels_a, other.problem.pixels_a)
    assert np.array_equal(one.problem.pixels_b, other.problem.pixels_b)


@pytest.mark.long
def test_the_relief_of_a_chunk_is_what_all_matches_of_its_frames_say(
    artefacts: Artefacts, unfolded: list[Mosaic]
) -> None:
    artefacts.put("islands", islands(artefacts, (placed(artefacts, 0, FRAMES),), none_of(artefacts), SETTINGS))
    artefacts.put("adjusted", adjustment(artefacts, "islands", 0, spread=False))
    settings = SETTINGS.adjustment.relief
    artefacts.put("relief", relief(artefacts, "adjusted", 0, 0, "islands", settings))
    placements: list[Placement] = artefacts.part("relief", "placements")
    matches = matched(unfolded[0]._graph, range(FRAMES))
    assert matches is not None
    expected = displacements(sightings(matches), [(one.pose, one.camera) for one in placements], settings)
    for one, sheet in zip(placements, expected, strict=True):
        assert one.relief is not None
        assert sheet is not None
        assert np.abs(grid_of(one.relief)).max() > 1e-5
        assert np.allclose(grid_of(one.relief), grid_of(sheet), atol=1e-6)


def grid_of(sheet: ReliefDisplacement) -> FloatRows:
    return np.frombuffer(sheet.shifts, np.float32).reshape(-1, 2)


def test_only_what_the_store_registered_is_sought_there_as_a_match(artefacts: Artefacts) -> None:
    """Frames are linked, too, that were compared in vain before their place was known, or never."""
    known = KnownPairs({(0, 1): ("pairs/1", True), (0, 2): ("pairs/2", False)})
    book = PairBook(artefacts, [numbered(number) for number in range(4)], known)
    somewhere = Placement("0", 0, Pose(0, 0, 0, 0), Camera(400, 300, focal=1.2), None, 30, 0.5, ("1", "2", "3"), 0, 0.1)
    others = [replace(somewhere, name=str(number), neighbours=("0",)) for number in range(1, 4)]
    (chunk,) = chunk_matches(book, [somewhere, *others])
    assert chunk.links == (((0, 1), "pairs/1"),)


@pytest.mark.long
def test_each_folder_has_a_camera_of_its_own(artefacts: Artefacts) -> None:
    frames = listed(artefacts, [numbered(number, folder=number // 8) for number in range(FRAMES)])
    pairs = pairs_of(artefacts, range(FRAMES), range(FRAMES))
    artefacts.put("placed", stretch(artefacts, frames, pairs, SETTINGS))
    found = map_of(artefacts, "placed", pairs=none_of(artefacts))
    assert len(found) == FRAMES
    assert len({found[str(number)].camera for number in range(8)}) == 1
    assert len({placement.camera for placement in found.values()}) == 2


@pytest.mark.long
def test_a_frame_that_cannot_be_placed_does_not_keep_the_others_from_it(
    artefacts: Artefacts, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = Mosaic.place

    def failing(mosaic: Mosaic, features: Features, name: str, **more: int) -> Outcome:
        if name == "5":
            raise np.linalg.LinAlgError("singular")
        return place(mosaic, features, name, **more)

    monkeypatch.setattr(Mosaic, "place", failing)
    artefacts.put("islands", islands(artefacts, (placed(artefacts, 0, FRAMES),), none_of(artefacts), SETTINGS))
    _, _, places, _, rejected = artefacts.part("islands", "summary")
    assert set(places) == {str(number) for number in range(FRAMES) if number != 5}
    assert [(one.name, one.reason) for one in rejected] == [
        ("5", "it could not be processed (LinAlgError('singular'))")
    ]


def test_what_is_lost_is_asked_for_whatever_became_of_it(artefacts: Artefacts) -> None:
    """A step that fails is no reason to go on without what the store is to give once more."""
    frames, pairs = frames_from(artefacts, 0, FRAMES), pairs_of(artefacts, range(FRAMES), range(FRAMES))
    artefacts.files.remove("pairs/7")
    with pytest.raises(Lost, match="pairs/7"):
        stretch(artefacts, frames, pairs, SETTINGS)


@pytest.mark.long
def test_a_join_is_refuted_by_frames_that_were_never_compared(tmp_path: Path) -> None:
    """Two grounds that are alike in opposite corners: the two pairs of frames that show these agree, and only those are known."""
    found, each = Artefacts(files_at(str(tmp_path))), 18
    states = fly("survey", LENS, Plan(frames=each, height=50.0, forward=0.4, side=0.3))
    for ground in (0, 1):
        for number, features in enumerate(features_of_states(states, 1 + ground, seen=600, shared=CORNERS)):
            kept(found, number + ground * each, features)
    compared(found, 2 * each, near=10)
    parts = placed(found, 0, each), placed(found, each, 2 * each)
    corners = [(0, each), (each - 1, 2 * each - 1)]
    keys = tuple(((f"frame/{one}", NO_BORDER), (f"frame/{other}", NO_BORDER)) for one, other in corners)
    found.put("corners", pair_group(found, keys, SETTINGS.registration))
    assert found.part("corners", "summary") == [True, True]
    known = listed(found, [(pair, ("corners", True)) for pair in corners])
    found.put("islands", islands(found, parts, known, SETTINGS))
    merged, _, places, _, _ = found.part("islands", "summary")
    assert len(places) == 2 * each
    assert merged == (None, None)


@pytest.mark.long
def test_a_frame_that_one_pair_places_is_refuted_by_frames_that_it_was_never_compared_with(tmp_path: Path) -> None:
    """A frame of another ground, alike in the north: it is known with the northernmost frame only."""
    found, flown = Artefacts(files_at(str(tmp_path))), 6
    flight = fly("survey", LENS, Plan(frames=flown, height=50.0, forward=0.4, side=0.3))
    states = [replace(state, y=state.y + 52.0) for state in flight]
    north = {(x, y) for x in range(-4, 4) for y in (2, 3)}
    for number, features in enumerate(features_of_states(states, 1, seen=600, shared=north)):
        kept(found, number, features)
    stranger = replace(states[0], y=states[0].y - 19.0)
    kept(found, flown, next(features_of_states([stranger], 2, seen=600, shared=north)))
    compared(found, flown + 1)
    known = found.part(pairs_of(found, range(flown), range(flown)), "list")
    ((pair, key_and_verdict),) = found.part(pairs_of(found, range(flown, flown + 1), range(1)), "list")
    assert key_and_verdict[1], "the two frames do not register, so nothing is to be refuted"
    known.append((pair, key_and_verdict))
    found.put("placed", stretch(found, frames_from(found, 0, flown + 1), listed(found, known), SETTINGS))
    found.put("islands", islands(found, ("placed",), none_of(found), SETTINGS))
    _, _, places, _, rejected = found.part("islands", "summary")
    assert set(places) == {str(number) for number in range(flown)}
    assert [one.name for one in rejected] == [str(flown)]


def test_the_more_frames_the_more_evidence_joins_two_islands() -> None:
    asked = [stricter(SETTINGS, frames).islands.least_evidence for frames in (1, 1_000, 10_000, 10_001, 100_000)]
    flight = SETTINGS.islands.least_evidence
    assert asked == pytest.approx([flight, flight, flight + 1, flight + 1, flight + 2])
