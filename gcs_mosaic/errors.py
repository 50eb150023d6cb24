"""Exceptions whose message is shown to the operator."""

from __future__ import annotations


class UsageError(Exception):
    """Invalid user input: an address, a setting, a folder.

    The message is one sentence: what was given, what was expected and what to do. The program prints it and exits with 2.
    """


class NothingPlaced(Exception):  # noqa: N818 - not an error
    """None of the given frames could be placed. The program prints the message and exits with 3."""


class FlightFailed(Exception):  # noqa: N818 - names a state, not an error
    """An internal error ended a flight; the log has the traceback. The program prints the message and exits with 1."""
