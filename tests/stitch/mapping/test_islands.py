"""A bridge between islands is a hypothesis: it must fit itself, others on other ground, and what the islands should share."""

from dataclasses import replace

import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, Image, photograph

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.features.extraction import FeatureSettings, extract
from gcs_mosaic.stitch.graph.candidates import Search, SearchSettings
from gcs_mosaic.stitch.graph.view_graph import Bridge, ViewGraph
from gcs_mosaic.stitch.mapping import islands
from gcs_mosaic.stitch.mapping.islands import Bridges, IslandSettings
from gcs_mosaic.stitch.registration.a_contrario import Confirmed
from gcs_mosaic.stitch.registration.outcome import Registration
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

PLACES = [(300, 300), (450, 300), (600, 300), (300, 480), (450, 480), (600, 480)]
FIRST, SECOND = (0, 1, 2), (3, 4, 5)  # two lines side by side, each an island
AWAY = 5000.0  # where the second island lies on its own canvas


@pytest.fixture
def search(ground: Image) -> Search:
    graph = ViewGraph(SMALL_CAMERA.focal, 24)
    for _ in (FIRST, SECOND):
        graph.found_island()
    search = Search(graph, SearchSettings(), RegistrationSettings())
    for frame, (x, y) in enumerate(PLACES):
        features = extract(photograph(ground, Pose(x, y), SMALL_CAMERA), FeatureSettings())
        graph.append(str(frame), features)
        graph.put(frame, Pose(x + AWAY * (frame in SECOND), y), int(frame in SECOND))
    return search


@pytest.fixture
def bridges(search: Search) -> Bridges:
    return Bridges(search._graph, search, IslandSettings())


def registered(search: Search, a: int, b: int) -> Registration:
    found = search.register(a, b)
    assert found is not None
    return found


def bridge(search: Search, a: int, b: int) -> Bridge:
    return Bridge(a, b, registered(search, a, b))


def matching(found: Registration, pixels_a: Array, pixels_b: Array) -> Registration:
    return replace(found, pixels_a=pixels_a, pixels_b=pixels_b)


@pytest.mark.long
def test_one_bridge_is_enough_where_the_overlap_bears_it_out_on_other_ground(search: Search, bridges: Bridges) -> None:
    proof = bridges.add(bridge(search, 3, 0))
    assert len(proof) > 1
    assert bridges.join(proof) == (0, 1)
    graph = search._graph
    assert graph.frame_counts() == {0: 6}
    for frame, place in enumerate(PLACES):
        assert (graph.pose_of(frame).x, graph.pose_of(frame).y) == pytest.approx(place, abs=2)


@pytest.mark.long
def test_bridges_that_share_their_ground_count_once(
    search: Search, bridges: Bridges, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs_mosaic.stitch.mapping.islands.PAIRS_PER_WITNESS", 0)
    thing = registered(search, 3, 0)
    assert not bridges.add(Bridge(3, 0, thing))
    shifted = matching(thing, thing.pixels_a - [150, 0], thing.pixels_b - [150, 0])
    assert not bridges.add(Bridge(4, 1, shifted))
    assert bridges.add(bridge(search, 5, 2))


@pytest.mark.long
def test_an_overlap_that_does_not_bear_it_out_refutes_any_number_of_bridges(search: Search, bridges: Bridges) -> None:
    """Right matches on something alike, 80 px further: what should lie around it is not found."""
    for a, b in ((3, 0), (4, 1), (5, 2)):
        found = registered(search, a, b)
        one_thing = (np.abs(found.pixels_a - [240, 60]) < 50).all(axis=1)
        wrong = matching(found, found.pixels_a[one_thing], found.pixels_b[one_thing] + [80, -120])
        assert not bridges.add(Bridge(a, b, wrong))


@pytest.mark.long
def test_a_bridge_whose_own_matches_disagree_is_none(search: Search, bridges: Bridges) -> None:
    mess = matching(registered(search, 3, 0), *np.random.default_rng(1).uniform(0, 350, (2, 40, 2)))
    assert bridges.add(Bridge(3, 0, mess)) == []


@pytest.mark.long
def test_a_bridge_that_agrees_with_itself_only_from_one_side_breaks_nothing(
    search: Search, bridges: Bridges, monkeypatch: pytest.MonkeyPatch
) -> None:
    agree = Bridges._agree
    monkeypatch.setattr(Bridges, "_agree", lambda self, a, b: a.frame_a < a.frame_b and agree(self, a, b))
    for a, b in ((3, 0), (1, 4), (5, 2)):
        bridges.add(bridge(search, a, b))
    monkeypatch.undo()
    assert bridges.add(bridge(search, 3, 0))


def seeing(monkeypatch: pytest.MonkeyPatch, *around: Confirmed) -> None:
    """What is found around one witness after the other."""
    left = list(around)
    monkeypatch.setattr("gcs_mosaic.stitch.graph.overlap_check.confirmed_around", lambda *_: left.pop(0))


MUCH_SEEN, LITTLE_SEEN, NOTHING_SEEN = Confirmed(0.9, 30), Confirmed(0.0, 1), Confirmed(1.0, 0)


@pytest.mark.long
@pytest.mark.parametrize("other", [LITTLE_SEEN, NOTHING_SEEN], ids=["one cell", "nothing"])
def test_a_witness_that_has_seen_too_little_to_tell_refutes_nothing(
    search: Search, bridges: Bridges, monkeypatch: pytest.MonkeyPatch, other: Confirmed
) -> None:
    seeing(monkeypatch, *[MUCH_SEEN, other, MUCH_SEEN] * 2)
    assert not bridges.add(bridge(search, 4, 1)), "nor does what was looked for where the first bridge leads prove it"
    assert bridges.add(bridge(search, 5, 2))


@pytest.mark.long
def test_where_a_witness_cannot_tell_bridges_must_prove_it_alone(
    search: Search, bridges: Bridges, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(islands, "PAIRS_PER_WITNESS", 0)
    seeing(monkeypatch, *[MUCH_SEEN, NOTHING_SEEN, MUCH_SEEN] * 2)
    assert not bridges.add(bridge(search, 3, 0))
    assert bridges.add(bridge(search, 5, 2))


@pytest.mark.long
def test_a_witness_that_has_seen_enough_and_found_nothing_refutes_any_bridge(
    search: Search, bridges: Bridges, monkeypatch: pytest.MonkeyPatch
) -> None:
    seeing(monkeypatch, Confirmed(0.0, 8), MUCH_SEEN, MUCH_SEEN)
    assert not bridges.add(bridge(search, 4, 1))


@pytest.mark.long
def test_two_frames_make_one_bridge_however_often_they_are_compared(
    search: Search, bridges: Bridges, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs_mosaic.stitch.mapping.islands.PAIRS_PER_WITNESS", 0)
    for a, b in ((3, 0), (0, 3), (3, 0)):
        assert not bridges.add(bridge(search, a, b))
    assert len(search._graph.bridges) == 1
