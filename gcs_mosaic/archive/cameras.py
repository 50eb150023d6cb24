"""Which frames of an archive one camera took: those of one folder, size, number of bands and depth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence

from gcs_mosaic.archive.features import SeenFrame


def by_camera(frames: Sequence[SeenFrame], fewest: int) -> list[Hashable]:
    """Of each frame what it shares with the others of its camera; of a folder with fewer frames than `fewest`, too few to tell
    anything by, with all that are alike in any such folder."""
    cameras = [(one.frame.file.folder, one.facts.size, one.facts.kind) for one in frames]
    counts = Counter(cameras)
    return [camera if counts[camera] >= fewest else camera[1:] for camera in cameras]
