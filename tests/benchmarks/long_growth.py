"""What a frame of a long flight costs, early and late, everything included: placing, adjusting, painting, tiles, ledger.

The places of frames are found from marks on the ground (`flight_of_points`); all show one picture, so what the map looks like
is of no meaning, but every tile of it is painted and written.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.app.waiting.prefetch import DecodedFrame, thumbnail
from gcs_mosaic.config.tree import Config
from gcs_mosaic.messages import Frame, content_hash
from tests.benchmarks.flight_of_points import LENS, features_of_flight
from tests.benchmarks.writing import EARLY, WINDOW

REPAINTS = 4  # pieces of repainting after each frame, as far as there is any to do: what two seconds leave time for


@dataclass(frozen=True, slots=True)
class Cost:
    """CPU seconds of the process that places and paints: of a frame until it is written, and of repainting after it."""

    frame: float
    repainting: float


def costs_of_flight(frames: int, home: Path) -> Iterator[Cost]:
    """Of each frame of a flight of so many, in turn; `home` is an empty folder."""
    image, out = ground(), home / "mosaic"
    out.mkdir()
    picture = cv2.imencode(".jpg", image)[1].tobytes()
    with closing(Pipeline(out, Config(), lambda notice: None)) as pipeline:
        for number, features in enumerate(features_of_flight(frames)):
            frame = pipeline.accept(brought(number, picture, home))
            assert frame is not None, "no two files are the same"
            start = time.process_time()
            pipeline.process(DecodedFrame(frame, image, features, thumbnail(image), {}))
            pipeline.save()
            done = time.process_time()
            for _ in range(REPAINTS):
                if pipeline.has_repaints and pipeline.repaint_some():
                    pipeline.save()
            yield Cost(done - start, time.process_time() - done)


def growth_lines(frames: int, home: Path) -> Iterator[str]:
    """Late frames against early ones."""
    found = list(costs_of_flight(frames, home))
    cost, repainting = (np.array([getattr(one, name) for one in found]) for name in ("frame", "repainting"))
    early, late = slice(*EARLY), slice(frames - WINDOW, frames)
    medians = float(np.median(cost[early])), float(np.median(cost[late]))
    means = float(repainting[early].mean()), float(repainting[late].mean())
    yield (
        f"frames {frames - WINDOW} to {frames}: median {medians[1]:.3f} s of CPU, {medians[1] / medians[0]:.2f} times frames "
        f"{EARLY[0]} to {EARLY[1]}; repainting {means[1]:.3f} and {means[0]:.3f} s a frame besides"
    )


def brought(number: int, picture: bytes, home: Path) -> Frame:
    """The picture as a file of its own: with its number in a comment."""
    data = picture[:2] + b"\xff\xfe\x00\x0a" + b"%08d" % number + picture[2:]
    path = home / f"IMG_{number:05}.JPG"
    path.write_bytes(data)
    now = time.monotonic()
    return Frame(name=path.name, path=path, content_hash=content_hash(data), size=len(data), received=now, modified=now)


def ground() -> NDArray[np.uint8]:
    """A picture (h, w, 3) with something to see at every size."""
    rng, size = np.random.default_rng(1), (LENS.width, LENS.height)
    layers = [rng.normal(0, 12, (LENS.height // coarse, LENS.width // coarse, 3)) for coarse in (1, 4, 16, 64)]
    picture = sum(cv2.resize(layer, size, interpolation=cv2.INTER_CUBIC) for layer in layers)
    return np.asarray(np.clip(np.asarray(picture) + 128, 0, 255), np.uint8)
