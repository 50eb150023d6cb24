"""A find is given to somebody else in one tap, in a real browser."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.web.browser import CHROMIUM, Page
from tests.web.served import served
from tests.web.small_flight import SmallFlight

pytestmark = [pytest.mark.long, pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")]

GIVE = "[...document.querySelectorAll('#finds-list button')].find((one) => one.innerText === 'Hand over')"
BOX = "document.querySelector('dialog.handed')"
MARKED = """fetch("/api/v1/finds", { method: "POST", headers: { "Content-Type": "application/json" },
  body: JSON.stringify({ island: 0, x: 30, y: 20, label: "red jacket", kind: "", note: "", who: "Kim", key: "a" }) })
.then((answer) => answer.status)"""


@pytest.fixture
def opened(flight: SmallFlight, page: Page) -> Iterator[Page]:
    """A page on which a find was marked, with the list of finds."""
    with served(flight.root) as url:
        page.resize(400, 800)
        page.open(url)
        assert page.evaluate(MARKED) == 201
        page.evaluate("document.getElementById('phase-report').click()")
        page.wait_for(f"!!{GIVE}")
        yield page
        page.open("about:blank")


def test_without_a_share_sheet_its_text_is_there_to_copy_and_to_scan(opened: Page) -> None:
    opened.evaluate("(navigator.canShare = undefined, true)")
    opened.evaluate(f"{GIVE}.click()")
    opened.wait_for(f"{BOX}?.open && {BOX}.querySelector('.code').naturalWidth > 100")
    told = opened.evaluate(f"{BOX}.querySelector('textarea').value")
    assert "red jacket" in told
    assert "marked by Kim" in told
    right, bottom = opened.evaluate(f"(({{ right, bottom }}) => [right, bottom])({BOX}.getBoundingClientRect())")
    assert right <= 400
    assert bottom <= 800
    opened.key("Escape")
    opened.wait_for(f"!{BOX}")


def test_where_there_is_a_share_sheet_it_opens(opened: Page) -> None:
    opened.evaluate("(navigator.canShare = () => true, true)")
    opened.evaluate("(navigator.share = async (given) => { window.given = given; }, true)")
    opened.evaluate(f"{GIVE}.click()")
    opened.wait_for("!!window.given")
    assert "red jacket" in opened.evaluate("window.given.text")
    assert not opened.evaluate(f"!!{BOX}")


def test_what_the_share_sheet_refuses_is_shown(opened: Page) -> None:
    opened.evaluate("(navigator.canShare = () => true, true)")
    opened.evaluate("(navigator.share = async () => { throw new DOMException('no', 'NotAllowedError'); }, true)")
    opened.evaluate(f"{GIVE}.click()")
    opened.wait_for(f"{BOX}?.open")
