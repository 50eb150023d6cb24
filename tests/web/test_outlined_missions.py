"""A mission over an outlined area shows each place of it as often as was asked for; and what cannot be is said in a sentence."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.parse import urlencode
from urllib.request import urlopen

import numpy as np
import pytest

from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from tests.handover.gapped import HEIGHT_M, METRES, canvas, gapped_flight

CORNERS = np.array([[200.0, 100.0], [800.0, 100.0], [800.0, 500.0], [200.0, 500.0]])
SIDE = 300  # units of a frame's shorter side


@pytest.fixture
def url(tmp_path: Path) -> Iterator[str]:
    server = WebServer(gapped_flight(tmp_path / "flight"), HttpAddress("127.0.0.1", 0))
    yield server.start()
    server.stop()


def told(url: str, path: str, **asked: object) -> Any:
    with urlopen(f"{url.rstrip('/')}/api/v1/{path}?{urlencode(asked)}", timeout=60) as answer:
        return json.load(answer)


def refused(url: str, path: str, **asked: object) -> tuple[int, str]:
    with pytest.raises(HTTPError) as caught:
        told(url, path, **asked)
    with caught.value as answer:
        return answer.code, answer.read().decode()


def outlined(corners: np.ndarray) -> str:
    return ";".join(f"{x},{y}" for x, y in corners)


def pictures(plan: dict[str, Any]) -> tuple[np.ndarray, set[float]]:
    """Where they are taken, on the canvas (n, 2), and at what heights."""
    found, heights = list[np.ndarray](), set[float]()
    items = plan["mission"]["items"]
    for first, trigger, last, _ in zip(*(items[k::4] for k in range(4)), strict=True):
        ends = [np.array(canvas(one["params"][5], one["params"][4])) for one in (first, last)]
        heights |= {one["params"][6] for one in (first, last)}
        length, step = float(np.hypot(*(ends[1] - ends[0]))), trigger["params"][0] / METRES
        found += [ends[0] + (ends[1] - ends[0]) * (k * step / length) for k in range(int(length / step) + 1)]
    return np.array(found), heights


@pytest.mark.parametrize(("looks", "at"), [(9, 1.0), (20, 1.0), (6, 0.5)])
def test_each_place_is_seen_as_often_as_was_asked_for(url: str, looks: int, at: float) -> None:
    """By the square that fits into a frame whichever way the camera is turned."""
    plan = told(url, "mission.plan", island=0, looks=looks, at=at, outline=outlined(CORNERS))
    places, heights = pictures(plan)
    assert sorted(heights) == pytest.approx([HEIGHT_M * at], abs=0.1)
    x, y = (one.ravel() for one in np.meshgrid(np.linspace(200, 800, 25), np.linspace(100, 500, 17)))
    half = SIDE * at / 2 + 1  # a pixel for rounding
    seen = (np.abs(x[:, None] - places[:, 0]) <= half) & (np.abs(y[:, None] - places[:, 1]) <= half)
    assert seen.sum(axis=1).min() >= looks
    assert any("frames or more show each place" in text for text in plan["gcs_mosaic"]["advice"])


def test_what_cannot_be_flown_is_said(url: str) -> None:
    asked: dict[str, object] = {"island": 0, "looks": 9, "outline": outlined(CORNERS)}
    flat = outlined(CORNERS * [1, 0])
    assert refused(url, "mission.plan", **asked | {"outline": flat})[0] == 409
    assert "more than 500 lines" in refused(url, "mission.plan", **asked | {"outline": outlined(CORNERS * 100)})[1]
    for wrong in ({"looks": 1}, {"outline": "1,2;3,4"}, {"outline": "a,b;c,d;e,f"}, {"at": 0}, {"at": "nan"}):
        assert refused(url, "mission.plan", **asked | wrong)[0] == 400
    del asked["island"]
    assert "island is to be given" in refused(url, "mission.plan", **asked)[1]


def test_the_calculator_agrees_with_the_mission(url: str) -> None:
    answer = told(url, "islands/0/flying", looks=9)
    plan = told(url, "mission.plan", island=0, looks=9, outline=outlined(CORNERS))
    steps = {item["params"][0] for item in plan["mission"]["items"] if item["command"] == 206} - {0}
    assert sorted(steps) == pytest.approx([answer["step_m"]], abs=0.02)
    assert answer["looks"] == 9
    assert answer["interval_s"] == 1.0
    assert answer["speed_m_s"] == pytest.approx(answer["step_m"])
    nearer = told(url, "islands/0/flying", looks=9, at=0.5)
    assert nearer["step_m"] == pytest.approx(answer["step_m"] / 2, abs=0.01)
    assert refused(url, "islands/7/flying", looks=9)[0] == 409
    assert refused(url, "islands/0/flying", looks=1)[0] == 400
