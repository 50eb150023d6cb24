"""Which consecutive frames of a flight match, and why the others do not: each two as a flight of their own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import cv2

from gcs_mosaic.frames.directory import frames_in
from gcs_mosaic.messages import Frame
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.placement import Placement, Rejection
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings
from gcs_mosaic.stitch.registration.outcome import NotRegistered, Registration
from tests.benchmarks.feature_cache import FeatureFinder
from tests.benchmarks.flight_run import Task
from tests.benchmarks.refusals import Refusals, grouped


@dataclass(frozen=True, slots=True)
class Pairs:
    """registered: pairs whose matches are believed; placed: of these, pairs whose pose is, too; why: the other pairs."""

    pairs: int
    registered: int
    placed: int
    why: dict[str, int]

    def __str__(self) -> str:
        lines = [f"{self.registered} of {self.pairs} consecutive pairs register, {self.placed} find a pose"]
        return "\n".join(lines + [f"{'':9}{count:6} x {reason}" for reason, count in self.why.items()])


class _Looking(Refusals):
    """Notes whether a pair has registered at all, and the last reason why something was refused."""

    def __init__(self) -> None:
        super().__init__()
        self.found = False
        self.reason = ""

    def registered(self, a: str, b: str, found: Registration | NotRegistered) -> None:
        self.found |= isinstance(found, Registration)
        if isinstance(found, NotRegistered):
            self.reason = self.reason or found.reason

    def disbelieved(self, name: str, beside: str, reason: str) -> None:
        self.reason = f"registered, but disbelieved: {reason}"


def pairs(task: Task) -> Pairs:
    """Match all consecutive frames of a flight."""
    cv2.setNumThreads(1)
    settings = task.config.stitch
    finder = FeatureFinder(settings.features, task.config.reduction, task.cache)
    frames = [item for item in frames_in([task.folder], task.config.frames).frames if isinstance(item, Frame)]
    features = (finder.features_of(frame) for frame in frames)
    return reported(_matched(a, b, settings) for a, b in pairwise(features))


def reported(outcomes: Iterable[tuple[bool, str]]) -> Pairs:
    """The report of pairs: whether each has registered, and why it was refused in the end, if it was."""
    told = list(outcomes)
    return Pairs(
        pairs=len(told),
        registered=sum(registered for registered, _ in told),
        placed=sum(not reason for _, reason in told),
        why=dict(Counter(grouped(reason) for _, reason in told if reason).most_common()),
    )


def _matched(a: Features | str, b: Features | str, settings: StitchSettings) -> tuple[bool, str]:
    for features in (a, b):
        if isinstance(features, str):
            return False, features
    assert not isinstance(a, str)
    assert not isinstance(b, str)
    looking = _Looking()
    mosaic = Mosaic(settings, observer=looking)
    first = mosaic.place(a, "a")
    second = first if isinstance(first, Rejection) else mosaic.place(b, "b")
    if isinstance(second, Rejection):
        return False, second.reason
    return looking.found, "" if isinstance(second, Placement) else looking.reason or "never compared"
