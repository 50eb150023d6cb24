"""Where several aircraft fly, each camera has a lens of its own, and the search for a frame begins where its aircraft was."""

from __future__ import annotations

import numpy as np

from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.union import Renamed, unite
from gcs_mosaic.stitch.graph.view_graph import ViewGraph


def frame_of(graph: ViewGraph, aircraft: int | None, order: int, size: tuple[int, int] = (640, 480)) -> int:
    """Place one more frame, beside nothing."""
    graph.turn_to(order, aircraft)
    nothing = np.zeros((0, 2), np.float32), np.zeros((0, 128), np.uint8)
    frame = graph.append(str(order), Features(*nothing, *size, 1.0))
    graph.put(frame, Pose(320, 240), 0)
    graph.last_placed = frame
    return frame


def graph_of(*flown: tuple[int | None, int]) -> ViewGraph:
    graph = ViewGraph(1.5, 24)
    graph.found_island()
    for aircraft, order in flown:
        frame_of(graph, aircraft, order)
    return graph


def test_each_aircraft_has_a_camera_of_its_own_for_each_size() -> None:
    graph = graph_of((1, 0), (2, 1), (1, 2))
    frame_of(graph, 1, 3, size=(320, 240))
    assert graph.cameras.tolist() == [0, 1, 0, 2]
    assert graph.aircraft_of == [1, 2, 1]


def test_a_flight_without_a_frame_adds_nothing_to_another() -> None:
    graph = graph_of((1, 0), (1, 1))
    islands = unite(graph, ViewGraph(1.5, 24), Renamed(name_of=str, aircraft_of=lambda one: one))
    assert (islands, len(graph.frames), graph.last_placed) == (1, 2, 1)


def test_the_search_begins_at_the_last_frame_of_the_same_aircraft() -> None:
    graph = graph_of((1, 0), (2, 1), (1, 2), (2, 3))
    for order, aircraft, last in ((4, 1, 2), (5, 2, 3), (6, 2, 3), (7, 3, 3)):
        graph.turn_to(order, aircraft)
        assert graph.last_placed == last


def test_a_frame_that_was_skipped_is_sought_beside_its_neighbours_in_time_of_its_aircraft() -> None:
    graph = graph_of((1, 0), (2, 1), (1, 8), (2, 9))
    graph.turn_to(2, 1)
    assert graph.last_placed == 0
    graph.turn_to(3, 2)
    assert graph.last_placed == 1


def test_a_lone_aircraft_goes_on_from_the_frame_before() -> None:
    graph = graph_of((None, 0), (None, 1))
    graph.turn_to(2)
    assert graph.last_placed == 1
