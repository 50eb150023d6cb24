"""Pictures of the frames that are being painted, so that few are decoded more than once."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

from gcs_mosaic.stitch.bands import Bands

LoadImage = Callable[[str], Bands | None]

MOST_BYTES = 160 << 20  # that are kept, but for the last one: four frames of 12 MP


class Originals:
    """The pictures used last. `load(name)` gives a frame's original, or None if it is gone for good."""

    def __init__(self, load: LoadImage) -> None:
        self.load = load
        self._kept: OrderedDict[str, Bands] = OrderedDict()
        self._bytes = 0

    def get(self, name: str) -> Bands | None:
        image = self._kept.get(name)
        image = self.load(name) if image is None else image
        if image is not None:
            self.put(name, image)
        return image

    def __contains__(self, name: str) -> bool:
        return name in self._kept

    def put(self, name: str, image: Bands) -> None:
        self._bytes += 0 if name in self._kept else image.nbytes
        self._kept[name] = image
        self._kept.move_to_end(name)
        while len(self._kept) > 1 and self._bytes > MOST_BYTES:
            self._bytes -= self._kept.popitem(last=False)[1].nbytes

    def clear(self) -> None:
        self._kept.clear()
        self._bytes = 0
