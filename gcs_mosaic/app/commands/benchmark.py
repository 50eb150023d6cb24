"""`gcs-mosaic benchmark`: cost of a frame on this machine, stage by stage, at full, half and quarter size.

During a flight, decoding and feature extraction run ahead on other cores; here they are included, so the sum is the
total cost of a frame. Frames are processed one after another, with nothing else running.
"""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from gcs_mosaic.app.commands.batch import STAGES
from gcs_mosaic.app.pipeline.driver import Driver
from gcs_mosaic.app.pipeline.pipeline import Done, Pipeline
from gcs_mosaic.app.waiting.prefetch import prepare
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.directory import frames_in
from gcs_mosaic.messages import Frame

SCALES = (1.0, 0.5, 0.25)


def run(sources: Sequence[Path], config: Config, console: Console, most: int | None = None) -> None:
    """Stitch the frames (the first `most` of them) at each scale into a temporary folder; print a table."""
    given = frames_in(sources, config.frames)
    frames = [item for item in given.frames if isinstance(item, Frame)][:most]
    table = Table("scale", *(f"{stage} s" for stage in STAGES), "sum s", title=f"median of {len(frames)} frames")
    for scale in SCALES:
        console.print(f"at {scale:.0%} of the size ...")
        with tempfile.TemporaryDirectory(prefix="gcs-mosaic-benchmark-") as folder:
            done = _stitch(frames, Path(folder), replace(config, scale=scale))
        medians = [statistics.median(d.seconds[stage] for d in done if stage in d.seconds) for stage in STAGES]
        table.add_row(f"{scale:.0%}", *(f"{m:.3f}" for m in medians), f"{sum(medians):.3f}")
    console.print(table)


def _stitch(frames: list[Frame], out: Path, config: Config) -> list[Done]:
    pipeline = Pipeline(out, replace(config, originals=replace(config.originals, keep="link")), lambda notice: None)
    with closing(pipeline):
        driver, decoding = Driver(pipeline), (pipeline.features_of, config.reduction, pipeline.feature_pixels)
        load = pipeline.decoders.load_frame
        accepted = (frame for found in frames if (frame := driver.accept(found)) is not None)
        return [driver.process(prepare(frame, *decoding, load=load)) for frame in accepted]
