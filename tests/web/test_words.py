"""Every word of the page has its German one: in the scripts, in the page itself, and what the server says."""

from __future__ import annotations

import errno
import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from pathlib import Path

import pytest

from gcs_mosaic.app.inputs.pairing_check import shifted_text, shots_later
from gcs_mosaic.app.live.left_behind import (
    LeftBehind,
    left_out_words,
    not_kept_words,
    unpainted_words,
    unstitched_words,
)
from gcs_mosaic.app.status.conditions import Conditions
from gcs_mosaic.detection.detection_map import SOME_GREY
from gcs_mosaic.detection.measured_frames import PALETTE, TOO_SMALL
from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo.coordinates import read_coordinate
from gcs_mosaic.geo.pins import Pin, Refused, anchored_by_pins
from gcs_mosaic.handover.mission import NO_ANCHOR, TOO_LARGE, MissionWish, nothing_to_fly
from gcs_mosaic.handover.patches import NO_GROUND
from gcs_mosaic.integral.ground_tiles import FAILED, FROM_AFAR
from gcs_mosaic.integral.why_not import apart, beyond, nobody_sees, too_few
from gcs_mosaic.mavlink.monitor import _left_out_text
from gcs_mosaic.messages import Refusals
from gcs_mosaic.notes.storage.checked import Unfit, number_of, text_of
from gcs_mosaic.store.disk import CannotWrite, DiskFull, telling_disk_full
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.guard import PUT_BACK
from gcs_mosaic.store.records import FrameState, NoticeRecord
from gcs_mosaic.store.retry import ADVICE, UntilWritable
from gcs_mosaic.store.status import frames_words
from gcs_mosaic.triggers.doubts import Doubts
from gcs_mosaic.views.absent import NO_PICTURE, NOTHING_YET
from gcs_mosaic.views.layers import area_words, legends
from gcs_mosaic.web.api.detection import GREY, NO_SCALE
from gcs_mosaic.web.app import VIEWER
from tests.app.status.test_conditions import ENDED, FLYING, NEWS
from tests.web.browser import CHROMIUM, Page
from tests.web.served import served
from tests.web.small_flight import SmallFlight

STRING = r'"((?:[^"\\]|\\.)*)"'
SCRIPTS = sorted(path for path in VIEWER.glob("*.js") if path.stem not in ("words.de", "sw"))
# Tables of words that are said by `t(TABLE[key])`.
TABLES = {"hints.js": ("REASONS", "STATES"), "keys.js": ("KEYS",)}
# The same everywhere, and what the scripts fill in.
AS_THEY_ARE = {"", "✕", "▲", "N", "◀", "▶", "?", "gcs-mosaic", "44.51234, 7.12345", "CSV", "KML", "GeoJSON"}


# Pairs in doubt: by how many shots, how many, and whether only a part was looked at.
DOUBTS: list[tuple[tuple[int, ...], int, bool]] = [
    ((-2, 1), 12, False),
    ((1,), 1, False),
    ((-2, -1, 1, 2), 3, False),
    ((), 3, False),
    ((), 3, True),
]


def german() -> dict[str, str]:
    lines = re.findall(rf"^  {STRING}: {STRING},$", (VIEWER / "words.de.js").read_text("utf-8"), re.MULTILINE)
    return {json.loads(f'"{english}"'): json.loads(f'"{own}"') for english, own in lines}


def said_by(script: Path) -> Iterator[str]:
    text = script.read_text("utf-8")
    yield from (json.loads(f'"{found}"') for found in re.findall(rf"\bt\({STRING}", text))
    yield from (json.loads(f'"{found}"') for found in re.findall(rf"\bsaid: {STRING}", text))
    for table in TABLES.get(script.name, ()):
        (body,) = re.findall(rf"const {table} = (?:\{{|\[)(.*?)(?:\}}|\]);", text, re.DOTALL)
        shape = rf"\[{STRING}, {STRING}" if table == "KEYS" else rf"(\S+): {STRING}"
        yield from (json.loads(f'"{found[1]}"') for found in re.findall(shape, body))


class Words(HTMLParser):
    """Texts, titles, labels and placeholders of the page itself."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value for name, value in attrs if value and name in ("aria-label", "title", "placeholder")]

    def handle_data(self, data: str) -> None:
        self.found.append(data.strip())


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_what_scripts_say_has_a_german_word(script: Path) -> None:
    assert {word for word in said_by(script) if word not in german()} == set()


def test_what_stands_in_the_page_has_a_german_word() -> None:
    words = Words()
    words.feed((VIEWER / "index.html").read_text("utf-8"))
    assert set(words.found) - german().keys() - AS_THEY_ARE == set()


def test_why_nothing_is_stated_of_a_person_has_german_words() -> None:
    assert {NO_SCALE, GREY, SOME_GREY, PALETTE, TOO_SMALL} <= german().keys()


def test_layers_have_german_words() -> None:
    assert {
        word for one in legends(merged=True) for word in (one.title, one.worst, one.best)
    } - german().keys() == set()


def test_no_german_word_is_left_over_or_lacks_what_is_filled_in() -> None:
    words = Words()
    words.feed((VIEWER / "index.html").read_text("utf-8"))
    scripts = "".join(path.read_text("utf-8") for path in SCRIPTS)
    served = [
        *sentences_of_the_server(),
        *notices_of_the_server(),
        *(NO_SCALE, GREY, SOME_GREY, PALETTE, TOO_SMALL, FAILED, FROM_AFAR, NO_GROUND, TOO_LARGE),
        *(word for one in legends(merged=True) for word in (one.title, one.worst, one.best)),
    ]
    used = {*words.found, *served, *(word for script in SCRIPTS for word in said_by(script))}
    unused = {
        english
        for english in german()
        if english not in used and json.dumps(english, ensure_ascii=False) not in scripts
    }
    left = {one for one in unused if not any(_fills(one, sentence) for sentence in served)}
    program = _program()
    assert {one for one in left if not all(piece in program for piece in _pieces(one))} == set()
    slots = {english: (set(_slots(english)), set(_slots(own))) for english, own in german().items()}
    assert {english for english, (one, other) in slots.items() if one != other} == set()


def sentences_of_the_server() -> list[str]:
    """What lasts and is told as a condition, the areas of gaps, why shots are not on the map, and why there is no integral."""
    told = [area_words(9.0, 3.0), area_words(0.1, 3.0), NO_PICTURE, NOTHING_YET]
    told += [nobody_sees(0, 1.5, 2.0), too_few(1, ()), too_few(5, ["a.jpg"]), beyond(0.9, -0.4, 0.5), apart(0.4, 1, 7)]
    told += sentences_about_anchors() + sentences_about_forms()
    told += [NO_ANCHOR.format(what="The map")]
    told += [nothing_to_fly(wish) for wish in (MissionWish(), MissionWish(looks=3), MissionWish(below=0.5))]
    for _, facts in NEWS.values():
        conditions = Conditions()
        conditions.so_now(facts)
        told += [one.text for one in conditions.so_now(replace(facts, utc=facts.utc + 11))]
    told += [one.text for _, facts in ENDED.values() for one in Conditions().at_the_end(facts)]
    told += sentences_of_the_disk() + sentences_of_an_end()
    told += [Doubts(shifts, pairs, 14, is_part).text() for shifts, pairs, is_part in DOUBTS]
    lost = Conditions()
    for vehicle in (None, None, None, 2, 2, 2):
        lost.frame(FrameState.WAITING, vehicle)
    return told + [one.text for one in lost.so_now(FLYING)]


def sentences_about_anchors() -> list[str]:
    """Why pins lay nothing, and why a text is no coordinate."""
    here, there, far = (0.0, 0.0, 7.0, 44.5), (400.0, 0.0, 7.003, 44.5), (0.0, 300.0, 44.5, 7.0)
    near, same, huge = (400.0, 0.0, 7.00001, 44.5), (0.1, 0.0, 7.003, 44.5), (1.1, 0.0, 7.1, 44.5)
    laid = [
        anchored_by_pins([Pin(str(at), *place, sigma_m=3.0) for at, place in enumerate(pins)])
        for pins in ([here], [here, here], [here, far], [here, near, there[:2] + near[2:]], [here, same], [here, huge])
    ]
    told = [one.reason for one in laid if isinstance(one, Refused)]
    for text in (
        *("", "somewhere", "44.5N 7.1N", "91, 7", "44, 181", "0, 0", "61T 500000 4649776", "32I 500000 4649776"),
        *("32T 50000 4649776", "32C 500000 4649776", "32TNM 000 49776", "32CNM 00000 49776"),
    ):
        with pytest.raises(UsageError) as refused:
            read_coordinate(text)
        told.append(str(refused.value))
    return told


def sentences_about_forms() -> list[str]:
    """Why what somebody has typed into a form is not taken."""
    told = []
    for check in (
        partial(number_of, 0.0, "sigma_m", 0.01, 1000.0),
        partial(number_of, 0.0, "metres", 0.01, 100_000.0),
        partial(text_of, " ", "label", 120, needed=True),
    ):
        with pytest.raises(Unfit) as refused:
            check()
        told.append(str(refused.value))
    return told


def notices_of_the_server() -> list[str]:
    """Some of what is told as it happens: those that are put together out of the most pieces."""
    found_again = Conditions()
    for state in (FrameState.WAITING, FrameState.WAITING, FrameState.PLACED):
        found_again.frame(state)
        found_again.so_now(FLYING)
    told = [one.text for one in found_again.fresh()]
    told += [_left_out_text(7, 1, "the first to trigger a camera", (), recorded=recorded) for recorded in (False, True)]
    told += [
        f"ending: working off {frames_words(count)}, then painting the final map, at most 60 s (again Ctrl-C: at once)"
        for count in (1, 3)
    ]
    told += [f"the map is {frames_words(count)}, 40 s behind: the newest are stitched first" for count in (1, 7)]
    return told + [shots_later(shift) for shift in (-2, -1, 1, 2)]


def sentences_of_the_disk() -> list[str]:
    """What is told while nothing can be written, the worst that can be: full, gone, somebody else's."""

    def wait(trouble: CannotWrite) -> None:
        raise trouble

    def failing(number: int) -> None:
        with telling_disk_full(Path("/m/flight.sqlite")):
            raise OSError(number, os.strerror(number), "/m/flight.sqlite")

    told = []
    for number in (errno.ENOSPC, errno.ENOENT, *ADVICE):
        with pytest.raises(CannotWrite) as trouble:
            UntilWritable(Path("/m"), lambda _: None, wait)(partial(failing, number))
        told.append(str(trouble.value))
    gone = [f"{what} is gone; {PUT_BACK}" for what in ("the folder", "its mount")]
    left = "left as it is: move it away, then it goes on"
    strange = [
        f"the {LEDGER_NAME} there is not this flight's, and {left}",
        f"it has a tiles of its own, which is {left}",
    ]
    told += [f"/m cannot be written: {obstacle}" for obstacle in (*gone, *strange)]
    told.append("/m is being written by another gcs-mosaic: end that one, then it goes on")
    return [*told, "/m/flight.sqlite is locked by another program: close it there, then it goes on"]


def _program() -> str:
    """The words of the program: its source, strings that go over several lines in one piece."""
    source = "".join(path.read_text("utf-8") for path in VIEWER.parents[1].rglob("*.py"))
    return re.sub(r'"\s*f?"', "", source)


def _pieces(text: str) -> list[str]:
    """What stands between what is filled in, of at least two letters: notices are put together out of such pieces."""
    pieces = re.split(r"\{\w+\}|[(),:;]", text)
    return [piece.strip() for piece in pieces if len(piece.strip()) > 1]


def sentences_of_an_end() -> list[str]:
    """What is left of a flight: old ranges, what there was no time for, what could not be written, pairs in doubt."""
    refitted, out = Conditions(), Path("/m")
    refitted.old_range = True
    refused = Conditions()
    links = [replace(FLYING.links[0], refused=Refusals(unsigned=k)) for k in range(1, 20)]
    beside = [refused.so_now(replace(FLYING, utc=FLYING.utc + k, links=(link,))) for k, link in enumerate(links)][-1]
    left = LeftBehind(frames=3, pictures_lost=0, triggers_lost=1)
    doubts = [Doubts(pairs=n, of=9, shifts=shifts) for n in (1, 3) for shifts in ((), (1, -2))]
    return [
        *(one.text for one in (*refitted.at_the_end(FLYING), *beside)),
        *(left_out_words(1), unstitched_words(1, out)),
        *(left_out_words(3), unstitched_words(3, out), unpainted_words(out), not_kept_words(["a", "b", "c", "d"], out)),
        left.last_words(
            DiskFull("the disk is full: free some space, then it goes on (/m/flight.sqlite could not be written)"), out
        ),
        *(one.text("/m") for one in (*doubts, Doubts(pairs=1, is_part=True), Doubts(pairs=3, is_part=True))),
        shifted_text(out, 1, 1),
    ]


def _slots(text: str) -> list[str]:
    return re.findall(r"\{(\w+)\}", text)


def _fills(template: str, sentence: str) -> bool:
    return re.fullmatch(re.sub(r"\\\{\w+\\\}", ".+", re.escape(template)), sentence) is not None


@contextmanager
def in_german(page: Page, flight: SmallFlight) -> Iterator[None]:
    """The page of a flight, as long as a block lasts."""
    with served(flight.root) as url:
        page.open(url)
        page.evaluate("localStorage.setItem('gcs-mosaic language', 'de')")
        page.open(url)
        page.wait_for("document.getElementById('open-finds')?.innerText === 'Funde'")
        try:
            yield
        finally:
            page.evaluate("localStorage.removeItem('gcs-mosaic language')")
            page.open("about:blank")


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_sentences_of_the_server_are_told_in_german(page: Page, flight: SmallFlight) -> None:
    with in_german(page, flight):
        page.evaluate("import('/viewer/page.js').then(({ modules }) => { window.said = modules.words.said; })")
        page.wait_for("!!window.said")
        sentence = "The last 3 frames match nothing on the map: fly back over ground that is on it"
        assert page.evaluate(f"said({json.dumps(sentence)})").startswith("Die letzten 3 Bilder")
        sentences = [*sentences_of_the_server(), *notices_of_the_server()]
        left = [one for one in sentences if page.evaluate(f"said({json.dumps(one)})") == one]
    assert left == []


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_what_happened_is_told_in_german_and_no_sentence_is_taken_for_another(page: Page, flight: SmallFlight) -> None:
    """A sentence of few words of its own, as "{n} of {all}", would take any notice with such a word in it."""
    lasting = "The last 3 frames match nothing on the map: fly back over ground that is on it"
    doubts = Doubts(shifts=(-2, 1), pairs=12, of=14).text("/flights/2 or 3")
    heard = "udp:1 is heard again after 15 s"
    unknown = ["a lens of glass is said to be 5 s ago", "for reasons of its own", "5 of 6"]
    texts = [*unknown, heard, doubts, lasting]
    flight.status(notices=tuple(NoticeRecord(utc=1.7e9, source="", level="info", text=text) for text in texts))
    with in_german(page, flight):
        page.wait_for(f"document.querySelectorAll('#notices li').length === {len(texts)}")
        told = page.evaluate("[...document.querySelectorAll('#notices li span')].map((one) => one.textContent)")
    assert told[0].startswith("Die letzten 3 Bilder")
    assert "(12 Bilder von 14): jedes könnte ebenso gut 2 Aufnahmen früher oder 1 Aufnahme später gehören" in told[1]
    assert "gcs-mosaic pair /flights/2 or 3 --shift -2 oder --shift 1 wählt das" in told[1]
    assert told[2] == "udp:1 ist nach 15 s wieder zu hören"
    assert told[3:] == unknown[::-1]
