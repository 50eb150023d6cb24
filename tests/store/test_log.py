"""flight.log: a record is a line that nobody else can write, and no disk can stop the flight by it."""

from __future__ import annotations

import json
import logging
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.messages import Notice
from gcs_mosaic.store.log import (
    BAR,
    JsonFormatter,
    LogFile,
    LogSettings,
    RecordFormatter,
    TerminalHandler,
    log_notice,
    masked,
)
from tests.sure import sure

RECORD = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z [A-Z]+ \S+ [\w.]+: ")
FORGED = "2030-01-01T00:00:00.000Z INFO MainThread gcs_mosaic.app.pipeline.pipeline: a.jpg: placed"


class Log:
    """A log file with a logger of its own; `troubles` is what the operator was told."""

    def __init__(self, path: Path, settings: LogSettings | None = None) -> None:
        self.path = path
        self.troubles: list[str] = []
        self.handler = LogFile(path, settings or LogSettings(), self.troubles.append)
        self.logger = logging.Logger("test", logging.DEBUG)
        self.logger.addHandler(self.handler)

    @property
    def lines(self) -> list[str]:
        return self.path.read_text(encoding="utf-8").split("\n")[:-1]


def fill(path: Path) -> None:
    """Leave no room on the disk."""
    with path.open("wb", buffering=0) as file, suppress(OSError):
        while True:
            file.write(bytes(4096))


@pytest.fixture
def log(tmp_path: Path) -> Iterator[Log]:
    log = Log(tmp_path / "flight.log")
    yield log
    log.handler.close()


def test_a_record_tells_when_how_bad_on_which_thread_and_by_whom(log: Log) -> None:
    log.logger.warning("%s is dropped", "a.jpg")
    (line,) = log.lines
    assert RECORD.match(line)
    assert line.endswith(" WARNING MainThread test: a.jpg is dropped")


def test_what_is_less_important_than_the_level_is_not_written(tmp_path: Path) -> None:
    log = Log(tmp_path / "flight.log", LogSettings(level="warning"))
    log.logger.info("small")
    log.logger.error("large")
    log.handler.close()
    assert [line.rpartition(" ")[2] for line in log.lines] == ["large"]


@given(st.text())
def test_whatever_a_name_is_a_record_stays_one_line(name: str) -> None:
    record = logging.LogRecord("test", logging.INFO, __file__, 1, "%s has come", (name,), None)
    line = RecordFormatter().format(record)
    assert line.isprintable()
    assert RECORD.match(line)
    assert line.endswith(" has come")


@pytest.mark.parametrize(
    "breaks", ["\n", "\r", "\r\n", "\x0b", "\x0c", "\x1c", "\x85", "\u2028", "\u2029", "\x1b[2K\x1b[1G"]
)
def test_a_name_cannot_forge_a_record(log: Log, breaks: str) -> None:
    log_notice(log.logger, Notice(source="link", level="info", text=f"the aircraft says a{breaks}{FORGED}"))
    (line,) = log.path.read_text(encoding="utf-8").splitlines()
    assert not line.startswith(FORGED)
    assert "\\" in line


def test_the_words_of_an_exception_cannot_forge_a_record(log: Log) -> None:
    try:
        raise ValueError(f"a\n{FORGED}\r\x1b[0m{FORGED}")
    except ValueError:
        log.logger.exception("it happened")
    first, *others = log.path.read_text(encoding="utf-8").splitlines()
    assert first.endswith("it happened")
    assert others[0] == f"{BAR}Traceback (most recent call last):"
    assert all(line.startswith(BAR) and line.isprintable() for line in others)
    assert f"{BAR}{FORGED}" in "\n".join(others)


def test_file_names_that_are_no_text_are_written(log: Log) -> None:
    log.logger.info("%s is there", b"caf\xe9.jpg".decode("utf-8", "surrogateescape"))
    assert log.lines[0].endswith("caf\\udce9.jpg is there")


@pytest.mark.parametrize(
    ("said", "written"),
    [
        ("rtsp://user:secret@192.168.1.20:554/main failed", "rtsp://192.168.1.20:554/main failed"),
        ("'rtsp://user:se/cr@et@camera/main'", "'rtsp://camera/main'"),
        ("RTSPS://h/user=admin_password=secret_channel=1", "RTSPS://h/…"),
        ("rtsp://h:1/main?password=secret", "rtsp://h:1/…"),
        ('"rtsp://user:pa\'ss@host/live"', '"rtsp://host/live"'),
        ("'rtsp://user:pa\\'s\"s@host/live' is gone", "'rtsp://host/live' is gone"),
        ("rtsp://h:1/main?password=sec'ret", "rtsp://h:1/…"),
        ("['rtsp://a/1', 'rtsp://b/2']", "['rtsp://a/1', 'rtsp://b/2']"),
        ("rtsp://192.0.2.7/main, of which", "rtsp://192.0.2.7/main, of which"),
        ("the map is at http://127.0.0.1:8470/", "the map is at http://127.0.0.1:8470/"),
    ],
)
def test_the_password_of_a_stream_is_never_written(said: str, written: str) -> None:
    assert masked(said) == written


def test_words_that_do_not_fit_their_numbers_are_written_all_the_same(log: Log) -> None:
    log.logger.info("%d frames", "three")
    assert log.lines[0].endswith("'%d frames' with ('three',)")


def test_the_log_is_bounded(tmp_path: Path) -> None:
    log = Log(tmp_path / "flight.log", LogSettings(file_mb=1, files=3))
    for number in range(5000):
        log.logger.info("%d %s", number, "x" * 900)
    log.handler.close()
    files = sorted(tmp_path.iterdir())
    assert [path.name for path in files] == ["flight.log", "flight.log.1", "flight.log.2"]
    assert all(path.stat().st_size <= 1_000_000 for path in files)
    oldest_first = [line for path in (*files[:0:-1], files[0]) for line in path.read_text().splitlines()]
    numbers = [int(line.split()[4]) for line in oldest_first]
    assert numbers == list(range(numbers[0], 5000))  # nothing is lost between two files
    assert not log.troubles


@pytest.mark.parametrize("wrong", [{"file_mb": 0}, {"files": 1}])
def test_settings_that_would_not_bound_it_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="expected"):
        LogSettings(**wrong)


def test_a_full_disk_is_said_once_and_leaves_whole_lines(tiny_disk: Path) -> None:
    log = Log(tiny_disk / "flight.log")
    log.logger.info("first")
    filler = tiny_disk / "filler"
    fill(filler)
    for number in range(100):  # the page that is begun takes some of them still
        log.logger.info("during %d %s", number, "x" * 200)
    filler.unlink()
    log.logger.info("after")
    log.handler.close()
    (trouble,) = log.troubles
    assert "No space left on device" in trouble
    assert "goes on without it" in trouble
    assert all(RECORD.match(line) for line in log.lines)
    whole = [line for line in log.lines if " during " in line]
    assert all(line.endswith("x" * 200) for line in whole)
    assert log.lines[-2].endswith("after")
    assert f"{100 - len(whole)} records before the last one could not be written" in log.lines[-1]


def test_a_disk_that_is_pulled_out_is_survived_and_so_is_its_return(tmp_path: Path) -> None:
    """The folder is not there when the first record, or a new file, is to be written."""
    log = Log(tmp_path / "card" / "flight.log")
    log.logger.info("lost")
    (tmp_path / "card").mkdir()
    log.logger.info("found")
    log.handler.close()
    assert len(log.troubles) == 1
    assert [line.partition("test: ")[2] for line in log.lines[:1]] == ["found"]
    assert "1 records before the last one" in log.lines[1]


def test_a_stream_that_was_closed_under_it_is_opened_again(log: Log) -> None:
    log.logger.info("before")
    sure(log.handler.stream).close()
    log.logger.info("lost")
    log.logger.info("after")
    assert [line.rpartition(" ")[2] for line in log.lines] == ["before", "after", "missing"]


def test_the_terminal_is_told_what_was_not_said_yet_and_no_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    logger = logging.Logger("test", logging.DEBUG)
    logger.addHandler(TerminalHandler(LogSettings()))
    log_notice(logger, Notice(source="page", level="info", text="said anyway"))
    logger.debug("too small")
    try:
        raise ValueError("surprise")
    except ValueError:
        logger.exception("it happened to %s", "a\nb")
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("test: it happened to a\\nb")


def test_a_terminal_that_has_gone_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    class Gone:
        def write(self, text: str) -> int:
            raise BrokenPipeError

    monkeypatch.setattr(sys, "stderr", Gone())
    logger = logging.Logger("test", logging.DEBUG)
    logger.addHandler(TerminalHandler(LogSettings()))
    logger.error("nobody hears this")


def test_what_cannot_be_told_is_told_by_its_type(log: Log) -> None:
    class Shy:
        def __repr__(self) -> str:
            raise RuntimeError("I will not be seen")

    log.logger.info("%s and %r", 3, Shy())
    log.logger.info(Shy())
    assert log.troubles == []
    assert log.lines[0].endswith("'%s and %r' with (3, <Shy>)")
    assert log.lines[1].endswith("<Shy> with ()")


def test_a_record_in_json_is_one_object_with_its_fields_and_its_traceback(tmp_path: Path) -> None:
    log = Log(tmp_path / "flight.log", LogSettings(format="json"))
    log.logger.info(
        "%s is placed", "a.jpg", extra={"fields": {"frame": "a.jpg", "seconds": {"place": 0.5}, "level": "x"}}
    )
    try:
        raise ValueError("rtsp://me:secret@camera/main\n\u202e is odd")
    except ValueError:
        log.logger.exception("it failed")
    log.handler.close()
    first, second = map(json.loads, log.lines)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", first.pop("utc"))
    assert first == {
        **{"frame": "a.jpg", "seconds": {"place": 0.5}, "level": "info", "thread": "MainThread"},
        **{"logger": "test", "message": "a.jpg is placed"},
    }
    assert (second["level"], second["message"]) == ("error", "it failed")
    assert second["traceback"].startswith("Traceback (most recent call last):\n")
    assert second["traceback"].endswith("ValueError: rtsp://camera/main\n\u202e is odd")


@given(st.text(), st.dictionaries(st.text(), st.floats() | st.text() | st.binary()))
def test_whatever_is_logged_is_one_line_of_json(name: str, fields: dict[str, object]) -> None:
    record = logging.LogRecord("test", logging.INFO, __file__, 1, "%s has come", (name,), None)
    record.fields = fields
    line = JsonFormatter().format(record)
    assert line.isascii()
    assert line.isprintable()
    assert json.loads(line, parse_constant=never)["message"].endswith(" has come")


def never(constant: str) -> None:
    raise AssertionError(f"{constant} is not JSON")
