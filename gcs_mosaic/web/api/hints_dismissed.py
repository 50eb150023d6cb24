"""Hints that were dismissed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from aiohttp import web

from gcs_mosaic.notes.search.dismissed_hints import HINT, DismissedHint, HintKey
from gcs_mosaic.notes.storage.checked import Who
from gcs_mosaic.web.api.asked import asked_body
from gcs_mosaic.web.api.common import BASE, answer, missing, told_anew
from gcs_mosaic.web.api.notes import NOTES
from gcs_mosaic.web.api.operations import NO_NOTES, Operations, Reply

PATH = f"{BASE}/hints/dismissed"
OPERATIONS = Operations()


@dataclass(frozen=True, slots=True, kw_only=True)
class DismissedAnswer:
    """The hints that were dismissed, the first dismissed first."""

    revision: int
    dismissed: Sequence[DismissedHint]


@dataclass(frozen=True, slots=True, kw_only=True)
class DismissalBody:
    """A hint to be dismissed."""

    hint: HintKey
    who: Who


@dataclass(frozen=True, slots=True, kw_only=True)
class HintKeyAnswer:
    """The hint."""

    hint: HintKey


@OPERATIONS.add("GET", PATH, Reply("The hints.", DismissedAnswer, tagged=True), failures=NO_NOTES)
async def every(request: web.Request) -> web.StreamResponse:
    """The hints that were dismissed, with who and when."""
    notes = request.app[NOTES]
    revision, hints = await notes.run(lambda: (notes.book.revision, notes.dismissed.all()))
    return told_anew(request, DismissedAnswer(revision=revision, dismissed=hints))


@OPERATIONS.add("POST", PATH, Reply("It is dismissed.", HintKeyAnswer), body=DismissalBody, failures=NO_NOTES)
async def dismiss(request: web.Request) -> web.StreamResponse:
    """Dismiss a hint."""
    asked, notes = await asked_body(request, DismissalBody), request.app[NOTES]
    await notes.run(notes.dismissed.dismiss, asked.hint, asked.who)
    return answer(HintKeyAnswer(hint=asked.hint))


@OPERATIONS.add(
    "DELETE",
    f"{PATH}/{{hint:{HINT.pattern}}}",
    Reply("It is back.", HintKeyAnswer),
    failures={404: "That hint was not dismissed."} | NO_NOTES,
)
async def bring_back(request: web.Request) -> web.StreamResponse:
    """Bring a hint back."""
    notes, hint = request.app[NOTES], request.match_info["hint"]
    if not await notes.run(notes.dismissed.bring_back, hint):
        raise missing("That hint was not dismissed.")
    return answer(HintKeyAnswer(hint=hint))
