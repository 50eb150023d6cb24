"""Who may look, by a token that is made once for a flight and kept in its folder."""

from __future__ import annotations

import logging
import os
import re
import secrets
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from gcs_mosaic.store import inside
from gcs_mosaic.store.folder import TOKEN_NAME
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.settings import WebSettings

logger = logging.getLogger(__name__)

LETTERS = "abcdefghjkmnpqrstuvwxyz23456789"  # that nobody mistakes for another; it may have to be typed
LENGTH = 16  # 79 bits: nobody guesses it, at any number of tries
TOKEN = re.compile(f"[{LETTERS}]{{{LENGTH}}}")
IN_ADDRESS = re.compile(r"(token=)[^&\s'\"]*", re.IGNORECASE)
OWNER_ONLY = 0o600


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """Who may look besides this machine: nobody, whoever has the `token`, or everybody."""

    token: str | None = None
    is_open: bool = False


def access_to(address: HttpAddress, settings: WebSettings, flight: Path, earlier: Iterable[Path] = ()) -> Access:
    """Who may look at a flight's page; the `earlier` flights' folders are asked for a token that is known to a device already."""
    if address.is_loopback or settings.open:
        return Access(is_open=settings.open)
    return Access(token=kept_token(flight, earlier))


def kept_token(flight: Path, earlier: Iterable[Path] = ()) -> str:
    """The token of a flight's folder; else that of the first of the `earlier` flights that has one, or a new one.

    It is written into the flight's folder, so that a device need not be let in again after a restart. Where that is not
    possible it holds for this run.
    """
    ours = _read(flight)
    if ours is not None:
        return ours
    token = next((found for folder in earlier if (found := _read(folder))), None) or new_token()
    try:
        path, how = flight / TOKEN_NAME, os.O_WRONLY | os.O_CREAT | os.O_TRUNC
        descriptor = inside.descriptor(path, flight, how, OWNER_ONLY)
        with os.fdopen(descriptor, "w", encoding="ascii") as file:
            file.write(f"{token}\n")
    except OSError as error:
        logger.warning("the token cannot be kept (%s): it holds until the end of this run", error)
    return token


def new_token() -> str:
    return "".join(secrets.choice(LETTERS) for _ in range(LENGTH))


def without_token(text: str) -> str:
    """What somebody has sent, for the log."""
    return IN_ADDRESS.sub(r"\1…", text)


def _read(folder: Path) -> str | None:
    """The token in a folder; None if there is none, or none that we made."""
    try:
        with inside.reading(folder / TOKEN_NAME, folder) as file:
            found = file.read(2 * LENGTH).decode("ascii", "replace").strip()
    except FileNotFoundError:
        return None
    except OSError as error:
        logger.warning("the token cannot be read (%s)", error)
        return None
    return found if TOKEN.fullmatch(found) else None
