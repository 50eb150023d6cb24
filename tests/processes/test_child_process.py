"""A child process is started, heard, and ended in bounded time, whatever it does."""

from __future__ import annotations

import atexit
import logging
import os
import signal
import subprocess
import sys
import threading
import time
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.processes import main
from gcs_mosaic.processes.child import MOST_WORDS, ChildProcess, ending
from gcs_mosaic.processes.pipe import ChildTeller, TellingHandler, messages, receive, send, was_logged
from gcs_mosaic.processes.signals import starting
from tests.running import until

SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
LINES = 20_000
IN_TIME_S = 30.0
LONG_START = """
import sys, time
time.sleep(0.5)  # imports take as long
from gcs_mosaic.processes.signals import outlive_signals
outlive_signals()
print("there", flush=True)
sys.stdin.read()
print("ended", flush=True)
"""
PROGRAM = """
import sys, time
from test_child_process import hang
from gcs_mosaic.processes.child import ChildProcess
child = ChildProcess("hanging", hang)
child.pipe.recv()
print(child.pid, flush=True)
time.sleep(100)
"""


def echo(pipe: Connection, *given: object) -> None:
    pipe.send((os.getpid(), given))


def hang(pipe: Connection) -> None:
    pipe.send("here")
    time.sleep(1000)


def flood(pipe: Connection) -> None:
    for number in range(LINES):
        print("x" * 500, number, file=sys.stderr)
    pipe.send("done")


def fail(pipe: Connection) -> None:
    raise ValueError("nothing goes right")


def niceness(pipe: Connection) -> None:
    pipe.send(os.nice(0))


def no_more_threads(_thread: threading.Thread) -> None:
    raise RuntimeError("can't start new thread")


def tell_much(pipe: Connection) -> None:
    teller = ChildTeller(pipe)
    logging.basicConfig(level=logging.INFO, handlers=[TellingHandler(teller)])
    logging.getLogger("there").error("that went wrong")
    teller.send({"frame": 1}, b"\0\xff")


@pytest.mark.long
def test_it_is_another_process_which_gets_what_is_given_and_ends_by_itself() -> None:
    child = ChildProcess("echo", echo, 1, "two")
    assert child.pipe.recv() == (child.pid, (1, "two"))
    assert ending(child.end()) == "exit code 0"
    assert child.end() == 0


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("sign", SIGNALS)
def test_signals_are_held_until_a_child_can_say_that_they_are_not_for_it(sign: signal.Signals) -> None:
    """One that was still loading died of all of them."""
    with starting():
        child = subprocess.Popen(
            [sys.executable, "-c", LONG_START], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
    with child:
        try:
            time.sleep(0.1)
            child.send_signal(sign)
            assert child.stdout is not None
            assert child.stdout.readline() == "there\n"
            child.send_signal(sign)
            assert child.communicate(timeout=20)[0] == "ended\n"
        finally:
            child.kill()
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []).isdisjoint(SIGNALS), "the program hears them as before"


@pytest.mark.long
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_one_that_hangs_is_ended_in_time() -> None:
    child = ChildProcess("hanging", hang)
    assert child.pipe.recv() == "here"
    start = time.monotonic()
    assert ending(child.end(0.2)) == "SIGKILL"
    assert time.monotonic() - start < 5


@pytest.mark.long
def test_what_one_prints_goes_into_the_log_and_never_holds_it_up(caplog: pytest.LogCaptureFixture) -> None:
    child = ChildProcess("the flooding one", flood)
    assert child.pipe.poll(IN_TIME_S)
    assert child.pipe.recv() == "done"
    assert child.end() == 0
    assert len(caplog.messages) == MOST_WORDS
    assert caplog.messages[0] == f"the flooding one: {'x' * 500} 0"


@pytest.mark.long
def test_the_last_words_of_one_that_breaks_are_in_the_log(caplog: pytest.LogCaptureFixture) -> None:
    child = ChildProcess("the broken one", fail)
    with pytest.raises(EOFError):
        child.pipe.recv()
    assert ending(child.end()) == "exit code 1"
    assert caplog.messages[-1] == "the broken one: ValueError: nothing goes right"


@pytest.mark.skipif(not Path("/proc").exists(), reason="descriptors are counted in /proc")
@pytest.mark.parametrize("given", ["no thread", threading.Lock()], ids=["no thread", "not to be sent"])
def test_nothing_is_left_of_one_that_could_not_begin(given: object, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is tried again and again, on a machine that is at its limits already."""
    kept, begun = set[int](), list[int]()

    def keep(kill: Any) -> None:
        begun.append(kill.__self__.pid)
        kept.add(begun[-1])

    monkeypatch.setattr(atexit, "register", keep)
    monkeypatch.setattr(atexit, "unregister", lambda kill: kept.discard(kill.__self__.pid))
    if given == "no thread":
        monkeypatch.setattr(threading.Thread, "start", no_more_threads)
    before = set(Path("/proc/self/fd").iterdir())
    with pytest.raises((OSError, TypeError)) as held:
        ChildProcess("echo", echo, given)
    assert len(begun) == 1
    assert not Path(f"/proc/{begun[0]}").exists()
    assert not kept
    until(lambda: set(Path("/proc/self/fd").iterdir()) == before, "its descriptors are closed", 5.0)
    assert held.tb is not None, "not by the garbage collection alone"


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "nice"), reason="no niceness")
def test_it_is_as_nice_as_it_is_meant_to_be() -> None:
    child = ChildProcess("nice", niceness, niceness=7)
    assert child.pipe.recv() == min(19, os.nice(0) + 7)
    child.end()


@pytest.mark.long
def test_messages_and_log_records_come_as_they_were_told(caplog: pytest.LogCaptureFixture) -> None:
    child = ChildProcess("the telling one", tell_much)
    logged, mass = receive(child.pipe)
    assert not mass
    assert was_logged(logged, "the telling one")
    assert caplog.messages == ["the telling one: ERROR:there:that went wrong"]
    assert next(messages(child.pipe, IN_TIME_S)) == ({"frame": 1}, b"\0\xff")
    child.end()


@pytest.mark.parametrize(
    "data", [b"", b"[1]", b"{", b"\0", b"\xff\0x", b"3\0", b"[" * 100_000], ids=lambda data: repr(data[:9])
)
def test_what_is_no_message_is_refused(data: bytes) -> None:
    ours, theirs = Pipe()
    with ours, theirs:
        send(theirs, {"first": True})
        theirs.send_bytes(data)
        assert receive(ours) == ({"first": True}, b"")
        with pytest.raises(OSError, match="no message of ours"):
            receive(ours)


@pytest.mark.parametrize("told", [["high", "text"], [float("inf"), "text"], [30], 3, None], ids=repr)
def test_an_odd_log_record_is_refused(told: object) -> None:
    with pytest.raises(OSError, match="no message of ours"):
        was_logged({"log": told}, "it")


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc").exists(), reason="processes are looked up in /proc")
def test_one_that_hangs_ends_after_the_program_that_was_killed() -> None:
    here = os.pathsep.join([str(Path(__file__).parent), str(Path(__file__).parents[2])])
    environment = os.environ | {"PYTHONPATH": here}
    with subprocess.Popen([sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, env=environment) as program:
        assert program.stdout is not None
        child = int(program.stdout.readline())
        assert runs(child)
        program.kill()
    until(lambda: not runs(child), "it has ended", main.FAREWELL_S + IN_TIME_S)


def runs(process: int) -> bool:
    try:
        return ") Z " not in Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return False
