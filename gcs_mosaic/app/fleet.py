"""What the operator is told of each of several aircraft; nothing where a single one is followed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from gcs_mosaic.messages import Frame, SourceReport
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.status import AircraftStatus, Behind, LastFrame

Aircraft = int | None  # None: frames of one source for all


class Fleet:
    """The aircraft of a flight. `counted` tells those whose triggers count; `several`: whether there may be more than one."""

    def __init__(self, counted: Callable[[], Iterable[int]], ledger: Ledger, *, several: bool = True) -> None:
        self._counted, self._ledger, self._several = counted, ledger, several
        self._last: dict[Aircraft, LastFrame] = {}

    def processed(self, vehicle: Aircraft, frame: LastFrame) -> None:
        """A frame of this aircraft has had its turn."""
        self._last[vehicle] = frame

    def status(
        self, waiting: Sequence[Frame], sources: Mapping[Aircraft, SourceReport], now_s: float
    ) -> tuple[AircraftStatus, ...]:
        """Each aircraft at the monotonic time `now_s`; `waiting`: the frames whose turn has not come."""
        if not self._several:
            return ()
        accounts = self._ledger.accounts_of_aircraft()
        # Those of the ledger too: one that has flown may have landed before a resumed flight went on.
        systems = set(self._counted()) | {vehicle for vehicle in sources if vehicle is not None} | accounts.keys()
        return tuple(
            AircraftStatus(
                system=system,
                source=sources.get(system),
                behind=_behind([frame for frame in waiting if frame.vehicle == system], now_s),
                last_frame=self._last.get(system),
                **({"accounts": accounts[system]} if system in accounts else {}),
            )
            for system in sorted(systems)
        )


def _behind(waiting: Sequence[Frame], now_s: float) -> Behind:
    return Behind(frames=len(waiting), seconds=max((now_s - frame.received for frame in waiting), default=0.0))
