from __future__ import annotations

import errno
import time
from pathlib import Path

import pytest
from pymavlink import mavutil

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.received import Arrival
from gcs_mosaic.mavlink.tlog import read_tlog
from gcs_mosaic.mavlink.tlog_writer import FLUSH_S, Recording
from gcs_mosaic.messages import Notice
from tests.mavlink.mavlink_peer import captured, packet, received, trigger

NOW = time.monotonic()


def arrival(seq: int, seconds: float = 0.0) -> Arrival:
    return Arrival(received(trigger(seq, 5_000_000)), NOW + seconds)


def sequences(path: Path) -> list[int]:
    with path.open("rb") as file:
        return [message.seq for _, message in read_tlog(file)]


def test_every_packet_is_kept_as_it_was_with_the_time_it_came(tmp_path: Path) -> None:
    recording, began = Recording(), time.time() - time.monotonic() + NOW
    recording.open(tmp_path / "a.tlog", ours=False)
    for seq in range(5):
        recording.record(arrival(seq, 2.0 * seq))
    recording.record(Arrival(received(captured(9, file_url=b"IMG_9.JPG"), component=100), NOW + 10))
    recording.close()
    with (tmp_path / "a.tlog").open("rb") as file:
        times, messages = zip(*read_tlog(file), strict=True)
    assert list(times) == pytest.approx([began + 2 * k for k in range(6)], abs=0.01)
    assert [message.get_msgbuf() for message in messages[:5]] == [packet(trigger(k, 5_000_000)) for k in range(5)]
    assert messages[5].file_url == "IMG_9.JPG"


def test_the_usual_reader_of_recordings_reads_it(tmp_path: Path) -> None:
    recording = Recording()
    recording.open(tmp_path / "a.tlog", ours=False)
    for seq in range(300):
        recording.record(arrival(seq, seq))
    recording.close()
    log = mavutil.mavlink_connection(str(tmp_path / "a.tlog"), dialect="ardupilotmega")
    heard = []
    while (message := log.recv_match()) is not None:
        heard.append((message.get_type(), message.seq, message._timestamp))
    log.close()
    assert [(kind, seq) for kind, seq, _ in heard] == [("CAMERA_TRIGGER", seq) for seq in range(300)]
    assert heard[-1][2] - heard[0][2] == pytest.approx(299)


def test_what_is_half_a_second_old_survives_a_kill(tmp_path: Path) -> None:
    recording = Recording()
    recording.open(tmp_path / "a.tlog", ours=False)
    for seq in range(4):
        recording.record(arrival(seq))
        list(recording.flush(NOW + seq * FLUSH_S))
    assert sequences(tmp_path / "a.tlog") == [0, 1, 2, 3]  # nobody has closed it
    recording.close()


def test_links_that_are_out_of_step_write_times_in_order(tmp_path: Path) -> None:
    recording = Recording()
    recording.open(tmp_path / "a.tlog", ours=False)
    for seconds in (1.0, 0.9, 1.1):
        recording.record(arrival(1, seconds))
    recording.close()
    with (tmp_path / "a.tlog").open("rb") as file:
        times = [seconds for seconds, _ in read_tlog(file)]
    assert times == sorted(times)


def test_a_full_disk_is_said_once_and_leaves_no_half_packet(tiny_disk: Path) -> None:
    recording, path = Recording(), tiny_disk / "a.tlog"
    recording.open(path, ours=False)
    recording.record(arrival(0))
    assert list(recording.flush(NOW)) == []
    filler = tiny_disk / "filler"
    with pytest.raises(OSError, match="No space") as full:
        filler.write_bytes(bytes(2_000_000))
    assert full.value.errno == errno.ENOSPC
    said: list[Notice] = []
    now = NOW
    for seq in range(1, 2000):  # more than fits into the rest of the file's last page
        recording.record(arrival(seq))
        now += 1.0
        said += recording.flush(now)
    assert [notice.level for notice in said] == ["error"]
    assert "No space left" in said[0].text
    assert 0 < len(sequences(path)) < 2000
    filler.unlink()
    said = list(recording.flush(now + 10))
    recording.close()
    assert [notice.text for notice in said] == [f"the recording {path} is written again; 0 packets are missing in it"]
    assert sequences(path) == list(range(2000))


def test_a_file_that_is_there_is_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "a.tlog").write_bytes(b"earlier")
    with pytest.raises(UsageError, match="is there already"):
        Recording().open(tmp_path / "a.tlog", ours=False)
    with pytest.raises(UsageError, match="cannot be written"):
        Recording().open(tmp_path / "no" / "a.tlog", ours=False)
    assert (tmp_path / "a.tlog").read_bytes() == b"earlier"


def test_a_recording_of_nothing_leaves_no_file(tmp_path: Path) -> None:
    recording = Recording()
    recording.open(tmp_path / "a.tlog", ours=False)
    recording.close()
    assert not (tmp_path / "a.tlog").exists()
