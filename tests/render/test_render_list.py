from painting_parts import painted

from gcs_mosaic.render.render_list import Extent, RenderList
from gcs_mosaic.render.tile_grid import Tile

A, B = Tile(16, 5, 5), Tile(16, 6, 5)


def test_frames_on_a_tile_are_in_capture_order() -> None:
    frames = RenderList()
    for order in (3, 1, 2):
        frames.add(painted(order), [A])
    assert [p.order for p in frames.on((0, A))] == [1, 2, 3]
    assert frames.is_last(painted(3), (0, A))
    assert frames.on((0, B)) == []


def test_a_frame_that_moved_is_only_where_it_is_now() -> None:
    frames = RenderList()
    frames.add(painted(1), [A, B])
    assert frames.add(painted(1, 9.0), [B]) == {(0, B)}
    assert frames.on((0, A)) == []
    assert frames.on((0, B)) == [painted(1, 9.0)]


def test_next_after_walks_through_all_frames_of_some_tiles_once() -> None:
    frames = RenderList()
    for order, tiles in ((4, [A]), (2, [A, B]), (7, [B]), (5, [])):
        frames.add(painted(order), tiles)
    seen, turn = [], None
    while found := frames.next_after(turn, [(0, A), (0, B)]):
        seen.append(found[0].order)
        turn = found[0].turn
    assert seen == [2, 4, 7]
    assert [one.order for one in frames.next_after(None, [(0, A), (0, B)], 2)] == [2, 4]


def test_the_extent_holds_all_tiles_and_levels() -> None:
    frames = RenderList()
    assert frames.extent(0) is None
    frames.add(painted(1, level=16), [Tile(16, 32768, 32768)])
    frames.add(painted(2, level=15), [Tile(15, 16385, 16384)])
    assert frames.extent(0) == Extent((-0.5, -0.5, 1023.5, 511.5), 15, 16)
    frames.remove("2.jpg")
    assert frames.extent(0) == Extent((-0.5, -0.5, 255.5, 255.5), 16, 16)
