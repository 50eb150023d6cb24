"""Who has no mouse, or wears gloves, sets a find and opens originals by keys alone: Enter points at the middle of the map."""

from __future__ import annotations

import pytest

from tests.web.browser import CHROMIUM, Page
from tests.web.test_people_on_the_page import Person

pytestmark = [pytest.mark.long, pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")]

FOCUSED = "document.activeElement.id"
CROSS = "getComputedStyle(document.getElementById('map'), '::before').content"


def test_a_find_is_set_and_originals_are_asked_for_by_keys(page: Page, url: str) -> None:
    someone = Person(page, url)
    page.key("m")
    page.wait_for(f"{FOCUSED} === 'map'")
    assert page.evaluate(CROSS) != "none", "where it points can be seen"
    page.key("Enter")
    page.wait_for("document.activeElement.name === 'label'")
    someone.type("finds-form", label="a tent")
    someone.sees("finds-list", "a tent")
    page.requests.clear()
    page.evaluate("document.getElementById('map').focus()")
    page.key("Enter")
    page.wait_for("!document.getElementById('originals').hidden || !document.getElementById('answer').hidden")
    assert any("/sightings" in asked for asked in page.requests), "it asks which frames saw the place"
    page.key("Escape")


def test_a_button_that_is_pressed_by_keys_gives_them_to_the_map_and_one_that_is_clicked_does_not(
    page: Page, url: str
) -> None:
    someone = Person(page, url)
    someone.press("open-finds")
    page.evaluate("document.getElementById('finds-show').focus()")
    page.key("Shift+Tab")
    assert page.evaluate(FOCUSED) == "finds-mark"
    page.key("Enter")
    page.wait_for(f"{FOCUSED} === 'map'")
    page.key("Escape")
    x, y = page.evaluate("""(({ x, y, width, height }) => [x + width / 2, y + height / 2])(
      document.getElementById('finds-mark').getBoundingClientRect())""")
    someone.click(x, y)
    page.wait_for("!document.getElementById('hint').hidden")
    assert page.evaluate(FOCUSED) == "finds-mark"
    page.key("Escape")
