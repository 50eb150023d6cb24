"""What is caught during a flight is in flight.log; the operator reads one sentence."""

import gc
import io
import json
import logging
import os
import re
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import pytest
from rich.console import Console

from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.app.inputs.inbox import Inbox
from gcs_mosaic.app.inputs.links import ItemSource
from gcs_mosaic.app.status.flight_log import flight_log
from gcs_mosaic.app.status.reporter import Reporter
from gcs_mosaic.app.status.run_progress import RunProgress
from gcs_mosaic.cli import main as cli
from gcs_mosaic.errors import FlightFailed, UsageError
from gcs_mosaic.messages import LinkReport, Notice
from gcs_mosaic.render.repaint_queue import RepaintQueue
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.placement import Outcome
from gcs_mosaic.stitch.graph.tearing import HeldOut
from gcs_mosaic.stitch.mosaic import Mosaic
from gcs_mosaic.store.folder import LEDGER_NAME, FlightFolder, open_flight_folder
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.log import LogSettings, log_notice
from gcs_mosaic.store.records import FlightRecord
from tests.running import six_pictures
from tests.settings import FEW_FEATURES

QUIET = Console(quiet=True)


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    folder = tmp_path_factory.mktemp("frames")
    for number, data in enumerate(six_pictures(world_cache)):
        (folder / f"{number}.jpg").write_bytes(data)
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[FlightFolder]:
    folder = open_flight_folder(tmp_path / "out")
    yield folder
    folder.close()


def log_of(out: Path) -> str:
    return (out / "flight.log").read_text(encoding="utf-8")


def surprise(*_: object) -> NoReturn:
    raise RuntimeError("surprise")


def break_at(monkeypatch: pytest.MonkeyPatch, frame: str, error: Exception) -> None:
    """Raise it where this frame is placed."""
    place = Mosaic.place

    def placing(self: Mosaic, features: Features, name: str, *more: Any) -> Outcome:
        if name == frame:
            raise error
        return place(self, features, name, *more)

    monkeypatch.setattr(Mosaic, "place", placing)


# A whole flight


@pytest.mark.long
def test_a_frame_that_breaks_the_program_is_a_sentence_on_the_terminal_and_a_traceback_in_the_log(
    frames: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    break_at(monkeypatch, "3.jpg", RuntimeError("surprise"))
    assert cli.main(["stitch", str(frames), "--out", str(tmp_path / "out"), "--scale", "0.5"]) == 0
    said, log = capfd.readouterr(), log_of(tmp_path / "out")
    assert "error: 3.jpg: it could not be processed (RuntimeError('surprise'))" in said.out.replace("\n", " ")
    assert "Traceback" not in said.out + said.err
    assert (
        "ERROR MainThread gcs_mosaic.app.pipeline.pipeline: 3.jpg could not be processed\n  | Traceback (most recent"
        in log
    )
    assert re.search(r"  \|   File \".*test_flight_log\.py\", line \d+, in placing\n", log)
    assert "  | RuntimeError: surprise\n" in log


@pytest.mark.long
def test_every_refusal_is_in_the_log_with_its_numbers(frames: Path, tmp_path: Path) -> None:
    registration = FEW_FEATURES.stitch.registration
    strict = replace(FEW_FEATURES.stitch, registration=replace(registration, least_evidence=1e6))
    out = stitch([frames], tmp_path / "out", replace(FEW_FEATURES, stitch=strict), QUIET)
    log = log_of(out)
    assert re.search(r"1\.jpg and 0\.jpg are not connected: evidence \d+\.\d, 1000000\.0 needed; \d+ inliers\n", log)
    assert "gcs_mosaic.store.flight_store: 5.jpg: rejected, matches no other frame" in log
    assert (
        "settings that are not the defaults: stitch.features.count=500, stitch.registration.least_evidence=1000000.0"
        in log
    )
    records = re.findall(r"^\d{4}-\d\d-\d\dT\S+Z INFO MainThread gcs_mosaic\.", log, flags=re.MULTILINE)
    assert len(records) == len(log.splitlines())
    assert len(records) >= 30  # of six frames: each pair that was refused, what became of each, the summary
    assert log.endswith("the flight has ended\n")


@pytest.mark.long
def test_believed_pairs_are_in_the_log_of_those_who_ask_for_them(frames: Path, tmp_path: Path) -> None:
    out = stitch([frames], tmp_path / "out", replace(FEW_FEATURES, log=LogSettings(level="debug")), QUIET)
    assert re.search(
        r"DEBUG \S+ gcs_mosaic\.stitch\.mapping\.journal: 1\.jpg and 0\.jpg agree: \d+ independent inliers", log_of(out)
    )


@pytest.mark.long
def test_verbose_tells_the_terminal_and_never_a_traceback(
    frames: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    break_at(monkeypatch, "3.jpg", RuntimeError("surprise"))
    said = {}
    for out, more in (("a", []), ("b", ["--verbose"])):
        assert cli.main(["stitch", str(frames), "--out", str(tmp_path / out), "--scale", "0.25", *more]) == 0
        said[out] = capfd.readouterr()
    assert said["a"].err == ""
    assert "gcs_mosaic.store.flight_store: 5.jpg: placed\n" in said["b"].err
    assert "gcs_mosaic.app.pipeline.pipeline: 3.jpg could not be processed\n" in said["b"].err
    assert "Traceback" not in said["b"].out + said["b"].err
    assert "Traceback" in log_of(tmp_path / "b")
    assert f"{tmp_path / 'b'} was created" in log_of(tmp_path / "b")
    for twice in ("was created", "frames placed in", "one island, ", "decode: median"):  # in the ordinary output
        assert twice not in said["b"].err


@pytest.mark.long
def test_all_that_is_said_at_the_end_is_in_the_log(
    frames: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["stitch", str(frames), "--out", str(tmp_path / "out"), "--scale", "0.25"]) == 0
    log = log_of(tmp_path / "out")
    assert re.search(r"gcs_mosaic\.app\.commands\.batch: 6 of 6 frames placed in \d+\.\d s, ", log)
    assert "gcs_mosaic.app.commands.batch: one island, 6 frames\n" in log
    assert re.search(
        r"gcs_mosaic\.app\.commands\.batch: paint: median \d\.\d{3} s, longest \d\.\d{3} s, total \d\.\d s\n", log
    )


def test_how_good_the_map_of_a_live_flight_is_is_in_the_log(
    folder: FlightFolder, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    said = io.StringIO()
    with (
        Ledger(tmp_path / LEDGER_NAME) as ledger,
        flight_log(folder, replace(FEW_FEATURES, log=LogSettings(verbose=True))),
    ):
        reporter = Reporter(
            tmp_path, FlightRecord(name="flight", started_utc=0.0), ledger, Console(file=said, width=200)
        )
        reporter.judge({0: HeldOut(matches=50, median_px=1.25, p95_px=6.5)})
    (line,) = (line for line in said.getvalue().splitlines() if "6.5 px" in line)
    assert line.partition(" ")[2] in log_of(folder.path)
    assert "6.5 px" not in capfd.readouterr().err


@pytest.mark.long
def test_brackets_in_names_and_errors_are_no_markup(
    frames: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    odd = tmp_path / "frames"
    (odd / "[").mkdir(parents=True)  # so that frames are called [/b]0.jpg
    for number in range(3):
        (odd / "[" / f"b]{number}.jpg").write_bytes((frames / f"{number}.jpg").read_bytes())
    break_at(monkeypatch, "[/b]2.jpg", RuntimeError("[/bold] is no tag"))
    words = ["stitch", str(odd), "--out", str(tmp_path / "[/o]"), "--scale", "0.25", "--debug", str(tmp_path / "[/d]")]
    assert cli.main(words) == 0
    said = capfd.readouterr().out.replace("\n", "")
    assert "1 x it could not be processed (RuntimeError('[/bold] is no tag'))" in said
    assert "[/o]" in said
    assert "[/d]" in said
    with RunProgress(Console(file=io.StringIO(), force_terminal=True)) as progress:
        progress.add_task("stitching [/b]2.jpg", total=1)
        column = progress.columns[0]
        assert callable(column)
        assert "stitching [/b]2.jpg" in str(column(progress.tasks[0]))


def test_what_goes_wrong_before_the_flight_begins_is_said_and_written_down(
    frames: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, said = tmp_path / "frames", io.StringIO()
    (folder / "closed").mkdir(parents=True)
    data = (frames / "0.jpg").read_bytes()
    (folder / "a.jpg").write_bytes(data[:2] + b"\xff\xe1\x00\x10Exif\0\0MM\0*\0\0\0\x60" + data[2:])
    listing = os.scandir

    def refusing(path: Path) -> Any:
        if str(path).endswith("closed"):
            raise PermissionError(13, "Permission denied")
        return listing(path)

    monkeypatch.setattr(os, "scandir", refusing)
    log = log_of(stitch([folder], tmp_path / "out", replace(FEW_FEATURES, scale=0.25), Console(file=said, width=300)))
    assert "closed cannot be looked at (Permission denied): it is passed over" in said.getvalue()
    assert "WARNING MainThread gcs_mosaic.app.commands.batch: frames: " in log
    assert (
        "gcs_mosaic.app.commands.batch: a.jpg: when it was taken cannot be read: damaged: EXIF points beyond its end\n"
        in log
    )


@pytest.mark.long
def test_a_fault_outside_of_any_frame_ends_the_flight_with_one_sentence(
    frames: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(RepaintQueue, "final_steps", surprise)
    assert cli.main(["stitch", str(frames), "--out", str(tmp_path / "out"), "--scale", "0.25"]) == 1
    (said,) = capfd.readouterr().err.splitlines()
    assert said.startswith("gcs-mosaic: a fault of the program has ended the flight (RuntimeError('surprise'))")
    assert str(tmp_path / "out" / "flight.log") in said
    assert "CRITICAL" not in log_of(tmp_path / "out")
    assert "gcs_mosaic.app.status.flight_log: the flight has failed\n  | Traceback" in log_of(tmp_path / "out")


def test_a_full_disk_under_the_log_does_not_end_the_flight(tiny_disk: Path, capfd: pytest.CaptureFixture[str]) -> None:
    folder = open_flight_folder(tiny_disk / "out")
    with (tiny_disk / "filler").open("wb", buffering=0) as file, suppress(OSError):
        while True:
            file.write(bytes(4096))
    with flight_log(folder, FEW_FEATURES):
        for number in range(10):
            logging.getLogger("gcs_mosaic.test").error("%d %s", number, "x" * 500)
    folder.close()
    (said,) = capfd.readouterr().err.splitlines()
    assert "flight.log cannot be written (No space left on device)" in said


# What Python would print on the terminal


def test_a_thread_that_dies_is_one_sentence_and_a_traceback(
    folder: FlightFolder, capfd: pytest.CaptureFixture[str]
) -> None:
    hooks = threading.excepthook, sys.unraisablehook
    with flight_log(folder, FEW_FEATURES):
        thread = threading.Thread(target=surprise, name="web")
        thread.start()
        thread.join()
    (said,) = capfd.readouterr().err.splitlines()
    assert "web: RuntimeError('surprise')" in said
    assert "CRITICAL web gcs_mosaic.app.status.flight_log: the thread web has died\n  | Traceback" in log_of(
        folder.path
    )
    assert hooks == (threading.excepthook, sys.unraisablehook)


def test_what_is_thrown_away_is_logged(folder: FlightFolder, capfd: pytest.CaptureFixture[str]) -> None:
    class Fragile:
        __del__ = surprise

    with flight_log(folder, FEW_FEATURES):
        Fragile()
        gc.collect()
    assert capfd.readouterr().err == ""
    assert "  | RuntimeError: surprise\n" in log_of(folder.path)


def test_warnings_and_other_libraries_are_logged(folder: FlightFolder, capfd: pytest.CaptureFixture[str]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        with flight_log(folder, FEW_FEATURES):
            warnings.warn("a mean of nothing", stacklevel=1)
            logging.getLogger("aiohttp.server").error("a request has failed")
            logging.getLogger("asyncio").info("small talk")
    assert capfd.readouterr().err == ""
    log = log_of(folder.path)
    assert "WARNING MainThread py.warnings: " in log
    assert "UserWarning: a mean of nothing" in log
    assert "ERROR MainThread aiohttp.server: a request has failed" in log
    assert "small talk" not in log


def test_a_source_that_fails_leaves_its_traceback(folder: FlightFolder) -> None:
    def items() -> Iterator[NoReturn]:
        yield from ()
        surprise()

    inbox = Inbox(threading.Event())
    with flight_log(folder, FEW_FEATURES):
        inbox.fill([ItemSource(items(), LinkReport(address="udp:14550", state="failed"))])
        inbox.join()
    assert "ERROR udp:14550 gcs_mosaic.app.inputs.inbox: a source has failed\n  | Traceback" in log_of(folder.path)


# Beginning and end


def test_of_a_flight_that_never_began_no_log_stays_behind(tmp_path: Path) -> None:
    folder = open_flight_folder(tmp_path / "out")
    with pytest.raises(UsageError), flight_log(folder, FEW_FEATURES):
        raise UsageError("the port is taken")
    folder.close()
    assert list(tmp_path.iterdir()) == []


def test_a_fault_before_the_flight_began_is_kept(tmp_path: Path) -> None:
    folder = open_flight_folder(tmp_path / "out")
    with pytest.raises(FlightFailed), flight_log(folder, FEW_FEATURES):
        surprise()
    folder.close()
    assert "RuntimeError: surprise" in log_of(tmp_path / "out")
    assert not (tmp_path / "out" / LEDGER_NAME).exists()


def test_an_interruption_goes_on_and_is_written_down(folder: FlightFolder) -> None:
    with pytest.raises(KeyboardInterrupt), flight_log(folder, FEW_FEATURES):
        raise KeyboardInterrupt
    assert "the flight is interrupted (KeyboardInterrupt())" in log_of(folder.path)


def test_afterwards_everything_is_as_it_was(folder: FlightFolder) -> None:
    root, ours = logging.getLogger(), logging.getLogger("gcs_mosaic")
    before = list(root.handlers), ours.level, logging.raiseExceptions
    with flight_log(folder, replace(FEW_FEATURES, log=LogSettings(level="debug", verbose=True))):
        assert len(root.handlers) == len(before[0]) + 2
    assert (root.handlers, ours.level, logging.raiseExceptions) == before


def test_the_password_in_the_settings_is_not_written(folder: FlightFolder) -> None:
    with flight_log(folder, replace(FEW_FEATURES, rtsp="rtsp://user:secret@camera/main")):
        logging.getLogger("gcs_mosaic.x").error("rtsp://user:secret@camera/main is gone")
    assert "secret" not in log_of(folder.path)
    assert "rtsp='…'" in log_of(folder.path)


def test_the_log_of_another_flight_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "flight.log").write_text("mine")
    folder = open_flight_folder(tmp_path / "out")
    assert folder.path == tmp_path / "out-2"
    folder.close()


def test_a_stream_that_a_program_reads_gets_json_and_nothing_else(
    folder: FlightFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    config = replace(FEW_FEATURES, log=LogSettings(format="json"))
    with flight_log(folder, config):
        log_notice(logging.getLogger("gcs_mosaic.test"), Notice(source="disk", level="warning", text="full"))
        died = threading.Thread(target=lambda: 1 / 0, name="dying")
        died.start()
        died.join()
    lines = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert lines == [json.loads(line) for line in log_of(folder.path).splitlines()]
    (notice,) = (line for line in lines if line.get("source") == "disk")
    assert (notice["level"], notice["message"]) == ("warning", "disk: full")
    (dead,) = (line for line in lines if line["level"] == "critical")
    assert dead["traceback"].endswith("ZeroDivisionError: division by zero")


def test_a_log_that_cannot_be_written_is_said_in_json_too(
    folder: FlightFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder.path / "flight.log").mkdir()
    with flight_log(folder, replace(FEW_FEATURES, log=LogSettings(format="json"))):
        logging.getLogger("gcs_mosaic.test").info("something")
    messages = [json.loads(line)["message"] for line in capsys.readouterr().err.splitlines()]
    assert sum("flight.log cannot be written (Is a directory)" in message for message in messages) == 1
    assert "something" in messages
