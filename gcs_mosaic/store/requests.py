"""What the operator asks of a running flight, as small files in its folder: `request.json`, answered by `answer.json`.

A request is written beside and renamed, so it is never half there; the flight reads and deletes it. Only who may write into the
folder may ask. Whatever else lies under that name is left out with a reason.
"""

from __future__ import annotations

import json
import secrets
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gcs_mosaic.messages import HIGHEST_SYSTEM
from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import write_beside

REQUEST_NAME, ANSWER_NAME = "request.json", "answer.json"
_LARGEST = 4096  # bytes
_LONGEST_ID = 64  # characters
_POLL_S = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowRequest:
    """The aircraft with this MAVLink system id is to be followed; `id` is repeated in the answer."""

    id: str
    vehicle: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What became of the request `id`, in a sentence."""

    id: str
    taken: bool
    text: str


def ask_to_follow(flight: Path, vehicle: int, patience_s: float) -> Answer | None:
    """Ask the flight in this folder; its answer, or None if there was none in time: the request is then withdrawn.

    Raises OSError or DiskFull if the folder cannot be written.
    """
    request = FollowRequest(id=secrets.token_hex(8), vehicle=vehicle)
    path, document = flight / REQUEST_NAME, {"id": request.id, "vehicle": vehicle}
    write_beside(path, json.dumps(document).encode("ascii"))
    deadline = time.monotonic() + patience_s
    while time.monotonic() < deadline:
        if (answer := _answer_to(request, flight)) is not None:
            return answer
        time.sleep(_POLL_S)
    inside.remove(path, flight)
    return _answer_to(request, flight)


def take_request(flight: Path) -> FollowRequest | str | None:
    """The pending request, which is deleted; the reason why it is none; None if there is nothing. Raises OSError."""
    path = flight / REQUEST_NAME
    try:
        data = _small_file(path)
    except FileNotFoundError:
        return None
    inside.remove(path, flight)
    return data if isinstance(data, str) else _request_in(data)


def answer(flight: Path, told: Answer) -> None:
    """Answer a request. Raises OSError or DiskFull."""
    document = {"id": told.id, "taken": told.taken, "text": told.text}
    write_beside(flight / ANSWER_NAME, json.dumps(document).encode("ascii"))


def clear_requests(flight: Path) -> None:
    """Remove what an earlier run has left. Raises OSError."""
    for name in (REQUEST_NAME, ANSWER_NAME):
        inside.remove(flight / name, flight)


def _small_file(path: Path) -> bytes | str:
    """The content of a small regular file; otherwise what is there instead. Links are not followed, pipes not opened."""
    path.lstat()  # raises FileNotFoundError
    try:
        return inside.read(path, path.parent, _LARGEST)
    except FileNotFoundError:
        raise
    except OSError:
        return f"{path.name} is no small file"


def _request_in(data: bytes) -> FollowRequest | str:
    try:
        document: Any = json.loads(data)
    except (ValueError, RecursionError):
        return f"{REQUEST_NAME} is no JSON"
    if not isinstance(document, dict):
        return f"{REQUEST_NAME} is no request"
    name, vehicle = document.get("id"), document.get("vehicle")
    if not isinstance(name, str) or not 1 <= len(name) <= _LONGEST_ID or not name.isascii() or not name.isalnum():
        return f"{REQUEST_NAME} has no id of letters and digits"
    if not isinstance(vehicle, int) or isinstance(vehicle, bool) or not 1 <= vehicle <= HIGHEST_SYSTEM:
        return f"{REQUEST_NAME} names no MAVLink system id from 1 to {HIGHEST_SYSTEM}"
    return FollowRequest(id=name, vehicle=vehicle)


def _answer_to(request: FollowRequest, flight: Path) -> Answer | None:
    try:
        data = _small_file(flight / ANSWER_NAME)
    except FileNotFoundError:
        return None
    try:
        document: Any = {} if isinstance(data, str) else json.loads(data)
    except (ValueError, RecursionError):
        return None
    if not isinstance(document, dict) or document.get("id") != request.id:
        return None
    return Answer(id=request.id, taken=document.get("taken") is True, text=str(document.get("text", "")))
