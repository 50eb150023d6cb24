from __future__ import annotations

import asyncio
import json
import threading

from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.web.change import MOST_TILES, Change, NotesChange, finest
from gcs_mosaic.web.feed import Feed, News

A, B = (0, Tile(16, 8, 8)), (0, Tile(16, 9, 8))


def test_refreshed_ancestors_are_not_taken_for_painted() -> None:
    parents = [(0, A[1].parent), (0, A[1].parent.parent)]
    assert finest([A, B, *parents]) == {A, B}
    assert finest([A, (1, A[1].parent)]) == {A, (1, A[1].parent)}


def test_two_changes_become_one() -> None:
    later = Change(2, frozenset([B])).after(Change(1, frozenset([A])))
    assert later == Change(2, frozenset([A, B]))
    assert Change(2, frozenset([B])).after(Change(1, None)) == Change(2, None)


def test_too_many_tiles_become_anything() -> None:
    many = frozenset((0, Tile(16, n, 0)) for n in range(MOST_TILES))
    assert Change(2, many).after(Change(1, frozenset([A]))).painted is None


def test_json_of_a_change() -> None:
    assert json.loads(Change(3, frozenset([A])).json()) == {"revision": 3, "tiles": [[0, 16, 8, 8]]}
    assert json.loads(Change(3, None).json()) == {"revision": 3, "tiles": None}


def test_slow_subscriber_gets_everything_as_one_change() -> None:
    feed = Feed()

    def write() -> None:
        for n in range(1, 101):
            feed.publish(n, [(0, Tile(16, n, 0))])

    async def read() -> News | None:
        with feed.subscribe() as subscription:
            writer = threading.Thread(target=write)
            writer.start()
            await asyncio.to_thread(writer.join, 5)
            return await subscription.next(5)

    change = asyncio.run(read())
    assert isinstance(change, Change)
    assert change.revision == 100
    assert change.painted == frozenset((0, Tile(16, n, 0)) for n in range(1, 101))
    assert feed.subscribers == 0


def test_no_news_is_none_and_closing_ends_the_waiting() -> None:
    feed = Feed()

    async def read() -> tuple[News | None, bool]:
        with feed.subscribe() as subscription:
            nothing = await subscription.next(0.01)
            asyncio.get_running_loop().call_later(0.01, feed.close)
            await subscription.next(10)
            return nothing, subscription.closed

    assert asyncio.run(asyncio.wait_for(read(), 5)) == (None, True)


def test_publishing_after_the_page_is_gone_does_no_harm() -> None:
    feed = Feed()

    async def subscribe_and_forget() -> None:
        feed.subscribe().__enter__()

    asyncio.run(subscribe_and_forget())
    feed.publish(1, [A])
    assert feed.revision == 1


def test_tiles_and_notes_are_merged_each_for_itself() -> None:
    feed = Feed()

    async def read() -> list[object]:
        with feed.subscribe() as subscription:
            for revision in (1, 2):
                feed.publish(revision, [A])
                feed.tell_notes(10 + revision)
            return [await subscription.next(timeout_s) for timeout_s in (1, 1, 0.01)]

    assert asyncio.run(read()) == [Change(2, frozenset([A])), NotesChange(12), None]
    assert NotesChange(12).event == 'event: notes\ndata: {"revision":12}\n\n'
