"""What comes into a watched folder and is not mapped is a condition within ten seconds, with what to do."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gcs_mosaic.app.status.conditions import Conditions, Facts
from gcs_mosaic.messages import CameraCount, LinkReport, SourceReport
from gcs_mosaic.store.records import Accounts
from gcs_mosaic.store.told_documents import EventAccount, FrameAccount

FOLDER = SourceReport(kind="folder", name="DCIM", state="watching")
MAPPED = replace(FOLDER, taken=9)
TRIGGERED = Accounts(events=EventAccount(pending=6))
QUIET = Accounts()
FLOWN = Accounts(events=EventAccount(matched=9), frames=FrameAccount(placed=9))
UNLIKE = (CameraCount("64x48", 9, mapped=True), CameraCount("96x72", 8, mapped=True))
CAMERAS = (CameraCount("_w", 9, mapped=True), CameraCount("_t", 9, mapped=False))


def told(source: SourceReport, accounts: Accounts) -> dict[str, str]:
    """Keys and sentences ten seconds after it became so."""
    link = LinkReport(address="udp:14550", state="heard", last_heard_utc=1000.0)
    facts = Facts(utc=1000.0, started_utc=900.0, links=(link,), source=source, accounts=accounts)
    conditions = Conditions()
    conditions.so_now(facts)
    return {one.key: one.text for one in conditions.so_now(replace(facts, utc=1009.9))}


CASES = {
    "RAW only, triggers": (replace(FOLDER, passed_over=((".arw", 6),)), TRIGGERED, "raw", "RAW and JPEG"),
    "RAW only, no triggers": (replace(FOLDER, passed_over=((".dng", 2),)), QUIET, "raw", "2 ending in .DNG"),
    "RAW from now on": (replace(MAPPED, passed_over=((".nef", 1),)), FLOWN, "raw", "1 ending in .NEF"),
    "HEIC": (replace(FOLDER, passed_over=((".heic", 6),)), TRIGGERED, "raw", "set the camera to JPEG"),
    "videos while triggered": (
        replace(FOLDER, passed_over=((".mp4", 1),)),
        TRIGGERED,
        "only others",
        "1 ending in .MP4",
    ),
    "small copies while triggered": (
        replace(FOLDER, passed_over=(("preview/", 4),)),
        TRIGGERED,
        "only others",
        "watch that folder itself",
    ),
    "old files that came lately": (replace(FOLDER, left=5, left_lately=5), QUIET, "left", "--from start"),
    "old files, triggers, nothing else": (replace(FOLDER, left=5), TRIGGERED, "left", "--from start"),
    "old files, and a clock that is off": (
        replace(MAPPED, left=5, clock_off_s=5 * 3600.0),
        FLOWN,
        "left",
        "dated 5.0 h before they came",
    ),
    "a clock that is off": (replace(MAPPED, clock_off_s=-7200.0), FLOWN, "clock", "2.0 h after they came"),
    "several cameras": (replace(MAPPED, cameras=CAMERAS), FLOWN, "cameras, _w", "--cameras '*_T.*'"),
    "two cameras without a word in common": (
        replace(MAPPED, cameras=UNLIKE),
        FLOWN,
        "cameras, 64x48, 96x72",
        "'64x48'",
    ),
    "of one of several aircraft": (
        replace(FOLDER, vehicle=2, passed_over=((".arw", 6),)),
        TRIGGERED,
        "raw of aircraft 2",
        "come into DCIM",
    ),
}


@pytest.mark.parametrize(("source", "accounts", "key", "text"), CASES.values(), ids=CASES.keys())
def test_it_is_told_with_what_to_do(source: SourceReport, accounts: Accounts, key: str, text: str) -> None:
    found = told(source, accounts)
    assert key in found
    assert text in found[key]


GOOD = {
    "other files beside frames": (replace(MAPPED, passed_over=((".txt", 3), ("@eaDir/", 9))), FLOWN),
    "other files, no triggers": (replace(FOLDER, passed_over=((".mp4", 3),)), QUIET),
    "yesterday's files": (replace(MAPPED, left=200), FLOWN),
    "yesterday's files, nothing flies yet": (replace(FOLDER, left=200), QUIET),
}


@pytest.mark.parametrize(("source", "accounts"), GOOD.values(), ids=GOOD.keys())
def test_what_is_ordinary_is_not_told(source: SourceReport, accounts: Accounts) -> None:
    assert told(source, accounts) == {}


def test_patterns_that_fit_nothing_are_a_warning() -> None:
    cameras = (CameraCount("*_X.*", 0, mapped=True), CameraCount("*", 6, mapped=False))
    assert (
        "only those called *_X.* are mapped (0 so far)"
        in told(replace(FOLDER, cameras=cameras), QUIET)["cameras, *_X.*"]
    )
