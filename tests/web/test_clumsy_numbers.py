"""What somebody types where a number is wanted is understood, or refused in a sentence: never taken for another number."""

from __future__ import annotations

import json
from urllib.request import urlopen

import pytest

from tests.web.browser import CHROMIUM, Page
from tests.web.test_people_on_the_page import Person

pytestmark = [pytest.mark.long, pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")]


@pytest.fixture
def someone(page: Page, url: str) -> Person:
    """At a pin's form."""
    person = Person(page, url)
    person.press("open-anchors")
    person.press("anchors-set")
    person.click(300, 300)
    return person


def pins(url: str) -> list[float]:
    with urlopen(f"{url}api/v1/anchors", timeout=20) as answer:
        return [one["sigma_m"] for one in json.loads(answer.read())["pins"]]


@pytest.mark.parametrize(("typed", "metres"), [("10", 10.0), ("7,5", 7.5), ("12 m", 12.0), ("", 3.0)])
def test_how_good_a_pin_is_is_read_as_people_write_it(
    someone: Person, page: Page, url: str, typed: str, metres: float
) -> None:
    someone.type("anchors-form", coordinate="44.5000000, 7.0000000", sigma=typed)
    page.wait_for("document.getElementById('anchors-form').hidden")
    assert pins(url) == [pytest.approx(metres, abs=0.1)], "the coordinate's digits add some millimetres"


@pytest.mark.parametrize("typed", ["ten", "0", "-4", "1 km"])
def test_what_is_no_length_sets_no_pin(someone: Person, url: str, typed: str) -> None:
    """It became 3 m without a word: a pin of which nobody knows how good it is was taken for a good one."""
    someone.type("anchors-form", coordinate="44.5000000, 7.0000000", sigma=typed)
    someone.sees("anchors-said", f"{typed} are no metres: write a number")
    assert pins(url) == []
