from __future__ import annotations

import threading
from pathlib import Path

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.address import LinkAddress
from gcs_mosaic.mavlink.link import triggers
from gcs_mosaic.messages import TriggerEvent
from tests.mavlink.mavlink_peer import recorded


def replay(file: Path) -> list[TriggerEvent]:
    heard = triggers(LinkAddress(kind="file", path=file), threading.Event())
    return [item for item in heard if isinstance(item, TriggerEvent)]


def test_a_recording_keeps_its_distances_in_time(tmp_path: Path) -> None:
    (tmp_path / "a.tlog").write_bytes(b"".join(recorded(1.75e9 + 2 * seq, seq) for seq in range(3000)))
    events = replay(tmp_path / "a.tlog")
    assert [event.sequence for event in events] == list(range(3000))
    assert events[-1].received - events[0].received == pytest.approx(2 * 2999)


def test_a_damaged_stretch_costs_only_itself(tmp_path: Path) -> None:
    damage = b"\xfd\xff" + bytes(70_000) + b"\xfe\x01"
    (tmp_path / "a.tlog").write_bytes(recorded(10, 1) + damage + recorded(12, 2) * 30)
    assert [event.sequence for event in replay(tmp_path / "a.tlog")][:2] == [1, 2]


def test_absurd_times_do_not_move_the_clock(tmp_path: Path) -> None:
    (tmp_path / "a.tlog").write_bytes(recorded(10, 1) + recorded(1e12, 2) + recorded(12, 3) + recorded(13, 4))
    moments = [event.received for event in replay(tmp_path / "a.tlog")]
    assert [moment - moments[0] for moment in moments] == pytest.approx([0, 0, 0, 1])


def test_a_recording_that_is_not_there_is_a_usage_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="give a recording"):
        replay(tmp_path / "none.tlog")
