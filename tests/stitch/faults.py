"""Faults at any depth of a piece of work, found by looking on: whatever is called may raise, once.

An event is a call of a function of the package, its return, or a call that it makes to one not written in Python.
"""

import inspect
import random
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import CodeType
from typing import Any

PACKAGE = "/gcs_mosaic/"
# The instant after which a transaction holds is somewhere in these, and undoing cannot be undone.
BEYOND = ("transaction.py",)

Event = tuple[str, str]  # where, and what happens there


class Fault(Exception):  # noqa: N818 - the one that is made on purpose
    """Raised where a test wants it."""


@contextmanager
def counted() -> Iterator[Counter[Event]]:
    """How often each event happens meanwhile, in this thread."""
    counts: Counter[Event] = Counter()

    def look(frame: Any, what: str, about: Any) -> None:
        if event := event_of(frame.f_code, what, about):
            counts[event] += 1

    sys.setprofile(look)
    try:
        yield counts
    finally:
        sys.setprofile(None)


@contextmanager
def raising(event: Event, at: int, kind: Callable[[], BaseException] = Fault) -> Iterator[None]:
    """Raises when the event happens for the `at`-th time, counted from 1."""
    left = at

    def look(frame: Any, what: str, about: Any) -> None:
        nonlocal left
        if event_of(frame.f_code, what, about) == event:
            left -= 1
            if not left:
                sys.setprofile(None)
                raise kind()

    sys.setprofile(look)
    try:
        yield
    finally:
        sys.setprofile(None)


def event_of(code: CodeType, what: str, about: Any) -> Event | None:
    """The event, unless it is none of the package's or a finalizer's, which nobody could hear raise."""
    if PACKAGE not in code.co_filename or code.co_name == "__del__":
        return None
    if code.co_flags & inspect.CO_GENERATOR and (what == "call" or (what == "return" and about is None)):
        return None  # it may be thrown away before its end, which is a kind of finalizing, too
    where = code.co_filename.rpartition(PACKAGE)[2], code.co_qualname
    if what in ("call", "return"):
        return None if what == "return" and where[0].endswith(BEYOND) else (":".join(where), what)
    if (
        what != "c_call" or about.__name__ == "__exit__"
    ):  # which ends a with block: what raises before it leaves locks held
        return None
    return ":".join(where), f"calls {about.__qualname__}"


def chosen(counts: Counter[Event], count: int, rng: random.Random, but: str = "") -> list[tuple[Event, int]]:
    """Events at random, seldom ones as likely as frequent ones, and which time each; none of a function `but`."""
    events = sorted(event for event in counts if not but or not event[0].endswith(f":{but}"))
    picked = [rng.choice(events) for _ in range(count)]
    return [(event, rng.randint(1, counts[event])) for event in picked]
