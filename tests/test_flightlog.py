"""What is caught during a flight is in flight.log; the operator reads one sentence."""

import gc
import logging
import re
import sys
import threading
import warnings
from contextlib import suppress
from dataclasses import replace

import pytest
from rich.console import Console
from running import run, six_pictures

from gcs_mosaic import cli
from gcs_mosaic.batch import stitch
from gcs_mosaic.config import Config
from gcs_mosaic.errors import FlightFailed, UsageError
from gcs_mosaic.events import LinkReport
from gcs_mosaic.flight.folder import LEDGER_NAME, open_flight_folder
from gcs_mosaic.flight.log import LogSettings
from gcs_mosaic.flightlog import flight_log
from gcs_mosaic.listening import Source
from gcs_mosaic.painter import Painter
from gcs_mosaic.sources import Inbox
from gcs_mosaic.stitch.mosaic import Mosaic

QUIET = Console(quiet=True)


@pytest.fixture(scope="module")
def frames(tmp_path_factory, world_cache):
    folder = tmp_path_factory.mktemp("frames")
    for number, data in enumerate(six_pictures(world_cache)):
        (folder / f"{number}.jpg").write_bytes(data)
    return folder


@pytest.fixture
def folder(tmp_path):
    folder = open_flight_folder(tmp_path / "out")
    yield folder
    folder.close()


def log_of(out):
    return (out / "flight.log").read_text(encoding="utf-8")


def surprise(*arguments):
    raise RuntimeError("surprise")


# A whole flight


def test_a_frame_that_breaks_the_program_is_a_sentence_on_the_terminal_and_a_traceback_in_the_log(
    frames, tmp_path, monkeypatch, capfd
):
    place = Mosaic.place
    monkeypatch.setattr(Mosaic, "place", lambda self, f, name: surprise() if name == "3.jpg" else place(self, f, name))
    assert cli.main(["stitch", str(frames), "--out", str(tmp_path / "out"), "--scale", "0.5"]) == 0
    said, log = capfd.readouterr(), log_of(tmp_path / "out")
    assert "error: 3.jpg: it could not be worked off (RuntimeError('surprise'))" in said.out.replace("\n", " ")
    assert "Traceback" not in said.out + said.err
    assert "ERROR MainThread gcs_mosaic.pipeline: 3.jpg could not be worked off\n  | Traceback (most recent" in log
    assert re.search(r"  \|   File \".*test_flightlog\.py\", line \d+, in surprise\n", log)
    assert "  | RuntimeError: surprise\n" in log


def test_every_refusal_is_in_the_log_with_its_numbers(frames, tmp_path):
    registration = Config().stitch.registration
    strict = replace(Config().stitch, registration=replace(registration, least_evidence=1e6))
    out = stitch([frames], tmp_path / "out", replace(Config(), stitch=strict), QUIET)
    log = log_of(out)
    assert re.search(r"1\.jpg and 0\.jpg are not connected: evidence \d+\.\d, 1000000\.0 needed; \d+ inliers\n", log)
    assert "gcs_mosaic.pipeline: 5.jpg: rejected, matches no other frame" in log
    assert "settings that are not the defaults: stitch.registration.least_evidence=1000000.0" in log
    assert log.count("\n") == log.count("Z INFO MainThread gcs_mosaic.")
    assert log.endswith("the flight has ended\n")


def test_believed_pairs_are_in_the_log_of_those_who_ask_for_them(frames, tmp_path):
    out = stitch([frames], tmp_path / "out", replace(Config(), log=LogSettings(level="debug")), QUIET)
    assert re.search(
        r"DEBUG \S+ gcs_mosaic\.stitch\.journal: 1\.jpg and 0\.jpg agree: \d+ independent inliers", log_of(out)
    )


def test_verbose_tells_the_terminal_and_never_a_traceback(frames, tmp_path):
    quiet = run("stitch", frames, "--out", "a", "--scale", "0.25", cwd=tmp_path)
    loud = run("stitch", frames, "--out", "b", "--scale", "0.25", "--verbose", cwd=tmp_path)
    assert quiet.stderr == ""
    assert "gcs_mosaic.pipeline: 5.jpg: placed\n" in loud.stderr
    assert "b was created" not in loud.stderr  # it stands in the ordinary output
    assert "b was created" in log_of(tmp_path / "b")


def test_a_fault_outside_of_any_frame_ends_the_flight_with_one_sentence(frames, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(Painter, "final_steps", surprise)
    assert cli.main(["stitch", str(frames), "--out", str(tmp_path / "out"), "--scale", "0.25"]) == 1
    (said,) = capfd.readouterr().err.splitlines()
    assert said.startswith("gcs-mosaic: a fault of the program has ended the flight (RuntimeError('surprise'))")
    assert str(tmp_path / "out" / "flight.log") in said
    assert "CRITICAL" not in log_of(tmp_path / "out")
    assert "gcs_mosaic.flightlog: the flight has failed\n  | Traceback" in log_of(tmp_path / "out")


def test_a_full_disk_under_the_log_does_not_end_the_flight(frames, tmp_path, tiny_disk, capfd):
    """The log is the only thing on a disk that is full."""
    out = tmp_path / "out"
    out.mkdir()
    with (tiny_disk / "filler").open("wb", buffering=0) as file, suppress(OSError):
        while True:
            file.write(bytes(4096))
    folder = open_flight_folder(out)
    (out / "flight.log").symlink_to(tiny_disk / "flight.log")
    with flight_log(folder, Config()):
        for number in range(10):
            logging.getLogger("gcs_mosaic.test").error("%d %s", number, "x" * 500)
    folder.close()
    (said,) = capfd.readouterr().err.splitlines()
    assert "flight.log cannot be written (No space left on device)" in said


# What Python would print on the terminal


def test_a_thread_that_dies_is_one_sentence_and_a_traceback(folder, capfd):
    hooks = threading.excepthook, sys.unraisablehook
    with flight_log(folder, Config()):
        thread = threading.Thread(target=surprise, name="web")
        thread.start()
        thread.join()
    (said,) = capfd.readouterr().err.splitlines()
    assert "web: RuntimeError('surprise')" in said
    assert "CRITICAL web gcs_mosaic.flightlog: the thread web has died\n  | Traceback" in log_of(folder.path)
    assert hooks == (threading.excepthook, sys.unraisablehook)


def test_what_is_thrown_away_is_logged(folder, capfd):
    class Fragile:
        __del__ = surprise

    with flight_log(folder, Config()):
        Fragile()
        gc.collect()
    assert capfd.readouterr().err == ""
    assert "  | RuntimeError: surprise\n" in log_of(folder.path)


def test_warnings_and_other_libraries_are_logged(folder, capfd):
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        with flight_log(folder, Config()):
            warnings.warn("a mean of nothing", stacklevel=1)
            logging.getLogger("aiohttp.server").error("a request has failed")
            logging.getLogger("asyncio").info("small talk")
    assert capfd.readouterr().err == ""
    log = log_of(folder.path)
    assert "WARNING MainThread py.warnings: " in log
    assert "UserWarning: a mean of nothing" in log
    assert "ERROR MainThread aiohttp.server: a request has failed" in log
    assert "small talk" not in log


def test_a_source_that_fails_leaves_its_traceback(folder):
    def items():
        yield from ()
        surprise()

    inbox = Inbox(threading.Event())
    with flight_log(folder, Config()):
        inbox.fill([Source(items(), LinkReport(address="udp:14550", state="failed"))])
        inbox.join()
    assert "ERROR udp:14550 gcs_mosaic.sources: a source has failed\n  | Traceback" in log_of(folder.path)


# Beginning and end


def test_of_a_flight_that_never_began_no_log_stays_behind(tmp_path):
    folder = open_flight_folder(tmp_path / "out")
    with pytest.raises(UsageError), flight_log(folder, Config()):
        raise UsageError("the port is taken")
    folder.close()
    assert list(tmp_path.iterdir()) == []


def test_a_fault_before_the_flight_began_is_kept(tmp_path):
    folder = open_flight_folder(tmp_path / "out")
    with pytest.raises(FlightFailed), flight_log(folder, Config()):
        surprise()
    folder.close()
    assert "RuntimeError: surprise" in log_of(tmp_path / "out")
    assert not (tmp_path / "out" / LEDGER_NAME).exists()


def test_an_interruption_goes_on_and_is_written_down(folder):
    with pytest.raises(KeyboardInterrupt), flight_log(folder, Config()):
        raise KeyboardInterrupt
    assert "the flight is interrupted (KeyboardInterrupt())" in log_of(folder.path)


def test_afterwards_everything_is_as_it_was(folder):
    root, ours = logging.getLogger(), logging.getLogger("gcs_mosaic")
    before = list(root.handlers), ours.level, logging.raiseExceptions
    with flight_log(folder, replace(Config(), log=LogSettings(level="debug", verbose=True))):
        assert len(root.handlers) == len(before[0]) + 2
    assert (root.handlers, ours.level, logging.raiseExceptions) == before


def test_the_password_in_the_settings_is_not_written(folder):
    with flight_log(folder, replace(Config(), rtsp="rtsp://user:secret@camera/main")):
        logging.getLogger("gcs_mosaic.x").error("rtsp://user:secret@camera/main is gone")
    assert "secret" not in log_of(folder.path)
    assert "rtsp='…'" in log_of(folder.path)


def test_the_log_of_another_flight_is_left_alone(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "flight.log").write_text("mine")
    folder = open_flight_folder(tmp_path / "out")
    assert folder.path == tmp_path / "out-2"
    folder.close()
