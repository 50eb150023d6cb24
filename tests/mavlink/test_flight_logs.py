"""What is given to replay is told by its content: a telemetry log, an autopilot's own log, or neither."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.tlog import TIME
from gcs_mosaic.mavlink.tlog_reader import RecordedLink, read_recording
from gcs_mosaic.messages import CaptureResult, Notice, Source
from tests.mavlink.autopilot_logs import began_utc, dataflash, ulog
from tests.mavlink.mavlink_peer import captured, heartbeat, packet, recorded, trigger

BEGAN = 1.75e9


def read(path: Path, data: bytes) -> RecordedLink:
    path.write_bytes(data)
    return read_recording(path, LinkSettings())


def said(link: RecordedLink) -> str:
    return "; ".join(one.text for _, one in link.heard if isinstance(one, Notice))


def zipped() -> bytes:
    with zipfile.ZipFile(buffer := io.BytesIO(), "w") as archive:
        archive.writestr("flight.tlog", recorded(BEGAN, 1))
    return buffer.getvalue()


def raw(count: int) -> bytes:
    return b"".join(packet(heartbeat()) + packet(trigger(seq)) for seq in range(count))


def test_raw_mavlink_without_times_is_refused_and_the_log_beside_it_is_named(tmp_path: Path) -> None:
    """MAVProxy keeps mav.tlog.raw beside mav.tlog; half of its packets used to be read as if eight bytes of each were a time."""
    (tmp_path / "mav.tlog").write_bytes(recorded(BEGAN, 1))
    (tmp_path / "another.tlog").write_bytes(recorded(BEGAN, 1))
    with pytest.raises(UsageError, match=r"is raw MAVLink without times.*; the \.tlog beside it: mav\.tlog\.$"):
        read(tmp_path / "mav.tlog.raw", raw(34))


@pytest.mark.parametrize("count", [1, 2, 300])
def test_raw_mavlink_of_any_length_under_any_name_is_refused(tmp_path: Path, count: int) -> None:
    with pytest.raises(UsageError, match="raw MAVLink without times"):
        read(tmp_path / "flight.tlog", raw(count))


OTHERS = {
    "a ZIP archive": zipped(),
    "compressed with gzip": b"\x1f\x8b\x08" + bytes(99),
    "a picture": b"\xff\xd8\xff\xe0" + bytes(99),
    "a video": b"\0\0\0\x20ftypisom" + bytes(99),
    "a text": b"QGC WPL 110\r\n0\t1\t0\t16\r\n" * 9,
    "empty": b"",
}


@pytest.mark.parametrize("what", OTHERS)
def test_what_is_no_recording_is_called_what_it_is(tmp_path: Path, what: str) -> None:
    (tmp_path / "one.tlog").write_bytes(recorded(BEGAN, 1))
    with pytest.raises(UsageError, match=f"holds no MAVLink packet: .*this is {what}.*beside it: one.tlog"):
        read(tmp_path / "flight.bin", OTHERS[what])


def test_a_telemetry_log_that_is_cut_at_either_end_is_replayed_and_said(tmp_path: Path) -> None:
    whole = b"".join(recorded(BEGAN + seq, seq) for seq in range(9))
    link = read(tmp_path / "a.tlog", whole[5:-7])
    assert [event.sequence for event in link.events] == [*range(1, 8)]
    assert "bytes of the recording are no whole packets" in said(link)
    assert "whole packets" not in said(read(tmp_path / "a.tlog", whole))


def test_one_packet_is_a_recording(tmp_path: Path) -> None:
    assert len(read(tmp_path / "a.tlog", recorded(BEGAN, 1)).events) == 1
    cut = TIME.pack(int(BEGAN * 1e6)) + packet(captured(3, file_url=b"a.jpg"))[:20]
    assert len(read(tmp_path / "a.tlog", recorded(BEGAN, 1) + cut).events) == 1


SHOTS = [("TRIG", 5.0, 1), ("CAM", 5.2, 1), ("TRIG", 9.0, 2), ("CAM", 9.2, 2), ("CAM", 14.2, 3)]


def test_the_log_of_an_ardupilot_tells_its_shots_and_when(tmp_path: Path) -> None:
    link = read(tmp_path / "00000042.BIN", dataflash(SHOTS))
    told = [(event.source, event.sequence, event.result) for event in link.events]
    trigger, feedback = Source.CAMERA_TRIGGER, Source.CAMERA_FEEDBACK
    unknown, taken = CaptureResult.UNKNOWN, CaptureResult.TAKEN
    assert told == [
        (trigger, 1, unknown),
        (feedback, 1, taken),
        (trigger, 2, unknown),
        (feedback, 2, taken),
        (feedback, 3, taken),
    ]
    assert [event.received for event in link.events] == pytest.approx([5.0, 5.2, 9.0, 9.2, 14.2], abs=1e-3)
    assert link.began_utc == pytest.approx(began_utc(), abs=1.5)
    assert link.seconds == pytest.approx(14.2, abs=1e-3)
    assert link.events[1].position is not None
    assert link.events[1].position.latitude_deg == pytest.approx(47.0, abs=1e-4)
    assert said(link) == ""


def test_an_ardupilot_log_that_is_cut_is_replayed_as_far_as_it_is_whole(tmp_path: Path) -> None:
    link = read(tmp_path / "cut.BIN", dataflash(SHOTS)[:-9])
    assert [event.sequence for event in link.events] == [1, 1, 2, 2]
    assert "cut.BIN ends within a message" in said(link)


def test_the_log_of_a_px4_tells_its_shots_and_when(tmp_path: Path) -> None:
    shots = [("camera_trigger", 3.0, 7), ("camera_capture", 3.1, 7), ("camera_capture", 6.1, 8)]
    link = read(tmp_path / "log.ulg", ulog(shots))
    told = [(event.source, event.sequence, event.result) for event in link.events]
    trigger, capture = Source.CAMERA_TRIGGER, Source.IMAGE_CAPTURED_BY_AUTOPILOT
    assert told == [
        (trigger, 7, CaptureResult.UNKNOWN),
        (capture, 7, CaptureResult.TAKEN),
        (capture, 8, CaptureResult.TAKEN),
    ]
    assert [event.received for event in link.events] == pytest.approx([3.0, 3.1, 6.1])
    assert link.began_utc == pytest.approx(1.75e9, abs=0.01)
    assert link.seconds == pytest.approx(6.1)


def test_a_px4_log_that_is_cut_is_replayed_as_far_as_it_is_whole(tmp_path: Path) -> None:
    shots = [("camera_capture", 3.0 * k, k) for k in range(9)]
    link = read(tmp_path / "log.ulg", ulog(shots)[:-20])
    assert [event.sequence for event in link.events] == [*range(8)]
    assert "log.ulg is damaged or cut" in said(link)
    assert "cut" not in said(read(tmp_path / "log.ulg", ulog(shots)))


@pytest.mark.parametrize("data", [dataflash([]), ulog([])], ids=["ArduPilot", "PX4"])
def test_an_autopilots_log_without_shots_has_none(tmp_path: Path, data: bytes) -> None:
    assert read(tmp_path / "log", data).events == []


REFUSED = {
    "a format of no length": b"\xa3\x95\x80\x83\x00" + bytes(84) + b"\xa3\x95\x83" * 99,
    "formats that are none": b"\xa3\x95\x80\x83\x59CAM\0zzzz" + bytes(200),
    "nothing but its beginning": b"\xa3\x95",
    "a header of ULog alone": b"ULog\x01\x12\x35",
    "a text of formats": b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nCAM, x, y\n" * 9,
}


@pytest.mark.timeout(20)
@pytest.mark.parametrize("what", REFUSED)
def test_a_damaged_log_is_refused_in_a_sentence(tmp_path: Path, what: str) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        read(tmp_path / "log", REFUSED[what])


def test_noise_behind_the_head_of_a_px4_log_is_said(tmp_path: Path) -> None:
    link = read(tmp_path / "log.ulg", ulog([]) + bytes(range(256)) * 9)
    assert link.events == []
    assert "log.ulg is damaged or cut" in said(link)
