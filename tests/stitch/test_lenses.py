"""What an island knows of a lens is its own: no other island moves its frames, and whoever follows the map hears of all."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.bundle import lens
from gcs_mosaic.stitch.bundle.island import _lens_prior
from gcs_mosaic.stitch.bundle.levenberg_marquardt import any_lens
from gcs_mosaic.stitch.camera import geometry
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.projection import lens_terms
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.candidates import Search
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.graph.view_graph import Bridge, Lens, ViewGraph
from gcs_mosaic.stitch.mapping.covering import CoverSettings
from gcs_mosaic.stitch.mapping.islands import Bridges, _reconciled
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings
from gcs_mosaic.stitch.registration.outcome import Registration
from gcs_mosaic.stitch.transaction import attempt
from tests.benchmarks.flight_of_points import features_of_flight

pytestmark = pytest.mark.long


GOOD = 40  # frames of the good island
EVERY_FRAME = StitchSettings(cover=CoverSettings(enabled=False))  # placed, whether it shows new ground or not


def flight(frames: int, seed: int = 1) -> list[Features]:
    return [features for features, _ in zip(features_of_flight(GOOD, seed), range(frames), strict=False)]


def feed(mosaic: Mosaic, frames: list[Features], prefix: str) -> None:
    for i, features in enumerate(frames):
        mosaic.place(features, f"{prefix}{i}")
        mosaic.adjust()


def corners(mosaic: Mosaic, prefix: str) -> dict[str, Array]:
    return {
        p.name: geometry.canvas_from_pixels(p.pose, p.camera, geometry.frame_border(p.camera, 1))
        for p in mosaic.placements()
        if p.name.startswith(prefix)
    }


def islands_of(mosaic: Mosaic, prefix: str) -> set[int]:
    return {p.island for p in mosaic.placements() if p.name.startswith(prefix)}


def squeezed(features: Features, factor: float) -> Features:
    """What no camera sees: each frame's height in another proportion, and bent."""
    points = features.points.astype(float)
    middle = points.mean(axis=0)
    x, y = ((points - middle) / features.width).T
    points = middle + np.c_[x + 0.25 * factor * y**2, y * (1 + 0.25 * factor) + 0.3 * factor * x**2] * features.width
    inside = ((points >= 0) & (points < [features.width, features.height])).all(axis=1)
    return Features(
        points[inside].astype(np.float32), features.descriptors[inside], features.width, features.height, features.scale
    )


def resized(features: Features) -> Features:
    """The same frame, as a camera of half the size would have seen it."""
    points = np.asarray(features.points / 2, np.float32)
    return Features(points, features.descriptors, features.width // 2, features.height // 2, 0.5)


# Islands beside each other


@pytest.fixture(scope="module")
def stitched() -> Mosaic:
    mosaic = Mosaic(EVERY_FRAME)
    feed(mosaic, flight(GOOD), "good")
    mosaic.adjust(everything=True)
    return mosaic


@pytest.fixture
def mosaic(stitched: Mosaic) -> Iterator[Mosaic]:
    """A good island, as long as a test goes on."""
    with attempt(stitched):
        yield stitched


@pytest.mark.thorough
@pytest.mark.parametrize("bent", [False, True], ids=["two frames of other ground", "rubbish"])
def test_a_small_island_moves_nothing_of_a_good_one(mosaic: Mosaic, bent: bool) -> None:
    before = corners(mosaic, "good")
    assert len(before) == GOOD
    mosaic.moved()
    small = flight(5, seed=2) if bent else flight(2, seed=2)
    for i, features in enumerate(small):
        mosaic.place(squeezed(features, 0.5 * (-1) ** i) if bent else features, f"small{i}")
        mosaic.adjust()
        mosaic.adjust(everything=True)
    assert len(corners(mosaic, "small")) >= 2
    assert not islands_of(mosaic, "small") & islands_of(mosaic, "good")
    after = corners(mosaic, "good")
    assert all(np.array_equal(after[name], before[name]) for name in before)
    assert not {placement.name for placement in mosaic.moved()} & before.keys()


def test_a_small_island_begins_with_the_lens_of_the_good_one(mosaic: Mosaic) -> None:
    feed(mosaic, flight(2, seed=2), "small")
    of_good, of_small = ({p.camera for p in mosaic.placements() if p.name.startswith(k)} for k in ("good", "small"))
    (taught,), (learnt,) = of_good, of_small
    assert learnt.focal == pytest.approx(taught.focal, rel=0.1)
    assert learnt.k1 == pytest.approx(taught.k1, abs=0.04)


# Islands that are joined


def joining() -> list[tuple[str, Features]]:
    """The beginning of a flight, the end of it, which has nothing in common with that, and all between; two frame sizes."""
    frames = list(enumerate(flight(GOOD)))
    order = [*frames[:8], *frames[-8:], *frames[8:-8]]
    return [(str(i), resized(f) if i % 5 == 2 else f) for i, f in order]


def steps(mosaic: Mosaic) -> Iterator[None]:
    """After each thing that a flight does with a mosaic."""
    for name, features in joining():
        mosaic.place(features, name)
        yield
        mosaic.adjust()
        yield
    while mosaic.connect_some():
        yield
    mosaic.retry_waiting()
    yield
    mosaic.adjust(everything=True)
    yield


def said(placement: Placement) -> tuple[object, ...]:
    """Where a frame lies, bit for bit."""
    relief = placement.relief
    return (
        *(placement.island, placement.pose, placement.camera),
        None if relief is None else (relief.grid.shape, relief.grid.tobytes()),
    )


@pytest.mark.thorough
def test_whoever_listens_to_what_moved_knows_where_everything_lies() -> None:
    mosaic, most, joined = Mosaic(EVERY_FRAME), 0, False
    heard: dict[str, tuple[object, ...]] = {}
    for _ in steps(mosaic):
        heard |= {placement.name: said(placement) for placement in mosaic.moved()}
        assert heard == {placement.name: said(placement) for placement in mosaic.placements()}
        most = max(most, len(mosaic.frame_counts()))
        joined |= any(island.merged_into is not None for island in mosaic.islands)
    assert most >= 2
    assert joined
    assert {p.camera.width for p in mosaic.placements()} == {640, 320}
    assert len(heard) == GOOD


def test_a_join_moves_all_frames_of_the_cameras_that_both_islands_have(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of the island that stays, too: their lens is another now."""
    joins: list[tuple[set[int], set[int]]] = []
    join = Bridges.join

    def noted(bridges: Bridges, proof: list[Bridge]) -> tuple[int, int]:
        graph = bridges._graph
        sides = {graph.island_of(frame) for frame in (proof[0].frame_a, proof[0].frame_b)}
        assert all((island, camera) in graph.lenses for island in sides for camera in (0, 1))
        stayed = max((graph.members(island).tolist() for island in sides), key=len)
        graph.moved.clear()
        stays, goes = join(bridges, proof)
        joins.append((set(stayed), set(graph.moved)))
        assert graph.moved == set(graph.members(stays).tolist())
        assert (goes, 0) not in graph.lenses
        return stays, goes

    monkeypatch.setattr(Bridges, "join", noted)
    for _ in steps(Mosaic(EVERY_FRAME)):
        if joins:
            break
    (stayed, moved) = joins[0]
    assert len(stayed) >= 5
    assert moved > stayed


def known(focal: float, k1: float, weight: float) -> Lens:
    return Lens(Camera(640, 480, focal, k1), weight * np.diag([100.0, 400.0, 400.0, 2500.0, 2500.0]))


def information_of(known: Lens) -> Array:
    assert known.information is not None
    return known.information


def test_joined_islands_weigh_their_lenses_by_what_they_know() -> None:
    few, many = known(1.9, -0.2, 1.0), known(1.4, -0.1, 9.0)
    found = _reconciled(few, many)
    expected = 0.1 * np.array(lens_terms(few.camera)) + 0.9 * np.array(lens_terms(many.camera))
    assert np.allclose(lens_terms(found.camera), expected)
    assert np.allclose(information_of(found), information_of(few) + information_of(many))
    assert np.allclose(lens_terms(_reconciled(many, few).camera), expected)


def test_what_is_known_of_one_term_only_weighs_only_there() -> None:
    one, other = known(1.9, -0.2, 1.0), known(1.4, -0.1, 1.0)
    other = replace(other, information=np.diag([0.0, 400.0, 400.0, 2500.0, 2500.0]))
    found = _reconciled(one, other).camera
    assert found.focal == pytest.approx(1.9)
    assert found.k1 == pytest.approx(-0.15)


def test_a_fisheye_and_another_lens_have_no_mean() -> None:
    few, many = known(1.9, -0.1, 1.0), known(1.4, -0.05, 9.0)
    fisheye = replace(few, camera=replace(few.camera, fisheye=True))
    assert _reconciled(fisheye, many) is many
    assert _reconciled(many, fisheye) is many


def test_a_lens_that_was_never_estimated_weighs_nothing() -> None:
    known_lens, guessed = known(1.9, -0.2, 1.0), Lens(Camera(640, 480))
    assert _reconciled(known_lens, guessed) is known_lens
    assert _reconciled(guessed, known_lens) is known_lens
    assert _reconciled(guessed, Lens(Camera(640, 480, 1.1))) is guessed


def test_a_mean_that_no_camera_can_have_gives_way_to_the_lens_that_is_known_better() -> None:
    """Each is known well but for what trades off against focal length, and in that they contradict each other."""
    near, far = known(1.0, -0.2, 1.0), known(1.2, 0.05, 1.0)
    along = np.array([[1.0, -2.0, 0.0, 0.0, 0.0], [1.0, -1.9, 0.0, 0.0, 0.0]])
    near = replace(near, information=information_of(near) + 1e6 * np.outer(along[0], along[0]))
    far = replace(far, information=information_of(far) + 4e6 * np.outer(along[1], along[1]))
    for found in (_reconciled(near, far), _reconciled(far, near)):
        row = np.array([lens_terms(found.camera)])
        assert np.array_equal(lens.believable(row), row)
        assert found is far


def network_of(*frames: tuple[tuple[int, int], int]) -> ViewGraph:
    """Frames of these sizes on these islands."""
    graph = ViewGraph(1.5, 24)
    nothing = np.zeros((0, 2), np.float32), np.zeros((0, 128), np.uint8)
    for i, ((width, height), island) in enumerate(frames):
        while len(graph.merged_into) <= island:
            graph.found_island()
        graph.append(str(i), Features(*nothing, width, height, 1.0))
        graph.put(i, Pose(320, 240), island)
    return graph


LARGE, SMALL = (640, 480), (320, 240)


def test_of_a_camera_those_know_most_who_have_most_of_its_frames() -> None:
    """A large island with one frame of a camera is no teacher of an island with six."""
    graph = network_of(*[(LARGE, 0)] * 9, (SMALL, 0), *[(SMALL, 1)] * 6, (SMALL, 2))
    one_frame, six_frames = known(1.2, 0.0, 1.0), known(1.8, -0.1, 9.0)
    graph.lenses |= {(0, 1): one_frame, (1, 1): six_frames}
    assert graph.best_known_lens(1) == 1
    settings = EVERY_FRAME.adjustment
    of_any = np.stack(any_lens(settings))
    assert np.array_equal(_lens_prior(graph, 1, 1, settings), of_any)
    assert not np.array_equal(_lens_prior(graph, 0, 1, settings), of_any)
    del graph.lenses[2, 1]
    assert graph.camera_on(2, 1) == six_frames.camera


def test_a_camera_that_only_the_island_that_goes_has_keeps_its_lens() -> None:
    graph = network_of(*[(LARGE, 0)] * 3, (LARGE, 1), (SMALL, 1))
    lens_of_small = Lens(Camera(*SMALL, 1.3, -0.1), np.eye(5))
    graph.lenses[1, 1] = lens_of_small
    bridges = Bridges(graph, Search(graph, EVERY_FRAME.search, EVERY_FRAME.registration), EVERY_FRAME.islands)
    places = np.array([[100.0, 100.0], [500.0, 100.0], [500.0, 400.0], [100.0, 400.0]])
    registration = Registration(places, places, np.zeros((4, 2), int), np.eye(3), independent_inliers=4, evidence=9.0)
    assert bridges.join([Bridge(0, 3, registration)]) == (0, 1)
    assert graph.lenses[0, 1] is lens_of_small
    assert set(graph.lenses) == {(0, 0), (0, 1)}


def test_a_lens_that_changes_moves_its_camera_on_its_island_and_no_other() -> None:
    graph = network_of((LARGE, 0), (LARGE, 0), (SMALL, 0), (LARGE, 1))
    graph.moved.clear()
    boxes = graph.boxes.copy()
    graph.put_all([0], [graph.pose_of(0)], 0, {0: Lens(Camera(640, 480, 1.3, -0.1))})
    assert graph.moved == {0, 1}
    assert (graph.boxes[[0, 1]] != boxes[[0, 1]]).any(axis=1).all()
    assert np.array_equal(graph.boxes[[2, 3]], boxes[[2, 3]])
    assert graph.camera_of(1).focal == 1.3
    assert graph.camera_of(3).focal == 1.5


# Lenses that cannot be


@pytest.mark.parametrize(
    ("focal", "k1", "k2"),
    [(1.21, -0.01, 0.0), (0.75, -0.26, 0.07), (2.19, -0.151, 0.112), (1.5, 0.0, 0.0), (6.24, 0.0, 0.0)],
    ids=["survey drone", "action camera", "long lens", "any", "135 mm"],
)
def test_ordinary_lenses_are_left_alone(focal: float, k1: float, k2: float) -> None:
    given = np.array([[np.log(focal), k1, k2, 0.01, -0.02]])
    assert np.array_equal(lens.believable(given), given)


def test_a_stereographic_fisheye_of_160_degrees_is_left_alone() -> None:
    """What moves its corners outward is only believed of a fisheye."""
    given = np.array([[np.log(0.6), 0.083, 0.008, 0.0, 0.0]])
    assert np.array_equal(lens.believable(given, np.array([True])), given)
    assert not np.array_equal(lens.believable(given), given)


@pytest.mark.parametrize(
    ("focal", "k1", "k2"), [(3.3, 0.86, 0.0), (0.9, -0.9, 0.0), (0.1, 0.0, 0.0), (0.7, -0.4, -0.3)]
)
def test_others_are_pulled_in(focal: float, k1: float, k2: float) -> None:
    given = np.array([[np.log(focal), k1, k2, 0.0, 0.0]])
    found = lens.believable(given)
    assert not np.array_equal(found, given)
    corner = np.exp(-found[0, 0])
    assert 1 / corner * (1 + 1e-12) >= lens.SHORTEST_FOCAL
    shift = found[0, 1] * corner**2 + found[0, 2] * corner**4
    assert -lens.MOST_BARREL - 1e-9 <= shift <= lens.MOST_PINCUSHION + 1e-9
    assert geometry.lens_reach(found[0, 1], found[0, 2]) >= corner
    assert np.allclose(lens.believable(found), found)


def test_hopeless_matches_say_little_of_the_lens() -> None:
    """Places of features off by several pixels, each in each frame anew: the lens stays near what is expected of any."""
    noise, mosaic = np.random.default_rng(5), Mosaic(EVERY_FRAME)
    for i, features in enumerate(flight(6)):
        bent = features.points + noise.normal(0, 3.0, features.points.shape).astype(np.float32)
        inside = ((bent >= 0) & (bent < [features.width, features.height])).all(axis=1)
        mosaic.place(Features(bent[inside], features.descriptors[inside], 640, 480, 1.0), str(i))
        mosaic.adjust(everything=True)
    placed = mosaic.placements()
    assert len(placed) >= 2
    found = np.array(lens_terms(placed[-1].camera))
    prior = mosaic.settings.adjustment
    assert abs(found[0] - np.log(prior.focal_prior)) < prior.focal_prior_log_sigma
    assert abs(found[1]) < prior.k1_prior_sigma
    assert abs(found[2]) < prior.k2_prior_sigma
    assert np.abs(found[3:]).max() < prior.shift_prior_sigma
