"""What a check has found: parts of a flight, how much of each was looked at, and what is wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

Progress = Callable[[str, int, int], None]  # what is looked at, how many are done, of how many


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that is not as it should be; `subject` is a frame's name or a path within the flight's folder."""

    subject: str
    text: str


@dataclass(slots=True)
class CheckedPart:
    """A part of a flight; `checked` counts what `unit` names."""

    name: str
    unit: str
    checked: int = 0
    faults: list[Fault] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)  # not wrong, but good to know
    lost: str = ""  # what is missing and cannot be brought back, in words

    def fault(self, subject: object, text: str) -> None:
        self.faults.append(Fault(str(subject), text))

    @property
    def subjects(self) -> set[str]:
        return {fault.subject for fault in self.faults}


def counted(count: int, what: str) -> str:
    """In words; empty for none."""
    return f"{count} {what}{'' if count == 1 else 's'}" if count else ""


@dataclass(slots=True)
class LostForGood:
    """What a repair could not bring back: `unread`, what could not be read of a damaged ledger, in words; `originals`, names of
    the frames whose files are recorded as not kept; `tiles`, how many were there by their masks, and show such frames."""

    unread: str = ""
    originals: list[str] = field(default_factory=list)
    tiles: int = 0

    @property
    def words(self) -> str:
        """Empty if it is nothing."""
        told = (self.unread, counted(len(self.originals), "original"), counted(self.tiles, "tile"))
        return "; ".join(filter(None, told))


@dataclass(frozen=True, slots=True)
class Findings:
    """The result of a check; `repaired` says what was done about it, `lost` what could not be brought back then.

    `keeps_documents`: whether a repair leaves the documents, which tell more of the map than the ledger.
    """

    flight: str
    parts: Sequence[CheckedPart]
    repaired: Sequence[str] = ()
    lost: LostForGood = field(default_factory=LostForGood)
    keeps_documents: bool = False

    @property
    def is_whole(self) -> bool:
        return not any(part.faults for part in self.parts)

    @property
    def is_beyond_repair(self) -> bool:
        """Whether a repair changes nothing of what is wrong."""
        return self.keeps_documents and {part.name for part in self.parts if part.faults} == {"documents"}

    @property
    def resumable(self) -> bool:
        """Whether there is a checkpoint that can be read."""
        return any(part.name == "checkpoint" and part.checked and not part.faults for part in self.parts)

    def document(self) -> dict[str, Any]:
        """As for --json."""
        parts = [asdict(part) for part in self.parts]
        return {
            "flight": self.flight,
            "whole": self.is_whole,
            "parts": parts,
            "repaired": list(self.repaired),
            "lost": asdict(self.lost),
        }


def in_groups(faults: Sequence[Fault], shown: int) -> Iterator[str]:
    """One line for all faults of one kind: how many, and the first `shown` of whom."""
    groups: dict[str, list[str]] = {}
    for fault in faults:
        groups.setdefault(fault.text, []).append(fault.subject)
    for text, subjects in groups.items():
        more = f" and {len(subjects) - shown} more" if len(subjects) > shown else ""
        yield f"{len(subjects)} x {text}: {', '.join(subjects[:shown])}{more}"
