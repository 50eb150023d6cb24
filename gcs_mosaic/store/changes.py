"""What a flight has become since it was last saved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

from gcs_mosaic.render.render_list import RenderItem, TileKey
from gcs_mosaic.stitch.graph.placement import Covered, Placement
from gcs_mosaic.stitch.transaction import Kept
from gcs_mosaic.store.ledger import printable
from gcs_mosaic.store.listing import FrameNews
from gcs_mosaic.store.records import CoveredRecord, Estimate, FrameState

NO_AIRCRAFT: Mapping[str, int] = MappingProxyType({})
NO_NEWEST: Mapping[int, str] = MappingProxyType({})


@dataclass
class Changes(Kept):
    """Unsaved changes."""

    states: dict[str, tuple[FrameState, str | None]] = field(default_factory=dict)  # with reason, by frame name
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict)
    sharpness: dict[str, float] = field(default_factory=dict)
    placements: dict[str, Placement] = field(default_factory=dict)
    covered: dict[str, Covered] = field(default_factory=dict)
    painted: dict[str, RenderItem] = field(default_factory=dict)
    tiles: list[frozenset[TileKey]] = field(default_factory=list)  # changed tiles, one set per processing step

    def __bool__(self) -> bool:
        return self.is_public or any((self.sizes, self.painted))

    def news(
        self,
        estimates: Sequence[Estimate],
        newest: str | None,
        newest_of: Mapping[int, str] = NO_NEWEST,
        vehicles: Mapping[str, int] = NO_AIRCRAFT,
    ) -> FrameNews:
        """The frame news for readers; `estimates` are those of the placements, `vehicles` the aircraft of frames, by name."""
        states = self.states.items()
        return FrameNews(
            estimates=estimates,
            covered=[self._record_of(one, vehicles.get(one.name)) for one in self.covered.values()],
            rejected={
                name: printable(reason or "") for name, (state, reason) in states if state is FrameState.REJECTED
            },
            waiting=[name for name, (state, _) in states if state is FrameState.WAITING],
            newest=newest,
            newest_of=newest_of,
        )

    def _record_of(self, covered: Covered, vehicle: int | None) -> CoveredRecord:
        width, height = self.sizes[covered.name]
        return CoveredRecord(
            name=covered.name,
            by=covered.by,
            by_from_frame=covered.by_from_frame,
            width=width,
            height=height,
            vehicle=vehicle,
        )

    @property
    def is_public(self) -> bool:
        """Whether any of it appears in the documents."""
        return any((self.states, self.placements, self.tiles))
