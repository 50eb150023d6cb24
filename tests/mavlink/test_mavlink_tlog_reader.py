from __future__ import annotations

from pathlib import Path

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.tlog import TIME
from gcs_mosaic.mavlink.tlog_reader import RecordedLink, read_recording
from gcs_mosaic.messages import Notice
from tests.mavlink.mavlink_peer import captured, heartbeat, packet, recorded, trigger

BEGAN = 1.75e9


def read(path: Path, *packets: bytes) -> RecordedLink:
    path.write_bytes(b"".join(packets))
    return read_recording(path, LinkSettings())


def test_time_counts_from_the_first_packet(tmp_path: Path) -> None:
    link = read(tmp_path / "a.tlog", *(recorded(BEGAN + 2 * seq, seq) for seq in range(50)))
    assert [event.received for event in link.events] == pytest.approx([2 * seq for seq in range(50)])
    assert (link.began_utc, link.packets) == (BEGAN, 50)
    assert link.seconds == pytest.approx(98)


@pytest.mark.parametrize("times", [(10, 12, 14), (BEGAN, BEGAN + 3600, BEGAN + 10), (1e12, 1e12 + 1, 1e12 + 2)])
def test_a_clock_that_was_not_set_or_has_leapt_is_not_believed(tmp_path: Path, times: tuple[float, ...]) -> None:
    assert read(tmp_path / "a.tlog", *(recorded(time, 1) for time in times)).began_utc is None


def test_other_aircraft_are_left_out_and_silence_is_said(tmp_path: Path) -> None:
    stranger = TIME.pack(int((BEGAN + 60) * 1e6)) + packet(trigger(7), system=9)
    first = TIME.pack(int(BEGAN * 1e6)) + packet(heartbeat())
    link = read(tmp_path / "a.tlog", first, recorded(BEGAN + 1, 1), stranger)
    assert [event.vehicle for event in link.events] == [1]
    said = [(seconds, item.text) for seconds, item in link.heard if isinstance(item, Notice)]
    assert [text for seconds, text in said if seconds == 60 and "is silent" in text]
    (left_out,) = [text for _, text in said if "system 9 triggers a camera too" in text]
    assert "start with --vehicle 9 to follow it instead" in left_out  # nobody can choose while it is read


def test_of_a_recording_no_ground_station_is_asked_for(tmp_path: Path) -> None:
    beats = [TIME.pack(int((BEGAN + second) * 1e6)) + packet(heartbeat()) for second in range(60)]
    link = read(tmp_path / "a.tlog", *beats)
    assert not [item for _, item in link.heard if isinstance(item, Notice) and "ground station" in item.text]


def test_a_torn_packet_at_the_end_hides_nothing(tmp_path: Path) -> None:
    torn = TIME.pack(int((BEGAN + 1) * 1e6)) + packet(captured(3, file_url=b"x" * 200))[:40]
    link = read(tmp_path / "a.tlog", recorded(BEGAN, 1), torn, recorded(BEGAN + 2, 2))
    assert [event.sequence for event in link.events] == [1, 2]


@pytest.mark.parametrize("content", [b"", b"text\n" * 1000, b"\xfd" * 5000])
def test_what_is_no_recording_is_a_usage_error(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(UsageError, match="holds no MAVLink packet: give a recording"):
        read(tmp_path / "a.tlog", content)
