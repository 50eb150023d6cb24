"""All looks at a place side by side, and who moves, in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.stitch.camera.geometry import Pose
from tests.sure import sure
from tests.views.drawn_flight import Drawn, drawn_flight, laid_at
from tests.web.browser import CHROMIUM, Page
from tests.web.served import served
from tests.web.test_app import Client

LOOKS = 6
WAY = [(220.0 + 24 * n, 240.0) for n in range(LOOKS)]


@pytest.fixture
def url(tmp_path: Path) -> Iterator[str]:
    frames = [
        Drawn(f"{n}.png", Pose(200.0 + 40 * n, 250.0, yaw=0.4 * n), things=laid_at(*WAY[n], 5)) for n in range(LOOKS)
    ]
    with served(drawn_flight(tmp_path / "flight", frames)) as address:
        yield address


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("looks/1.jpg?x=250&y=250&side=80&cells=64", 200),
        ("looks/9.jpg?x=250&y=250&side=80", 404),
        ("looks/1.jpg?x=9000&y=250&side=80", 404),
        ("looks/1.jpg?x=250&y=250", 400),
        ("looks/1.jpg?x=250&y=250&side=0", 400),
        ("looks/1.jpg?x=nan&y=250&side=80", 400),
        ("looks/1.jpg?x=250&y=250&side=80&cells=100000", 400),
        ("looks/999999999.jpg?x=250&y=250&side=1e6", 404),
    ],
)
def test_a_look_is_a_picture_or_a_sentence(url: str, path: str, status: int) -> None:
    answer, body = Client(url).ask(f"/api/v1/islands/0/{path}")
    assert answer.status == status
    if status == 200:
        assert sure(cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR)).shape == (64, 64, 3)
    else:
        assert body.endswith(b"\n")


in_a_browser = [pytest.mark.long, pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")]


class TestLooksInABrowser:
    pytestmark = in_a_browser

    def test_a_click_opens_all_looks_and_keys_go_through_them(self, page: Page, url: str) -> None:
        page.open(url)
        page.wait_for("document.querySelectorAll('.leaflet-tile-loaded').length > 0", 20)
        at = page.evaluate("""(() => {
          const { left, top, width, height } = document.getElementById("map").getBoundingClientRect();
          return [left + width / 2, top + height / 2];
        })()""")
        press(page, at)
        page.wait_for("!document.getElementById('originals').hidden", 20)
        page.key("s")
        crops = "[...document.querySelectorAll('#originals-looks img')]"
        page.wait_for(f"{crops}.length > 3 && {crops}.every((one) => one.complete && one.naturalWidth === 320)", 30)
        times = page.evaluate("[...document.querySelectorAll('#originals-looks small')].map((one) => one.textContent)")
        assert [text.split(".")[0] for text in times] == [str(n + 1) for n in range(len(times))]
        assert all("came 2001-09-09" in text for text in times)
        assert sum("the best look" in text for text in times) == 1
        sides = f"new URL({crops}[0].src).searchParams.get('side')"
        side = float(page.evaluate(sides))
        page.key("+")
        assert float(page.evaluate(sides)) == pytest.approx(side / 2)
        focused = "[...document.querySelectorAll('#originals-looks button')].indexOf(document.activeElement)"
        before = page.evaluate(focused)
        page.key("ArrowRight")
        assert page.evaluate(focused) == before + 1 > 0
        name = page.evaluate("document.activeElement.title")
        page.key("Enter")
        page.wait_for("!document.getElementById('original').hidden", 20)
        assert name in page.evaluate("document.getElementById('originals-title').textContent")
        page.key("Escape")
        page.wait_for("document.getElementById('originals').hidden")
        assert page.complaints == []

    def test_who_moves_is_listed_with_times_and_drawn(self, page: Page, url: str) -> None:
        page.open(url)
        page.wait_for("document.querySelectorAll('.leaflet-tile-loaded').length > 0", 20)
        page.evaluate("document.getElementById('phase-look').click()")
        page.evaluate("document.getElementById('open-hints').click()")
        assert not [one for one in page.requests if "/movers" in one]  # nothing is sought unasked
        page.evaluate("document.getElementById('movers-on').click()")
        page.wait_for(f"document.getElementById('movers-told').textContent.includes('{LOOKS} of {LOOKS} frames')", 60)
        rows: list[str] = page.evaluate("[...document.querySelectorAll('#movers-list li')].map((one) => one.innerText)")
        (row,) = rows
        assert row.startswith("1. ")
        assert "2001-09-09" in row
        assert page.evaluate("document.querySelectorAll('.mover-mark').length") == 1
        page.evaluate("document.getElementById('side-close').click()")
        assert page.evaluate("document.querySelectorAll('.mover-mark').length") == 0


def press(page: Page, at: list[float]) -> None:
    for kind in ("mousePressed", "mouseReleased"):
        page.command("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], button="left", clickCount=1)
