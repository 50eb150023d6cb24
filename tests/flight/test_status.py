from __future__ import annotations

import json

from gcs_mosaic.flight.records import Accounts, EventAccount, NoticeRecord
from gcs_mosaic.flight.status import LastFrame, LinkStatus, Status, WatchStatus, status_document

STATUS = Status(
    flight="today",
    state="flying",
    updated_utc=1714564800.0,
    started_utc=1714564000.0,
    mavlink=(LinkStatus(address="udp:14550", state="heard", last_heard_utc=1714564799.5),),
    watch=WatchStatus(folder="frames", state="watching"),
    last_frame=LastFrame(name="a.jpg", outcome="placed", island=0, utc=1714564799.0, seconds_to_tile=float("nan")),
    accounts=Accounts(events=EventAccount(missing=1)),
    notices=(NoticeRecord(utc=1714564799.0, source="link", level="info", text="heard"),),
)


def test_document_holds_moments_and_no_nan() -> None:
    document = json.loads(json.dumps(status_document(STATUS), allow_nan=False))
    assert (document["format"], document["state"]) == (1, "flying")
    assert document["mavlink"][0]["last_heard"] == "2024-05-01T11:59:59.500Z"
    assert document["last_frame"]["seconds_to_tile"] is None
    assert document["events"]["missing"] == 1
    assert document["notices"][0]["time"] == "2024-05-01T11:59:59.000Z"


def test_daemon_that_has_seen_nothing_has_a_document() -> None:
    document = status_document(Status(flight="f", state="listening", updated_utc=0.0, started_utc=0.0))
    assert document["last_frame"] is None
    assert document["watch"] is None
