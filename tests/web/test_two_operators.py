"""Two who work on one find at once, one of them on the page in a real browser: nothing is lost, nothing fails silently."""

from __future__ import annotations

from typing import Any

import pytest

from tests.web.browser import CHROMIUM, Page
from tests.web.test_notes_api import Writer
from tests.web.test_people_on_the_page import Person

pytestmark = [pytest.mark.long, pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")]

# The page asks for the finds, and is not answered: it does not know yet what somebody else has just done.
DEAF = """window.answered = window.fetch; window.fetch = (url, asked) => {
  const isRead = String(url).includes("/api/v1/finds") && (asked?.method ?? "GET") === "GET";
  return isRead ? Promise.reject(new TypeError()) : answered(url, asked);
}; void 0"""


class Operators:
    """Somebody at the page, with the list of finds open, and another one who works by the API."""

    def __init__(self, page: Page, url: str) -> None:
        self.writer = Writer(url)
        self.writer.send("POST", "/finds", {"island": 0, "x": 90, "y": 90, "label": "a tent", "who": "Ann"})
        self.page, self.somebody = page, Person(page, url)
        self.somebody.press("open-finds")
        self.somebody.sees("finds-list", "a tent")

    def press(self, word: str, where: str = "finds-list") -> None:
        self.page.evaluate(
            f"[...document.querySelectorAll('#{where} button')].find((b) => b.textContent === '{word}').click()"
        )

    def find(self) -> dict[str, Any]:
        _, told = self.writer.send("GET", "/finds?deleted=1")
        (found,) = told["finds"]
        return dict(found)

    def send(self, method: str, path: str = "", **texts: str) -> None:
        body = {**texts, "who": "Ann", "revision": self.find()["revision"]}
        self.writer.send(method, f"/finds/1{path}", body)


@pytest.fixture
def two(page: Page, url: str) -> Operators:
    return Operators(page, url)


def test_who_deletes_what_another_has_just_changed_is_told_so(two: Operators) -> None:
    two.page.evaluate(DEAF)
    two.send("PATCH", note="there is somebody in it")
    two.page.evaluate("window.fetch = answered; void 0")
    two.press("Delete")
    two.somebody.sees("finds-said", "Somebody else has changed it meanwhile: look at it, then delete it again.")
    two.somebody.sees("finds-list", "there is somebody in it")
    two.press("Delete")
    two.page.wait_for("!document.getElementById('finds-list').childElementCount")


def test_who_writes_on_a_find_that_another_deletes_is_told_and_has_it_back_by_saving_again(two: Operators) -> None:
    two.press("Edit")
    two.page.evaluate("document.getElementById('finds-form').elements.note.value = 'there is somebody in it'")
    two.send("DELETE")
    two.page.evaluate("document.getElementById('finds-form').requestSubmit()")
    told = "Somebody else has deleted it meanwhile: save again to have it back with these words."
    two.somebody.sees("finds-said", told)
    two.page.evaluate("document.getElementById('finds-form').requestSubmit()")
    two.somebody.sees("finds-list", "there is somebody in it")
    assert not two.find()["deleted"]


def test_a_deletion_can_be_undone_after_another_has_written_on_the_find(two: Operators) -> None:
    two.press("Delete")
    two.page.wait_for("!document.getElementById('finds-undo').hidden")
    two.send("PATCH", note="there is somebody in it")
    two.press("Undo", "finds-undo")
    two.somebody.sees("finds-list", "there is somebody in it")
    assert two.page.evaluate("document.getElementById('finds-undo').hidden")
