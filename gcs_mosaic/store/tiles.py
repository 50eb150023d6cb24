"""Tile files: `tiles/<island>/<z>/<x>/<y>.jpg`, and a mask in `masks/` for each tile that is not full."""

from __future__ import annotations

import logging
import re
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.render_list import TileKey
from gcs_mosaic.render.tile_cache import full_coverage
from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile
from gcs_mosaic.stitch.arrays import AnyImage, Coverage, ImageBGR
from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import make_folder, write_beside
from gcs_mosaic.store.stages import stage
from gcs_mosaic.store.tile_header import is_tile_sized

logger = logging.getLogger(__name__)

Shown = Callable[[], TilePicture | None]
ReadMask = Callable[[Path, int, Tile], Coverage | None]  # as `read_mask`, or what it read before
PLAIN_NUMBER = re.compile(r"[0-9]{1,9}", re.ASCII)
MCU = 8  # px; block size of a JPEG without chroma subsampling
QUEUE = 32  # tiles waiting to be encoded; each holds 400 kB
LONGEST_WAIT_S = 60.0  # for the disk to accept one tile
LARGEST_BYTES = 4_000_000  # of a tile's file: five times what its pixels take as they are


@dataclass(frozen=True, slots=True, kw_only=True)
class TileSettings:
    """How tiles are encoded and written."""

    jpeg_quality: int = 90  # 0 to 100
    writers: int = 2  # threads


def tile_path(root: Path, island: int, tile: Tile) -> Path:
    """Path of a tile's colours."""
    return root / f"tiles/{island}/{tile.z}/{tile.x}/{tile.y}.jpg"


def mask_path(root: Path, island: int, tile: Tile) -> Path:
    """Path of a tile's coverage mask, if it is not full."""
    return root / f"masks/{island}/{tile.z}/{tile.x}/{tile.y}.png"


class TileWriter:
    """Writes tiles into a flight's folder on a few threads."""

    def __init__(self, root: Path, settings: TileSettings | None = None) -> None:
        self._root = root
        self._settings = settings or TileSettings()
        self._pool = ThreadPoolExecutor(self._settings.writers, thread_name_prefix="tiles")
        self.there: set[TileKey] = set()  # tiles that were written, by this run or an earlier one

    def write(self, keys: Iterable[TileKey], shown: Callable[[int, Tile], Shown]) -> int:
        """Write the tiles of these keys, remove those that show nothing, and return once all is on disk; returns the number of
        tiles that now exist. Raises DiskFull.

        `shown` (`TileCompositor.tile_later`) is called here, its result on one of the threads.
        """
        pending: deque[Future[bool]] = deque()
        present, root = 0, inside.OpenRoot(self._root)
        try:
            for island, tile in keys:
                pending.append(self._pool.submit(self._write_one, island, tile, shown(island, tile), root))
                if len(pending) >= QUEUE:
                    present += _finished(pending)
            while pending:
                present += _finished(pending)
        finally:
            _abandon(pending, root)
        return present

    def close(self) -> None:
        self._pool.shutdown()

    def _write_one(self, island: int, tile: Tile, shown: Shown, root: inside.OpenRoot) -> bool:
        picture = shown()
        if picture is None:
            remove_tile(root, island, tile)
            self.there.discard((island, tile))
        else:
            with stage("encode", f"{island}/{tile.z}/{tile.x}/{tile.y}"):
                write_tile(root, island, tile, picture, self._settings.jpeg_quality)
            self.there.add((island, tile))
        return picture is not None


def write_tile(root: inside.Root, island: int, tile: Tile, picture: TilePicture, jpeg_quality: int) -> None:
    """Write a tile and its mask, each atomically. Raises DiskFull."""
    flight = inside.path_of(root)
    path, mask = tile_path(flight, island, tile), mask_path(flight, island, tile)
    full = _is_full(picture.coverage)
    if not full:
        # Before the colours, because a tile without a mask counts as full.
        _put(mask, encode_mask(picture.coverage), root)
    _put(path, encode_jpeg(picture.colour, picture.coverage, jpeg_quality), root)
    if full:
        inside.remove(mask, root)


def remove_tile(root: inside.Root, island: int, tile: Tile) -> None:
    """Remove a tile and its mask, if present."""
    # The mask last, because a tile without a mask counts as full.
    flight = inside.path_of(root)
    inside.remove(tile_path(flight, island, tile), root)
    inside.remove(mask_path(flight, island, tile), root)


def tiles_in(root: Path) -> Iterator[TileKey]:
    """All tiles on disk; other files are skipped, and what links lead to."""
    return keys_of(pictures_in(root, "tiles", ".jpg"))


def pictures_in(root: Path, kind: str, suffix: str) -> Iterator[Path]:
    """All files `<kind>/<island>/<z>/<x>/<y><suffix>` on disk, for `tiles` or `masks`."""
    for path in inside.files(root / kind, root, deepest=3):
        if path.suffix == suffix and len(path.relative_to(root).parts) == 5:
            yield path


def keys_of(paths: Iterable[Path]) -> Iterator[TileKey]:
    """Of tiles or masks; files of other names are skipped."""
    for path in paths:
        named = (*path.parts[-4:-1], path.stem)
        if all(PLAIN_NUMBER.fullmatch(part) for part in named):
            island, z, x, y = map(int, named)
            yield island, Tile(z, x, y)


def remove_strays(root: Path, known: Collection[TileKey]) -> None:
    """Remove all tiles not in `known`."""
    for island, tile in list(tiles_in(root)):
        if (island, tile) not in known:
            remove_tile(root, island, tile)


def read_mask(root: Path, island: int, tile: Tile) -> Coverage | None:
    """A tile's coverage from disk, `full_coverage(256)` itself if full; None as for `read_tile`."""
    path = mask_path(root, island, tile)
    if not inside.exists(path, root):
        return full_coverage(TILE_SIZE) if inside.is_file(tile_path(root, island, tile), root) else None
    coverage = _decoded(tile_bytes(path, root), cv2.IMREAD_GRAYSCALE)
    return coverage if coverage is not None and coverage.shape == (TILE_SIZE, TILE_SIZE) else None


def read_tile(root: Path, island: int, tile: Tile, masks: ReadMask = read_mask) -> TilePicture | None:
    """A tile from disk; None if it is missing, incomplete, or not a tile."""
    data = tile_bytes(tile_path(root, island, tile), root)
    return None if data is None else decoded_tile(data, lambda: masks(root, island, tile))


def decoded_tile(data: bytes, mask: Callable[[], Coverage | None]) -> TilePicture | None:
    """A tile from its bytes, and its coverage as of `read_mask`; None as for `read_tile`."""
    colour = _decoded(data, cv2.IMREAD_COLOR)
    if colour is None or colour.shape != (TILE_SIZE, TILE_SIZE, 3):
        return None
    coverage = mask()
    if coverage is None or coverage is full_coverage(TILE_SIZE):
        return None if coverage is None else TilePicture(colour, coverage)
    return TilePicture(np.asarray(cv2.copyTo(colour, coverage), dtype=np.uint8), coverage)


def encode_jpeg(colour: ImageBGR, coverage: Coverage, quality: int) -> bytes:
    """JPEG bytes without chroma subsampling, so that a small red object on green keeps its colour."""
    filled = colour if _is_full(coverage) else _border_blocks_filled(colour, coverage)
    sampling = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    return encode(".jpg", filled, [cv2.IMWRITE_JPEG_QUALITY, quality, *sampling])


def _is_full(coverage: Coverage) -> bool:
    return coverage is full_coverage(TILE_SIZE) or int(coverage.min()) == 255


def encode_mask(coverage: Coverage) -> bytes:
    """PNG bytes of a tile's coverage. A compression that is asked for lets libpng try all filters on each row, which takes four
    times as long and makes such masks larger."""
    return encode(".png", coverage, [])


def _put(path: Path, data: bytes, root: inside.Root) -> None:
    try:
        write_beside(path, data, root=root)
    except FileNotFoundError:
        make_folder(path.parent, root)
        write_beside(path, data, root=root)


def _border_blocks_filled(colour: ImageBGR, coverage: Coverage) -> ImageBGR:
    """Fill uncovered pixels of partly covered blocks with the block's mean colour: black beside colour would ring."""
    size = colour.shape[1] // MCU, colour.shape[0] // MCU
    share = cv2.resize((coverage > 0).astype(np.float32), size, interpolation=cv2.INTER_AREA)
    mean = cv2.resize(colour, size, interpolation=cv2.INTER_AREA) / np.maximum(share, 1 / MCU**2)[..., None]
    blocks = cv2.resize(mean.clip(0, 255).astype(np.uint8), colour.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    return np.asarray(cv2.copyTo(colour, coverage, blocks), dtype=np.uint8)


def encode(suffix: str, image: AnyImage, parameters: list[int]) -> bytes:
    """The bytes of an image file. Raises ValueError if OpenCV cannot encode it."""
    done, data = cv2.imencode(suffix, image, parameters)
    if not done:
        raise ValueError(f"an image of shape {image.shape} cannot be written as {suffix}")
    return bytes(data)


def tile_bytes(path: Path, root: Path) -> bytes | None:
    """What is in a file of a tile or mask; None if there is none that can be read."""
    try:
        return inside.read(path, root, LARGEST_BYTES)
    except FileNotFoundError:
        return None
    except OSError:
        logger.warning("the tile %s cannot be read", path, exc_info=True)
        return None


def _decoded(data: bytes | None, flags: int) -> AnyImage | None:
    """From memory, because OpenCV prints about missing files to the terminal."""
    if not data or not is_tile_sized(data):
        return None
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    return None if image is None else np.asarray(image, dtype=np.uint8)


def _abandon(pending: deque[Future[bool]], root: inside.OpenRoot) -> None:
    """Begin none of these tiles any more; close the folders once those are done that have begun."""
    begun = [future for future in pending if not future.cancel()]
    if not wait(begun, LONGEST_WAIT_S).not_done:  # folders that a thread still uses stay open: a lost handful
        root.close()


def _finished(pending: deque[Future[bool]]) -> bool:
    """Remove the future that has waited longest, once done; returns whether its tile now exists."""
    try:
        present = pending[0].result(LONGEST_WAIT_S)
    except TimeoutError:
        raise OSError(f"the disk took no tile for {LONGEST_WAIT_S:.0f} s") from None
    pending.popleft()
    return present
