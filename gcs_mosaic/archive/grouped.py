"""Many small results by few tasks: each makes those of a group; one that cannot be made costs itself alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.tasks import Made, StageTask, Unmade

T = TypeVar("T")


def grouped(
    engine: Engine, stage: str, items: Sequence[T], of: Callable[[tuple[T, ...]], StageTask], size: int
) -> list[Any]:
    """What the summaries of tasks `of` groups of items hold for each item, or Unmade. Raises FlightFailed as `Engine.run`."""
    groups = [tuple(items[at : at + size]) for at in range(0, len(items), size)]
    found: list[Any] = []
    for group, outcome in zip(groups, engine.run(stage, [of(group) for group in groups]), strict=True):
        if isinstance(outcome, Made):
            found += outcome.summary
            continue
        for one in engine.run(f"{stage}, one by one", [of((item,)) for item in group]):
            found += one.summary if isinstance(one, Made) else [Unmade(one.reason)]
    return found
