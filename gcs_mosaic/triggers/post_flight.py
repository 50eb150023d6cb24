"""End-of-flight matching of files that arrived late or lost their times, by file numbers and the shots' counters alone.

A camera that writes everything after landing, or a copied memory card, leaves no usable times, so the offset between file
numbers and counters was never learnt. They are matched only if they fit exactly: as many files as shots, with the same
gaps. With one file too many or too few, several alignments would be equally good.
"""

from __future__ import annotations

from collections.abc import Iterable

from gcs_mosaic.triggers.index import PendingEvent, PendingFrame, State
from gcs_mosaic.triggers.outcomes import How
from gcs_mosaic.triggers.sequence_offsets import Learnt

LEAST = 4  # three might be chance, as in the counters' votes


def match_by_sequence(
    events: Iterable[PendingEvent], frames: Iterable[PendingFrame], learnt: Learnt
) -> list[tuple[PendingEvent, PendingFrame]]:
    """Pairs among the events and frames that neither a name nor a known counter offset has matched."""
    shots = [held for held in events if held.state is not State.FAILED and held.how in (None, How.TIME)]
    files = [held for held in frames if held.fresh and (held.event is None or held.event.how is How.TIME)]
    named = learnt.names_work and any(held.hints for held in shots)
    if named or len(shots) != len(files) or len(shots) < LEAST:
        return []
    numbered = sorted((held.number, index) for index, held in enumerate(files) if held.number is not None)
    for stream in dict(held.counts[-1] for held in shots if held.counts):
        counted = sorted((dict(held.counts).get(stream, -1), index) for index, held in enumerate(shots))
        differ = {number - count for (number, _), (count, _) in zip(numbered, counted, strict=False)}
        if len(numbered) == len(counted) and counted[0][0] >= 0 and len(differ) == 1 and learnt.offset(stream) is None:
            return [(shots[shot], files[file]) for (_, shot), (_, file) in zip(counted, numbered, strict=True)]
    return []
