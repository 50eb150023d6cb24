"""A flight's tiles made again from its ledger and its originals, which know nothing of how it went."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gcs_mosaic.frames.decode import Unreadable, load_image
from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.tiles import TileSettings, TileWriter


def painted_of(out: Path) -> Sequence[RenderItem]:
    """How the ledger says that the frames of the first island are painted."""
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        return ledger.painted(0)


def original(path: Path) -> Bands:
    image = load_image(path)
    assert not isinstance(image, Unreadable)
    return image


def assert_explained(out: Path, scratch: Path, fewest: int = 20) -> None:
    """The tiles and masks of a flight are byte for byte what its ledger and originals say; `scratch` is an empty folder."""
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        originals = {frame.name: out / frame.original for frame in ledger.frames() if frame.original}
    scratch.mkdir(exist_ok=True)
    canvas, writer = TileCompositor(lambda name: original(originals[name])), TileWriter(scratch, TileSettings())
    for one in painted_of(out):
        writer.write(canvas.paint(original(originals[one.name]), one), canvas.tile_later)
    canvas.close()
    writer.close()
    assert len(list((out / "tiles").rglob("*.jpg"))) > fewest
    for folder in ("tiles", "masks"):
        here, there = ({p.relative_to(r): p.read_bytes() for p in (r / folder).rglob("*.*")} for r in (out, scratch))
        assert here == there
