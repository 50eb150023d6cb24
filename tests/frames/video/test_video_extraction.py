"""Which pictures of a recorded video become frames, and how they are to be seen."""

from __future__ import annotations

import os
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from gcs_mosaic.frames.video.described import Described
from gcs_mosaic.frames.video.extraction import GoOn
from gcs_mosaic.messages import content_hash
from tests.frames.video.films import (
    HEIGHT,
    RATE,
    SPEED,
    WIDTH,
    X264,
    chosen,
    difference,
    flight,
    interlaced,
    picture_of,
    sound,
    the_end,
    told,
    view,
    write_film,
)

STEP_MS = 1000 * 0.3 * WIDTH / SPEED  # 30 % of the view is new
QUIET = {"x265-params": "log-level=none", "preset": "ultrafast"}


@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("a.MP4", {}),
        ("a.mov", {"codec": "libx265", "options": QUIET, "pix_fmt": "yuv420p10le"}),
        ("a.mkv", {"codec": "mpeg4", "options": {}}),
        ("a.ts", {"codec": "mpeg2video", "options": {"b": "4M"}}),
        ("a.avi", {"codec": "mjpeg", "options": {}, "pix_fmt": "yuvj420p"}),
    ],
)
def test_frames_are_taken_as_the_view_moves(tmp_path: Path, name: str, how: dict[str, object]) -> None:
    count = 74
    pictures = [view(100 + SPEED * k / RATE) for k in range(count)]
    found = chosen(write_film(tmp_path / name, pictures, **how))  # type: ignore[arg-type]
    assert found[0].ms == 0
    assert np.diff([one.ms for one in found]) == pytest.approx(STEP_MS, abs=200)
    assert len(found) == 1 + int(1000 * (count - 1) / RATE / STEP_MS)
    for one in found:
        assert difference(picture_of(one), view(100 + SPEED * one.ms / 1000)) < 25


@pytest.mark.skipif(not hasattr(av.VideoStream, "set_display_rotation"), reason="this PyAV writes no display matrix")
@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_a_picture_is_turned_as_the_recording_says(tmp_path: Path, degrees: int) -> None:
    """A camera mounted on its side, or a telephone: the pixels lie as the sensor has them, and a matrix tells how to turn."""
    path = write_film(tmp_path / "a.mp4", flight(0.4), clockwise_deg=degrees)
    upright = np.rot90(view(100), -degrees // 90)
    assert difference(picture_of(chosen(path)[0]), upright) < 25


def test_a_rotate_tag_turns_where_there_is_no_matrix(tmp_path: Path) -> None:
    path = write_film(tmp_path / "a.mkv", flight(0.4))
    with_tag = tmp_path / "b.mkv"
    with av.open(str(path)) as source, av.open(str(with_tag), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        stream.metadata["rotate"] = "90"
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                target.mux(packet)
    assert picture_of(chosen(with_tag)[0]).shape[:2] == (WIDTH, HEIGHT)


def test_lines_of_two_moments_are_taken_apart(tmp_path: Path) -> None:
    films = [
        write_film(tmp_path / name, interlaced(0.6), options=X264 | more)
        for name, more in (("said.ts", {"x264-params": "tff=1"}), ("not_said.ts", {}))
    ]
    mended, combed = (_comb(picture_of(chosen(film)[0])) for film in films)
    true = _comb(view(100))
    assert combed > 2 * true
    assert mended - true < (combed - true) / 2


def _comb(picture: np.ndarray) -> float:
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(int)
    return float(np.abs(2 * grey[1:-1] - grey[:-2] - grey[2:]).mean())


def test_pixels_that_are_not_square_are_stretched(tmp_path: Path) -> None:
    """HDV and many analogue recorders store 1440 x 1080 or 720 x 576 of a wider picture."""
    path = write_film(tmp_path / "a.mp4", flight(0.4), aspect=Fraction(4, 3))
    assert picture_of(chosen(path)[0]).shape[:2] == (HEIGHT, round(WIDTH * 4 / 3))


def test_a_hover_brings_one_frame(tmp_path: Path) -> None:
    swaying = [view(100 + 3 * np.sin(k / 9), 300 + 2 * np.cos(k / 7)) for k in range(8 * RATE)]
    assert len(chosen(write_film(tmp_path / "a.mp4", swaying))) == 1


def test_a_black_hour_brings_few(tmp_path: Path) -> None:
    """A lens cap, a night, a lost signal: nothing can be followed there."""
    black = [np.zeros((HEIGHT, WIDTH, 3), np.uint8)] * (5 * RATE)
    assert len(chosen(write_film(tmp_path / "a.mp4", black))) <= 5 / 0.5 + 1


@pytest.mark.parametrize("is_over_ground", [True, False])
def test_a_display_burnt_into_the_picture_does_not_hold_the_view(tmp_path: Path, is_over_ground: bool) -> None:
    """Ground stations record their screen with hard text all over it, whose figures and horizon move; the ground moves too."""
    film = [_with_display(view(100 + SPEED * k / RATE if is_over_ground else 100), k) for k in range(3 * RATE)]
    found = chosen(write_film(tmp_path / "a.mp4", film))
    assert len(found) == (1 + int(3000 / STEP_MS) if is_over_ground else 1)


def _with_display(picture: np.ndarray, k: int) -> np.ndarray:
    shown = picture.copy()
    for row in range(6):
        cv2.putText(
            shown, f"ALT {100 + row} SPD {30 + k % 7}", (6, 20 + 38 * row), cv2.FONT_HERSHEY_PLAIN, 1.0, (255,) * 3, 2
        )
    cv2.line(shown, (120, 120 + k % 20), (200, 120 - k % 20), (0, 255, 0), 2)
    return shown


def test_frames_at_an_interval(tmp_path: Path) -> None:
    path = write_film(tmp_path / "a.mp4", flight(4.0))
    assert [one.ms for one in chosen(path, every="1 s")] == [0, 1000, 2000, 3000]


@pytest.mark.parametrize(
    "stamps_ms",
    [
        [40 * k + 15 * (k % 2) for k in range(75)],  # variable frame rate
        [40 * k if k < 40 else 40 * k + 60_000 for k in range(75)],  # a pause of a minute
    ],
)
def test_times_need_not_be_regular(tmp_path: Path, stamps_ms: list[int]) -> None:
    path = write_film(tmp_path / "a.mkv", flight(3.0), stamps_ms=stamps_ms)
    times = [one.ms for one in chosen(path)]
    assert 4 <= len(times) <= 6
    assert times == sorted(set(times))


def test_times_that_jump_back_go_on(tmp_path: Path) -> None:
    """Recorders that split a flight: parts put one after another begin their times anew."""
    parts = [write_film(tmp_path / f"{k}.ts", flight(2.0, 2.0 * k)) for k in range(2)]
    joined = tmp_path / "joined.ts"
    joined.write_bytes(b"".join(part.read_bytes() for part in parts))
    found = chosen(joined)
    assert np.diff([one.ms for one in found]) == pytest.approx(STEP_MS, abs=300)
    assert len(found) == 1 + int(3960 / STEP_MS)


@pytest.mark.long
def test_what_an_earlier_run_took_is_gone_on_with(tmp_path: Path) -> None:
    path = write_film(tmp_path / "a.mp4", flight(4.0))
    whole = chosen(path)
    for at in range(len(whole)):
        rest = chosen(path, GoOn(whole[at].ms, content_hash(whole[at].jpeg)))
        assert rest == whole[at:]


def test_another_recording_is_read_from_its_beginning(tmp_path: Path) -> None:
    path = write_film(tmp_path / "a.mp4", flight(3.0))
    whole = chosen(path)
    assert chosen(path, GoOn(whole[2].ms, "0" * 32)) == whole


def test_damaged_pictures_are_not_taken(tmp_path: Path) -> None:
    """A radio link with gaps, recorded on the ground as it came."""
    path = write_film(tmp_path / "a.ts", flight(4.0), options={"preset": "ultrafast", "g": "25"})
    data = bytearray(path.read_bytes())
    middle = len(data) // 2 // 188 * 188
    data[middle : middle + 40 * 188] = os.urandom(40 * 188)
    path.write_bytes(data)
    for one in chosen(path):
        assert difference(picture_of(one), view(100 + SPEED * one.ms / 1000)) < 30
    assert the_end(path).damaged > 0


def test_what_a_video_tells_of_itself(tmp_path: Path) -> None:
    path = write_film(tmp_path / "a.mp4", flight(1.0), metadata={"creation_time": "2024-05-01T10:00:00Z"})
    described = told(path)[0]
    assert isinstance(described, Described)
    assert (described.codec, described.width, described.height) == ("h264", WIDTH, HEIGHT)
    assert described.utc == 1714557600
    assert described.duration_s == pytest.approx(1.0, abs=0.05)


def test_a_clock_that_was_never_set_is_not_believed(tmp_path: Path) -> None:
    path = write_film(tmp_path / "a.mp4", flight(0.4), metadata={"creation_time": "1970-01-01T00:00:07Z"})
    described = told(path)[0]
    assert isinstance(described, Described)
    assert described.utc is None


KEYS = {"encryption_scheme": "cenc-aes-ctr", "encryption_key": "76a6c65c5ea762046bd749a2e632ccbb"}


def test_what_is_no_video_is_said_in_a_sentence(tmp_path: Path) -> None:
    whole = write_film(tmp_path / "whole.mp4", flight(0.4)).read_bytes()
    files = {
        "cut.mp4": (whole[: len(whole) // 2], "not finished"),
        "empty.mp4": (b"", "empty"),
        "page.mp4": (b"<html>" * 99, "no video that can be read"),
        "list.mp4": (f"#EXTM3U\n#EXTINF:1,\nfile://{tmp_path}/whole.mp4\n#EXT-X-ENDLIST\n".encode(), "no video"),
        "names.mkv": (f"ffconcat version 1.0\nfile {tmp_path}/whole.mp4\n".encode(), "no video"),
        "noise.ts": (np.random.default_rng(0).bytes(188 * 500), "no video"),
    }
    for name, (data, expected) in files.items():
        (tmp_path / name).write_bytes(data)
        (said,) = told(tmp_path / name)
        assert isinstance(said, str), name
        assert expected in said, name
    (said,) = told(sound(tmp_path / "sound.mp4"))
    assert "sound only" in str(said)


def test_an_encrypted_video_is_said_to_be(tmp_path: Path) -> None:
    keys = KEYS | {"encryption_kid": "a7e61c373e219033c21091fa607bf3b8"}
    assert "encrypted" in the_end(write_film(tmp_path / "a.mp4", flight(0.4), container=keys)).stopped
    path = write_film(tmp_path / "a.ts", flight(0.4))
    data = bytearray(path.read_bytes())
    for at in range(0, len(data), 188):
        if int.from_bytes(data[at + 1 : at + 3]) & 0x1FFF == 0x100:  # of the video; tables stay as they are
            data[at + 3] |= 0xC0
            data[at + 4 : at + 188] = os.urandom(184)
    path.write_bytes(data)
    assert "encrypted" in str(told(path)[-1])


def test_a_video_that_was_cut_short_gives_what_it_has(tmp_path: Path) -> None:
    path = write_film(tmp_path / "a.mp4", flight(4.0), container={"movflags": "faststart"})
    whole = chosen(path)
    os.truncate(path, path.stat().st_size // 2)
    some = chosen(path)
    assert 1 <= len(some) < len(whole)
    assert [one.ms for one in some] == [one.ms for one in whole[: len(some)]]


@pytest.mark.parametrize("apart_ms", [600, 1000, 4000])
def test_of_a_video_with_few_pictures_a_second_frames_are_taken_too(tmp_path: Path, apart_ms: int) -> None:
    """A time lapse, a thermal camera's recording, a camera that slows down in poor light."""
    shift = 0.36 * WIDTH
    pictures, stamps = [view(100 + shift * k) for k in range(8)], [apart_ms * k for k in range(8)]
    assert [one.ms for one in chosen(write_film(tmp_path / "a.mp4", pictures, stamps_ms=stamps))] == stamps


def test_of_a_video_that_slows_down_the_slow_part_is_taken_too(tmp_path: Path) -> None:
    stamps = [*range(0, 1000, 40), *range(1000, 12_000, 900)]
    pictures = [view(100 + 16 * k) for k in range(len(stamps))]
    found = [one.ms for one in chosen(write_film(tmp_path / "a.mp4", pictures, stamps_ms=stamps))]
    assert len([ms for ms in found if ms >= 1000]) == 2  # each sixth shows 30 % that is new
