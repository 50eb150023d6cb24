"""What the operator is told when something asked for cannot be done."""

from __future__ import annotations


class UsageError(Exception):
    """Bad input from a person: an address, a setting, a folder.

    The message is one sentence that says what came, what was wanted and what to do; the program prints it and exits with 2.
    """


class NothingPlaced(Exception):  # noqa: N818 - nobody has erred
    """No frame of those that were given is on a map. The program prints the message and exits with 3."""


class FlightFailed(Exception):  # noqa: N818 - it says what is, not that somebody erred
    """A fault of the program has ended a flight; the log has its traceback. The program prints the message and exits with 1."""
