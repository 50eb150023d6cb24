"""Pictures are decoded in processes of their own: what is wrong with one costs that one, and is said."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from multiprocessing.connection import Connection
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.frames.decode import Unreadable, decode_image
from gcs_mosaic.frames.decoding import decoders as door
from gcs_mosaic.frames.decoding import process as processes
from gcs_mosaic.frames.decoding.decoders import ENDING, Decoders
from gcs_mosaic.frames.decoding.limits import Allowance, DecodeSettings, refusal
from gcs_mosaic.frames.decoding.process import DecoderProcess, Job, ProcessEnded
from gcs_mosaic.frames.structure import Whole
from gcs_mosaic.messages import content_hash
from gcs_mosaic.processes import pipe as pipes
from gcs_mosaic.stitch.arrays import Bands
from tests.frames.image_files import counts, cut, encoded, many_bands, many_scans, picture, textured

PROGRESSIVE = encoded(".jpg", textured(), cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
ENDLESS = many_scans(PROGRESSIVE, 6000)  # some seconds
SLOW = many_scans(encoded(".jpg", textured(), cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_QUALITY, 90), 1000)
IN_TIME_S = 30.0


@pytest.fixture(scope="module")
def shared() -> Iterator[Decoders]:
    with closing(Decoders(DecodeSettings(cpu_s=0.3), processes=1)) as decoders:
        yield decoders


@pytest.fixture
def alone() -> Iterator[Decoders]:
    """One process, which a test may end."""
    with closing(Decoders(DecodeSettings(cpu_s=20.0, wall_s=IN_TIME_S), processes=1)) as decoders:
        yield decoders


def decoded(decoders: Decoders, data: bytes, reduction: int = 1) -> Bands | Unreadable:
    return decoders.decode(data, content_hash(data), reduction)


def refused(decoders: Decoders, data: bytes) -> str:
    found = decoded(decoders, data)
    assert isinstance(found, Unreadable)
    return found.reason


def parrot(pipe: Connection, file: int) -> None:
    """In the place of a worker."""
    pipes.send(pipe, pipes.receive(pipe)[0])


def pid_of(decoders: Decoders) -> int:
    process = decoders._desks[0]._process
    assert process is not None
    return process.pid


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


def at_work(decoders: Decoders, besides: int = 0) -> int:
    """Wait until another process than this one is decoding; its number."""
    until = time.monotonic() + IN_TIME_S
    while time.monotonic() < until:
        process = decoders._desks[0]._process
        if process is not None and process._is_ready and process.pid not in (besides, None):
            return pid_of(decoders)
        time.sleep(0.01)
    raise AssertionError("no process began")


@pytest.mark.parametrize("reduction", [1, 4])
@pytest.mark.parametrize(
    "data",
    [PROGRESSIVE, encoded(".png", picture(kind=np.uint16)), many_bands(5), encoded(".jpg", picture()[..., 0])],
    ids=["jpeg", "png of 16 bits", "five bands", "grey"],
)
def test_pixels_are_those_that_would_be_decoded_here(shared: Decoders, data: bytes, reduction: int) -> None:
    found = decoded(shared, data, reduction)
    expected = decode_image(data, reduction=reduction)
    assert isinstance(found, np.ndarray)
    assert found.dtype == expected.dtype  # type: ignore[union-attr]
    np.testing.assert_array_equal(found, expected)


@pytest.mark.long
def test_without_a_file_in_memory_pixels_come_through_the_pipe(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "nameless_file", lambda: None)
    with closing(Decoders(processes=1)) as decoders:
        for data in (encoded(".png", textured()), many_bands(5)):
            np.testing.assert_array_equal(decoded(decoders, data), decode_image(data))


@pytest.mark.long
def test_a_picture_that_takes_too_long_costs_itself_alone(shared: Decoders) -> None:
    start = time.monotonic()
    assert refused(shared, ENDLESS) == "needs more than 0.3 s of computing time: damaged, or made to harm"
    assert time.monotonic() - start < IN_TIME_S
    assert shared.take_trouble() is None  # the frame's reason says it
    assert isinstance(decoded(shared, encoded(".png", picture(seed=3))), np.ndarray)


@pytest.mark.parametrize("of", ["the pixels", "the machine"])
def test_a_picture_too_large_is_refused_by_its_header(of: str) -> None:
    settings = DecodeSettings()
    small, large = Whole(4000, 3000), Whole(19_900, 19_900)
    assert refusal(small, 0, 10**9, settings) is None
    if of == "the pixels":
        reason = refusal(large, 12_000_000, 64 * 10**9, settings)
        assert reason == "19900 x 19900 pixels, more than 4 times the largest frame so far"
    else:
        reason = refusal(large, 0, 4 * 10**9, settings)
        assert reason == "19900 x 19900 pixels need 4.8 GB of memory, this machine has 4.0 GB"


@pytest.mark.parametrize(
    ("size", "largest", "memory_gb"),
    [
        ((11_648, 8736), 0, 4),  # the first frame of a camera of 100 megapixels, on a small machine
        ((8000, 6000), 160 * 120, 4),  # after thumbnails
        ((10_000, 10_000), 160 * 120, 4),
        ((20_000, 14_000), 0, 8),  # the largest cameras there are
        ((20_000, 14_000), 150_000_000, 8),
        ((4000, 3000), 12_000_000, 1),
        ((4000, 3000), 0, None),  # it does not say
    ],
)
def test_no_size_of_a_true_frame_is_refused(size: tuple[int, int], largest: int, memory_gb: int | None) -> None:
    memory = None if memory_gb is None else memory_gb * 10**9
    assert refusal(Whole(*size), largest, memory, DecodeSettings()) is None


@pytest.mark.long
def test_the_largest_frame_so_far_is_what_was_said_to_be_a_true_one() -> None:
    data = encoded(".png", picture(200, 100))
    with closing(Decoders(DecodeSettings(any_pixels=100, most_growth=2), processes=1)) as decoders:
        assert isinstance(decoded(decoders, data), np.ndarray)
        decoders.note_true_frame(9_999)
        assert refused(decoders, encoded(".png", picture(200, 101))).startswith("200 x 101 pixels, more than 2 times")
        decoders.note_true_frame(10_100)
        assert isinstance(decoded(decoders, encoded(".png", picture(200, 101))), np.ndarray)


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not tell how much a process has")
def test_a_picture_gets_no_more_memory_than_is_meant_for_it() -> None:
    data, whole = encoded(".png", picture(4000, 3000)), Whole(4000, 3000)
    with closing(DecoderProcess()) as process:
        found = process.decode(Job(data, whole, 1, Allowance(20.0, 10**6), IN_TIME_S))
        assert isinstance(found, Unreadable)
        assert "allocate" in found.reason or "emory" in found.reason
        assert isinstance(process.decode(Job(data, whole, 1, Allowance(20.0, 10**9), IN_TIME_S)), np.ndarray)


@pytest.mark.parametrize("kind", [["uint8"], None, "object"], ids=str)
@pytest.mark.skipif(not Path("/proc").exists(), reason="processes are looked up in /proc")
def test_an_answer_that_is_no_picture_ends_the_decoder_alone(kind: object, monkeypatch: pytest.MonkeyPatch) -> None:
    """A picture that has taken the process over can make it say anything."""
    monkeypatch.setattr(processes, "work", parrot)
    monkeypatch.setattr(processes, "request_of", lambda *_: {"shape": [8, 8, 3]} | ({"kind": kind} if kind else {}))
    process = DecoderProcess()
    found = process.decode(Job(b"", Whole(8, 8), 1, Allowance(20.0, 10**6), IN_TIME_S))
    assert isinstance(found, ProcessEnded)
    assert not Path(f"/proc/{process.pid}").exists()


def test_a_decoder_that_crashes_costs_its_frame_and_is_said(alone: Decoders) -> None:
    with ThreadPoolExecutor(1) as pool:
        under_way = pool.submit(refused, alone, ENDLESS)
        os.kill(at_work(alone), signal.SIGSEGV)
        assert under_way.result(IN_TIME_S) == "cannot be decoded: the decoder crashed (SIGSEGV)"
    assert alone.take_trouble() == "a process that decodes frames has ended (SIGSEGV); it is started again"
    assert alone.take_trouble() is None
    assert isinstance(decoded(alone, encoded(".png", picture(seed=4))), np.ndarray)


@pytest.mark.long
def test_a_frame_whose_process_was_killed_from_outside_is_tried_once_more(alone: Decoders) -> None:
    with ThreadPoolExecutor(1) as pool:
        under_way = pool.submit(decoded, alone, SLOW)
        first = at_work(alone)
        os.kill(first, signal.SIGKILL)
        assert isinstance(under_way.result(IN_TIME_S), np.ndarray)
    assert pid_of(alone) != first
    assert alone.take_trouble() == "a process that decodes frames has ended (SIGKILL); it is started again"


@pytest.mark.long
def test_a_frame_whose_process_is_killed_again_is_refused(alone: Decoders) -> None:
    with ThreadPoolExecutor(1) as pool:
        under_way = pool.submit(refused, alone, ENDLESS)
        first = at_work(alone)
        os.kill(first, signal.SIGKILL)
        os.kill(at_work(alone, besides=first), signal.SIGKILL)
        reason = under_way.result(IN_TIME_S)
    assert reason == "could not be decoded: the process for it was ended twice (SIGKILL)"


@pytest.mark.long
def test_an_idle_process_that_is_killed_costs_nothing(alone: Decoders) -> None:
    decoded(alone, encoded(".png"))
    os.kill(pid_of(alone), signal.SIGKILL)
    assert isinstance(decoded(alone, encoded(".png", picture(seed=5))), np.ndarray)
    assert "SIGKILL" in (alone.take_trouble() or "")


@pytest.mark.long
def test_a_machine_that_sleeps_refuses_no_frame() -> None:
    """Wall time passes, computing time does not."""
    with closing(Decoders(DecodeSettings(cpu_s=2.0), processes=1)) as decoders, ThreadPoolExecutor(1) as pool:
        under_way = pool.submit(decoded, decoders, SLOW)
        pid = at_work(decoders)
        os.kill(pid, signal.SIGSTOP)
        time.sleep(0.3)  # a signal is obeyed, and the clock's last tick written, a little later
        used = cpu_s(pid)
        time.sleep(2.5)
        assert cpu_s(pid) == used
        assert not under_way.done()
        os.kill(pid, signal.SIGCONT)
        assert isinstance(under_way.result(IN_TIME_S), np.ndarray)


@pytest.mark.long
def test_a_process_that_stands_still_is_replaced() -> None:
    with closing(Decoders(DecodeSettings(wall_s=2.0), processes=1)) as decoders:
        decoded(decoders, encoded(".png"))
        os.kill(pid_of(decoders), signal.SIGSTOP)
        assert isinstance(decoded(decoders, encoded(".png", picture(seed=6))), np.ndarray)
        assert decoders.take_trouble() == "a process that decodes frames has ended (no answer); it is started again"


@pytest.mark.long
def test_signals_for_the_program_do_not_end_it(alone: Decoders) -> None:
    decoded(alone, encoded(".png"))
    before = pid_of(alone)
    for sign in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(before, sign)
    assert isinstance(decoded(alone, encoded(".png", picture(seed=7))), np.ndarray)
    assert pid_of(alone) == before


@pytest.mark.long
def test_a_process_that_cannot_be_started_is_tried_until_it_can(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*given: object, **named: object) -> None:
        raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr(door, "STARTING_S", 0.5)
    monkeypatch.setattr(door, "LONGEST_PAUSE_S", 0.2)
    with monkeypatch.context() as patched:
        patched.setattr(subprocess, "Popen", full)
        decoders = Decoders(processes=1)
        with closing(decoders):
            start = time.monotonic()
            assert "could not be started" in refused(decoders, PROGRESSIVE)
            assert time.monotonic() - start > 0.4
            patched.undo()
            assert isinstance(decoded(decoders, PROGRESSIVE), np.ndarray)


def test_what_was_decoded_in_a_process_is_decoded_here_again_and_nothing_else() -> None:
    decoders, known, new = Decoders(processes=1), encoded(".png"), encoded(".png", picture(seed=8))
    decoded(decoders, known)
    decoders.close()
    np.testing.assert_array_equal(decoded(decoders, known), decode_image(known))
    assert decoded(decoders, new) == ENDING
    assert decoded(decoders, known, reduction=2) == ENDING


@pytest.mark.long
def test_closing_ends_a_decode_that_is_under_way() -> None:
    decoders = Decoders(DecodeSettings(cpu_s=60.0), processes=1)
    with ThreadPoolExecutor(1) as pool:
        under_way = pool.submit(decoded, decoders, ENDLESS)
        at_work(decoders)
        start = time.monotonic()
        decoders.close()
        assert under_way.result(IN_TIME_S) == ENDING
        assert time.monotonic() - start < 5


@pytest.mark.long
def test_nothing_grows_and_nothing_is_left() -> None:
    threads = threading.active_count()
    with closing(Decoders(processes=1)) as decoders:
        for number in range(60):
            assert isinstance(decoded(decoders, encoded(".png", picture(seed=number))), np.ndarray)
            if number == 10:
                before, child = handles(os.getpid()), handles(pid_of(decoders))
        assert (handles(os.getpid()), handles(pid_of(decoders))) == (before, child)
        last = pid_of(decoders)
    assert not Path(f"/proc/{last}").exists()
    assert threading.active_count() == threads


def handles(pid: int) -> int:
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


PROGRAM = """
import os, sys
from gcs_mosaic.frames.decoding.decoders import Decoders
if __name__ == "__main__":
    decoders = Decoders(processes=1)
    decoders.decode(sys.stdin.buffer.read(), "a")
    print(decoders._desks[0]._process.pid, flush=True)
    {then}
"""


@pytest.mark.long
@pytest.mark.parametrize("then", ["os.kill(os.getpid(), 9)", "sys.exit(3)", "raise KeyboardInterrupt"])
def test_processes_end_with_the_program_however_it_ends(tmp_path: Path, then: str) -> None:
    file = tmp_path / "program.py"
    file.write_text(PROGRAM.format(then=then))
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(
        [sys.executable, file], input=encoded(".png"), env=environment, capture_output=True, timeout=60, check=False
    )
    assert done.returncode != 0
    pids = [int(pid) for pid in done.stdout.split()]
    assert len(pids) == 1
    until = time.monotonic() + IN_TIME_S
    while any(is_alive(pid) for pid in pids) and time.monotonic() < until:
        time.sleep(0.05)
    assert not any(is_alive(pid) for pid in pids)


def is_alive(pid: int) -> bool:
    try:
        return ") Z " not in Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False


# A JPEG that was cut and has an end marker


KINDS = {
    "baseline": (),
    "progressive": (cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "restart markers": (cv2.IMWRITE_JPEG_RST_INTERVAL, 5),
}


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("kind", KINDS)
def test_a_jpeg_that_was_cut_and_closed_is_refused(
    shared: Decoders, kind: str, share: float, capfd: pytest.CaptureFixture[str]
) -> None:
    data = cut(encoded(".jpg", textured(), *KINDS[kind]), share)
    reason = refused(shared, data)
    assert reason.startswith("damaged: the JPEG's data end before the picture does")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("reduction", [2, 4])
def test_it_is_refused_at_any_size(shared: Decoders, reduction: int) -> None:
    assert isinstance(decoded(shared, cut(encoded(".jpg", textured()), 0.5), reduction), Unreadable)


def harmless() -> dict[str, bytes]:
    """What cameras are known to do."""
    whole = encoded(".jpg", textured())
    scan = whole.rindex(b"\xff\xda")
    lower_half_grey = textured()
    lower_half_grey[150:] = 128
    grey = encoded(".jpg", lower_half_grey)
    return {
        "a second picture behind it": whole + encoded(".jpg", textured(80, 60)),
        "zeros behind it": whole + bytes(5000),
        "bytes before the end marker": whole[:-2] + b"ab" + whole[-2:],
        "the last bits left out": whole[:-3] + whole[-2:],
        "the last bits of a progressive one left out": PROGRESSIVE[:-3] + PROGRESSIVE[-2:],
        "no end marker": whole[:-2],
        "no end marker of a progressive one": PROGRESSIVE[:-2],
        "fill bytes": whole[:scan] + b"\xff" * 50 + whole[scan:],
        "half of it truly grey": grey,
        "truly grey with bytes too many": grey[:-2] + bytes(8) + grey[-2:],
        "one colour": encoded(".jpg", np.full((300, 400, 3), 128, np.uint8)),
        "overexposed": encoded(".jpg", np.full((300, 400, 3), 255, np.uint8)),
        "grey values": encoded(".jpg", textured()[..., 0]),
    }


@pytest.mark.parametrize("habit", harmless())
@pytest.mark.parametrize("reduction", [1, 4])
def test_habits_of_cameras_are_no_damage(shared: Decoders, habit: str, reduction: int) -> None:
    assert isinstance(decoded(shared, harmless()[habit], reduction), np.ndarray)


def test_what_was_decoded_whole_once_is_not_looked_at_for_missing_rows_again(
    shared: Decoders, capfd: pytest.CaptureFixture[str]
) -> None:
    """Decoders talk on the operator's terminal while that is done."""
    data = encoded(".jpg", textured(220), cv2.IMWRITE_JPEG_PROGRESSIVE, 1)[:-2]
    np.testing.assert_array_equal(decoded(shared, data), decoded(shared, data))
    assert capfd.readouterr().err == ""


def test_bands_beyond_three_come_whole(shared: Decoders) -> None:
    np.testing.assert_array_equal(decoded(shared, many_bands(6)), counts(6))


def test_tags_that_libraries_do_not_know_are_nothing_to_tell_the_operator(
    shared: Decoders, capfd: pytest.CaptureFixture[str]
) -> None:
    """A line for each frame, each time it is painted."""
    data = many_bands(1, np.uint8, extratags=[(65000, 2, 5, "made", True)])
    for _ in range(2):
        assert isinstance(decoded(shared, data), np.ndarray)
    assert capfd.readouterr() == ("", "")
