from __future__ import annotations

import sqlite3

import pytest

from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import CoveredRecord, FrameState
from gcs_mosaic.store.told_documents import FrameAccount
from tests.store.ledger_parts import NEARLY_THE_SAME, a_frame


def test_a_covered_frame_keeps_how_it_lies_in_its_keyframe(ledger: Ledger) -> None:
    for name in ("key.jpg", "b\udcff.jpg"):
        ledger.record_frame(a_frame(name))
        ledger.record_size(name, 40, 30)
    assert ledger.newest_on_map() is None
    ledger.settle_frame("key.jpg", FrameState.PLACED)
    assert ledger.newest_on_map() == "key.jpg"
    ledger.settle_frame("b\udcff.jpg", FrameState.COVERED)
    ledger.record_covered("b\udcff.jpg", "key.jpg", NEARLY_THE_SAME)
    assert ledger.covered() == [
        CoveredRecord(name="b\udcff.jpg", by="key.jpg", by_from_frame=NEARLY_THE_SAME, width=40, height=30)
    ]
    assert ledger.newest_on_map() == "b\udcff.jpg"
    assert ledger.accounts().frames == FrameAccount(placed=1, covered=1)
    with pytest.raises(sqlite3.IntegrityError):
        ledger.record_covered("key.jpg", "key.jpg", NEARLY_THE_SAME)
