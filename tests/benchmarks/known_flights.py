"""Flights whose true geometry is known: their features, and how far a map of them is from the truth.

A folder with a truth.json is a simulated flight (`sitl.flight.make`). Of a recorded one the reference lies in data/truth beside
the project, under the folder's name; without one it is judged by the positions in its frames, where it has any.
"""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from types import ModuleType
from typing import Any

import cv2
import numpy as np

import sitl.score
import sitl.truth
from gcs_mosaic.app.waiting.prefetch import DecodedFrame, prepare
from gcs_mosaic.export.export import warp
from gcs_mosaic.frames.directory import frames_in
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.messages import Frame
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.mosaic import StitchSettings
from gcs_mosaic.store.flight_store import estimate_of_placement
from tests.benchmarks.exif import position_in
from tests.benchmarks.flown import Flown
from tests.benchmarks.gps_fit import fits

SHARED = Path(__file__).parents[3] / "shared"

Named = tuple[str, Features]
Document = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Result:
    """How good a map is, in pixels of the median frame; NaN what is not known.

    placed: frames that share an island with others; ortho_px: RMS distance from the true place; tracks_*_px: how far two
    frames put one point apart; frames_px: RMS distance from the true place, by frame.
    """

    placed: int
    islands: int
    ortho_px: float
    tracks_median_px: float
    tracks_p95_px: float
    frames_px: dict[str, float]


class RecordedFlight:
    """Judged by structure-from-motion."""

    def __init__(self, folder: Path) -> None:
        self.name = folder.name
        truth = SHARED / "data" / "truth"
        self._scorer = _scorer()
        self._reference = self._scorer.load_ref(truth / f"{self.name}.json")
        self._tracks = truth / f"{self.name}_tracks.npz"
        self._cache: dict[str, Any] = {}  # what the scorer works out of the reference alone

    def judge(self, placements: Document) -> Result:
        found = self._scorer.score(self._reference, placements, self._tracks, self._cache)
        ortho, tracks = found.get("ortho_px"), found.get("pairs_tracks", {}).get("px")
        median, p95 = (tracks["median"], tracks["p95"]) if tracks else (math.nan, math.nan)
        return Result(
            placed=sum(entry["island"] in _shared_islands(placements) for entry in placements["frames"]),
            islands=len(_shared_islands(placements)),
            ortho_px=ortho["rms"] if ortho else math.nan,
            tracks_median_px=median,
            tracks_p95_px=p95,
            frames_px=self._frames_px(found["frames"]),
        )

    def _frames_px(self, frames: dict[str, dict[str, float]]) -> dict[str, float]:
        """The scorer tells it of true ground points in percent of a frame's width."""
        median = self._reference["info"]["gsd_median"]
        unit = {f["name"]: f["width"] * f["gsd"] / median / 100 for f in self._reference["frames"]}
        share = "ortho_rmse_pct_width"
        return {name: frame[share] * unit[name] for name, frame in frames.items() if share in frame}


class SimulatedFlight:
    """Judged by its known truth."""

    def __init__(self, name: str, truth: sitl.truth.Truth) -> None:
        self.name = name
        self._truth = truth

    def judge(self, placements: Document) -> Result:
        found = sitl.score.score(self._truth, placements)
        return Result(
            placed=found.placed,
            islands=found.islands,
            ortho_px=found.ortho_rmse,
            tracks_median_px=found.pair_median,
            tracks_p95_px=found.pair_p95,
            frames_px=self._frames_px(placements),
        )

    def _frames_px(self, placements: Document) -> dict[str, float]:
        islands, _ = sitl.score.islands_of(self._truth, placements)
        laid = [frame for group in islands.values() if len(group) > 1 for frame in sitl.score.lay(group)]
        gsd = self._truth.gsd
        return {f.true.name: sitl.score.root_mean_square(sitl.score.capped(f.distances() / gsd)) for f in laid}


class PositionedFlight:
    """Judged by the GPS positions in its frames: `ortho_px` is what remains of them, in metres; of pairs nothing is known."""

    def __init__(self, folder: Path) -> None:
        self.name = folder.name
        frames = (frame for frame in frames_in([folder], FolderSettings()).frames if isinstance(frame, Frame))
        self._positions = {frame.name: at for frame in frames if (at := position_in(frame.path)) is not None}

    def judge(self, placements: Document) -> Result:
        islands = fits(placements["frames"], self._positions)
        fitted = sum(island.frames for island in islands)
        squares = sum(island.frames * island.rms_m**2 for island in islands)
        shared = _shared_islands(placements)
        return Result(
            placed=sum(entry["island"] in shared for entry in placements["frames"]),
            islands=len(shared),
            ortho_px=math.sqrt(squares / fitted) if fitted else math.nan,
            tracks_median_px=math.nan,
            tracks_p95_px=math.nan,
            frames_px={},
        )


KnownFlight = RecordedFlight | SimulatedFlight | PositionedFlight


def known_flight(folder: Path) -> KnownFlight:
    """The best that is known about a folder of frames."""
    truth = folder / "truth.json"
    if truth.exists():
        return SimulatedFlight(folder.name, sitl.truth.read(truth))
    if (SHARED / "data" / "truth" / f"{folder.name}.json").exists():
        return RecordedFlight(folder)
    return PositionedFlight(folder)


def features_in(folder: Path, settings: FeatureSettings) -> list[Named]:
    """Names and features of all frames of a folder, in order, found at full size."""
    cv2.setNumThreads(1)
    find = partial(extract, settings=settings)
    prepared = (prepare(f, find) for f in frames_in([folder], FolderSettings()).frames if isinstance(f, Frame))
    return [(one.frame.name, one.features) for one in prepared if isinstance(one, DecodedFrame)]


def stitched(frames: Sequence[Named], settings: StitchSettings) -> list[Placement]:
    """What the stitching alone makes of these frames, as at the end of a flight."""
    with Flown(settings) as flown:
        for name, features in frames:
            flown.place(name, features)
        return flown.finish()


def document(placements: Sequence[Placement]) -> Document:
    """Placements as a parsed placements.json with the exact place of a grid of pixels, lens and relief applied."""
    return {
        "frames": [
            {
                "name": placement.name,
                "island": placement.island,
                "canvas_from_frame": placement.canvas_from_frame.tolist(),
                "width": placement.camera.width,
                "height": placement.camera.height,
                "warp": _numbers(warp(estimate_of_placement(placement))),
            }
            for placement in placements
        ]
    }


def base_name(name: str) -> str:
    """A frame's name without its folders."""
    return PurePosixPath(name).name


def _numbers(grid: Document) -> Document:
    """A warp as it is read back from JSON by the scorers: null becomes NaN."""
    return {key: np.array(values, float) for key, values in grid.items()}


def _shared_islands(placements: Document) -> set[int]:
    islands = [entry["island"] for entry in placements["frames"]]
    return {island for island in islands if islands.count(island) > 1}


def _scorer() -> ModuleType:
    """The program that judges recorded flights, as a module."""
    spec = importlib.util.spec_from_file_location("score", SHARED / "tools" / "score.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def read_document(path: Path) -> Document:
    """A placements.json."""
    return dict(json.loads(path.read_text()))
