"""Images of the frames being painted, cached so that few are decoded more than once."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Executor, Future

from gcs_mosaic.stitch.arrays import Bands

LoadImage = Callable[[str], Bands | None]

MOST_BYTES = 80 << 20  # cached, except for the last one: two frames of 12 MP


MOST_COMING = 2  # being loaded; those not taken by then are no longer needed


class OriginalsCache:
    """The images used last. `load(name)` returns a frame's original, or None if it is gone for good; callable from any thread."""

    def __init__(self, load: LoadImage, pool: Executor) -> None:
        self.load = load
        self._pool = pool
        self._kept: OrderedDict[str, Bands] = OrderedDict()
        self._bytes = 0
        self._coming: dict[str, Future[Bands | None]] = {}  # needed next

    def expect(self, name: str) -> None:
        """Begin to load an original that is needed next, in the background."""
        if name not in self._kept and name not in self._coming:
            self._coming[name] = self._pool.submit(self.load, name)
            while len(self._coming) > MOST_COMING:
                self._coming.pop(next(iter(self._coming)))

    def get(self, name: str) -> Bands | None:
        image = self._kept.get(name)
        if image is None:
            coming = self._coming.pop(name, None)
            image = self.load(name) if coming is None else coming.result()
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
        self._coming.clear()
        self._bytes = 0
