"""XYZ as QGroundControl and the like ask: what is shown where, gaps, ETags, changes, islands, other flights' names."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest
from aiohttp import web

from gcs_mosaic.geotiles.earth_islands import EarthIsland
from gcs_mosaic.geotiles.picture_grid import grid_of_tile
from gcs_mosaic.render.tile_grid import Tile, ancestor
from gcs_mosaic.web.api.notes import Notes
from gcs_mosaic.web.feed import Feed
from tests.running import until
from tests.web.maps.anchored_flight import FLIGHT, AnchoredFlight, laid_at, picture_of
from tests.web.test_notes_api import Writer

BASE = f"/maps/{FLIGHT}"
# As QGroundControl's tile fetcher sends them.
QGC = {
    "Host": "",
    "Accept": "*/*",
    "User-Agent": "Mozilla/5.0 (X11; Ubuntu; Linux x86_64; rv:109.0) Gecko/20100101 Firefox/117.0",
    "Connection": "keep-alive",
    "Accept-Language": "en-US,*",
}


def address(laid: EarthIsland, level: int, x: float = 0.0, y: float = 0.0, suffix: str = "png") -> str:
    column, row = laid_at(laid, level, x, y)
    return f"{BASE}/{level}/{column}/{row}.{suffix}"


def test_a_tile_shows_the_ground_where_the_pins_say(pinned: Writer, flight: AnchoredFlight) -> None:
    for level in range(flight.laid.levels[1] - 2, flight.laid.levels[1] + 3):
        answer, data = pinned.ask(address(flight.laid, level, 100.0, 50.0))
        assert (answer.status, answer.headers["Content-Type"]) == (200, "image/png")
        assert answer.headers["Cache-Control"] == "no-cache"
        shown = picture_of(data)
        assert shown.shape == (256, 256, 4)
        middles = np.arange(256.0) + 0.5
        places = grid_of_tile(level, *laid_at(flight.laid, level, 100.0, 50.0)).places(middles, middles)
        truth = flight.colour_at(places[..., 0], places[..., 1])
        seen = shown[..., 3] == 255
        assert seen.mean() > 0.1
        assert np.abs(shown[..., :3].astype(float) - truth)[seen].mean() < 1.5


def test_gaps_are_200_and_transparent(pinned: Writer, flight: AnchoredFlight) -> None:
    """QGroundControl counts anything else as an error, and stops asking the server after some."""
    level = flight.laid.levels[1]
    for path in (f"{BASE}/{level}/0/0.png", f"{BASE}/0/0/0.png", f"{BASE}/26/1/1.png"):
        answer, data = pinned.ask(path, **{**QGC, "Host": pinned.netloc})
        assert (answer.status, answer.headers["Content-Type"]) == (200, "image/png")
        shown = picture_of(data)
        assert shown.shape == (256, 256, 4)
        assert not shown.any()
    answer, data = pinned.ask(f"{BASE}/{level}/0/0.jpg")
    assert answer.headers["Content-Type"] == "image/jpeg"
    assert picture_of(data).min() == 255
    assert pinned.ask(f"{BASE}/{level}/0/0.webp")[0].headers["Content-Type"] == "image/webp"


def test_what_is_known_is_not_sent_again(pinned: Writer, flight: AnchoredFlight) -> None:
    path = address(flight.laid, flight.laid.levels[1])
    etag = pinned.ask(path)[0].headers["ETag"]
    answer, data = pinned.ask(path, **{"If-None-Match": etag})
    assert (answer.status, data) == (304, b"")
    assert pinned.status(path, **{"If-None-Match": '"other"'}) == 200
    assert pinned.status(path, "HEAD") == 200


def test_a_tile_that_is_painted_is_another_at_once_and_those_far_away_are_kept(
    pinned: Writer, flight: AnchoredFlight, feed: Feed
) -> None:
    level = flight.laid.levels[1]
    here, far = address(flight.laid, level, 128.0, 128.0), address(flight.laid, level, -400.0, -300.0)
    before = {path: pinned.ask(path)[1] for path in (here, far)}
    red = Tile(16, 1 << 15, 1 << 15)
    shown = np.full((256, 256, 4), (0, 0, 255, 255), np.uint8)
    flight.put(red, shown)
    assert pinned.ask(here)[1] == before[here]  # nobody has told
    revision = flight.small.write()
    feed.publish(revision, [(0, ancestor(red, at)) for at in range(14, 17)])
    after = picture_of(pinned.ask(here)[1])
    assert (after[..., 2].astype(int) - after[..., 0]).max() > 200
    assert pinned.ask(far)[1] == before[far]
    assert json.loads(pinned.ask(f"{BASE}/tilejson.json")[1])["revision"].startswith(f"{revision}.")


def test_a_map_that_grows_is_shown_where_it_has_grown(pinned: Writer, flight: AnchoredFlight, feed: Feed) -> None:
    level = flight.laid.levels[1]
    path = address(flight.laid, level, 960.0, 0.0)
    assert not picture_of(pinned.ask(path)[1]).any()
    flight.box = (-600.0, -450.0, 1200.0, 450.0)
    flight.small.islands = [flight.entry(0)]
    new = Tile(16, (1 << 15) + 3, 1 << 15)
    flight.put(new, np.full((256, 256, 4), 255, np.uint8))
    flight.put(Tile(16, new.x, new.y - 1), np.full((256, 256, 4), 255, np.uint8))
    feed.publish(flight.small.write(), [(0, new), (0, Tile(16, new.x, new.y - 1))])
    assert picture_of(pinned.ask(path)[1]).any()


def test_pins_that_are_changed_move_the_map_at_once(pinned: Writer, flight: AnchoredFlight) -> None:
    path = address(flight.laid, flight.laid.levels[1])
    before, told = pinned.ask(path)[1], json.loads(pinned.ask(f"{BASE}/tilejson.json")[1])["revision"]
    pinned.send("DELETE", "/pins/4")
    after = json.loads(pinned.ask(f"{BASE}/tilejson.json")[1])["revision"]
    assert int(after.split(".")[1]) == int(told.split(".")[1]) + 1
    assert (
        np.abs(picture_of(pinned.ask(path)[1]).astype(int) - picture_of(before)).mean() < 3
    )  # exact pins say the same
    for pin in (1, 2):
        pinned.send("DELETE", f"/pins/{pin}")
    assert not picture_of(pinned.ask(path)[1]).any()


def test_without_an_anchor_all_is_empty_and_that_is_said(client: Writer, flight: AnchoredFlight) -> None:
    answer, data = client.ask(address(flight.laid, flight.laid.levels[1]))
    assert answer.status == 200
    assert not picture_of(data).any()
    told = json.loads(client.ask(f"{BASE}/tilejson.json")[1])
    assert "bounds" not in told
    assert "Set two pins on the page" in told["description"]


def test_tilejson_tells_where_to_look(pinned: Writer, flight: AnchoredFlight) -> None:
    answer, data = pinned.ask(f"{BASE}/tilejson.json")
    told = json.loads(data)
    assert answer.headers["Content-Type"].startswith("application/json")
    assert (told["tilejson"], told["scheme"]) == ("3.0.0", "xyz")
    assert told["tiles"] == [f"http://{pinned.netloc}{BASE}/{{z}}/{{x}}/{{y}}.png"]
    assert told["bounds"] == pytest.approx(flight.laid.bounds, abs=1e-6)
    assert (told["minzoom"], told["maxzoom"]) == flight.laid.levels
    assert "± 1 m (95 %)" in told["description"]


@pytest.mark.long
def test_islands_are_shown_together_or_alone_and_those_without_an_anchor_are_named(
    pinned: Writer, flight: AnchoredFlight
) -> None:
    flight.small.islands = [flight.entry(0), flight.entry(3, frames=90)]
    flight.draw(3)
    flight.small.write()
    until(lambda: "without an anchor: island 3" in pinned.ask(f"{BASE}/tilejson.json")[1].decode(), "named")
    path = address(flight.laid, flight.laid.levels[1])
    both, alone = pinned.ask(path)[1], pinned.ask(f"{path}?island=0")[1]
    assert both == alone
    assert not picture_of(pinned.ask(f"{path}?island=3")[1]).any()
    assert pinned.status(f"{path}?island=x") == 400


@pytest.mark.long
def test_an_island_that_joins_another_takes_its_anchor_away(pinned: Writer, flight: AnchoredFlight) -> None:
    path = address(flight.laid, flight.laid.levels[1])
    assert picture_of(pinned.ask(path)[1]).any()
    flight.small.islands = [flight.entry(0, merged_into=3), flight.entry(3)]
    flight.small.write()
    until(lambda: not picture_of(pinned.ask(path)[1]).any(), "gone", 15)


@pytest.mark.long
def test_while_the_notes_cannot_be_read_the_map_stays(
    pinned: Writer, flight: AnchoredFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = address(flight.laid, flight.laid.levels[1])
    before = pinned.ask(path)[1]

    async def broken(*_given: object) -> None:
        raise web.HTTPServiceUnavailable

    monkeypatch.setattr(Notes, "run", broken)
    time.sleep(1.1)  # until it is looked at again
    assert pinned.ask(path)[1] == before


def test_another_flight_s_tiles_are_not_these(pinned: Writer, flight: AnchoredFlight) -> None:
    level = flight.laid.levels[1]
    for name in ("small", "small-20260101-000000", FLIGHT.upper()):
        answer, said = pinned.ask(f"/maps/{name}/{level}/0/0.png")
        assert (answer.status, FLIGHT.encode() in said) == (404, True)
    assert pinned.status(f"/maps/{FLIGHT}/27/0/0.png") == 404
    assert pinned.status(f"/maps/{FLIGHT}/3/8/0.png") == 404
    assert pinned.status(f"/maps/{FLIGHT}/3/0/0.exe") == 404
    assert pinned.status(f"/maps/{FLIGHT}/../../etc/0/0.png") == 404


@pytest.mark.long
def test_a_flight_that_has_nothing_yet_answers_empty(pinned: Writer, flight: AnchoredFlight) -> None:
    for text in (b"", b"{", b'{"islands": [{"id": 0}], "revision": 1}', b"[]"):
        (flight.root / "mosaic.json").write_bytes(text)
        time.sleep(1.1)  # until it is looked at again
        assert pinned.status(f"{BASE}/3/0/0.png") == 200
