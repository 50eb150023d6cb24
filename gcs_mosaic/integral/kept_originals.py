"""What is made of frames once for all parts of the map that they show: decoded originals, and the slope of their relief."""

from __future__ import annotations

from collections import OrderedDict

from gcs_mosaic.frames.decode import Unreadable
from gcs_mosaic.integral.ground_surface import sloped
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.store.records import FrameRecord
from gcs_mosaic.views.decoding import original_pixels
from gcs_mosaic.views.flight_view import FlightView

KEPT_BYTES = 64 << 20  # 28 of 12 MP, reduced four times; whole ones of so many are read anew for each part
KEPT_SLOPES = 512


class KeptOriginals:
    """For one thread. Those that were read last, by what they hold."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[str, int], Bands] = OrderedDict()
        self._nbytes = 0

    def read(self, view: FlightView, record: FrameRecord, reduction: int) -> Bands | Unreadable:
        """As `original_pixels`; what cannot be read is tried again."""
        key = str(record.content_hash), reduction
        found = self._kept.get(key)
        if found is not None:
            self._kept.move_to_end(key)
            return found
        image = original_pixels(view, record, reduction)
        if not isinstance(image, Unreadable) and image.nbytes <= KEPT_BYTES // 4:
            self._kept[key] = image
            self._nbytes += image.nbytes
            while self._nbytes > KEPT_BYTES:
                self._nbytes -= self._kept.popitem(last=False)[1].nbytes
        return image

    def forget(self) -> None:
        self._kept.clear()
        self._nbytes = 0


class KeptSlopes:
    """For one thread. Frames on the map's ground without its crowns, as long as they lie as they did."""

    def __init__(self) -> None:
        self._kept: OrderedDict[int, tuple[RenderItem, RenderItem]] = OrderedDict()

    def of(self, number: int, painted: RenderItem) -> RenderItem:
        """See `sloped`."""
        kept = self._kept.get(number)
        if kept is None or kept[0] != painted:
            kept = painted, sloped(painted)
            self._kept[number] = kept
            while len(self._kept) > KEPT_SLOPES:
                self._kept.popitem(last=False)
        return kept[1]

    def forget(self) -> None:
        self._kept.clear()
