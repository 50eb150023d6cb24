"""Why frames were not believed to show the same ground, counted."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence

from gcs_mosaic.stitch.graph.observer import Residuals
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.registration.outcome import NotRegistered, Registration

_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+(?:\.\d+)?(?:e[-+]?\d+)?|nan|inf)(?!\w)")


def grouped(reason: str) -> str:
    """A reason without its numbers: "only 31% of the overlap agrees" -> "only N % of the overlap agrees"."""
    return _NUMBER.sub("N", reason).replace("N%", "N %")


class Refusals:
    """An observer that counts reasons, by group: pairs that did not register, and poses that were not believed."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()

    def registered(self, a: str, b: str, found: Registration | NotRegistered) -> None:
        if isinstance(found, NotRegistered):
            self.counts[grouped(found.reason)] += 1

    def disbelieved(self, name: str, beside: str, reason: str) -> None:
        self.counts[f"disbelieved: {grouped(reason)}"] += 1

    def placed(self, placement: Placement) -> None:
        pass

    def adjusted(self, island: int, residuals: Callable[[], Sequence[Residuals]]) -> None:
        pass
