"""Four ways to stitch a folder of frames, each with its times and, as far as it tells, its placements.

    python -m tests.benchmarks.contestants NAME RESULT.json --frames FILE... [--scale 0.25] [--features sift]

A program of its own, because some take more memory or time than there is: what is known so far is in the file at any moment.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.app.waiting.prefetch import prepare
from gcs_mosaic.baseline.mosaic import PaperMosaic
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.decode import Unreadable, load_frame
from gcs_mosaic.frames.directory import frames_in
from gcs_mosaic.messages import Frame
from gcs_mosaic.stitch.graph.placement import Placement
from tests.benchmarks.known_flights import Document, document

Image = NDArray[np.uint8]
STAGES = ("features", "matching", "stitching")


@dataclass(slots=True)
class Result:
    """What came of it so far. `seconds` by stage, and in all; `last`: the same of the last frame alone, where there is such."""

    frames: int = 0  # processed so far
    features: int | None = None  # found in the last frame
    seconds: dict[str, float] = field(default_factory=dict)
    last: dict[str, float] = field(default_factory=dict)
    placements: Document | None = None
    estimated: Document | None = None  # the same as estimated, where the picture is painted otherwise
    refused: list[tuple[int, str]] = field(default_factory=list)  # number of the frame, from 1, and why
    remark: str = ""
    done: bool = False


class Notes:
    """Adds up times and keeps the file of a contestant up to date."""

    def __init__(self, path: Path) -> None:
        self.result = Result()
        self._path = path
        self._start = time.perf_counter()

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.add(stage, time.perf_counter() - start)

    def add(self, stage: str, seconds: float) -> None:
        self.result.last[stage] = self.result.last.get(stage, 0.0) + seconds
        self.result.seconds[stage] = self.result.seconds.get(stage, 0.0) + seconds

    def write(self) -> None:
        """Everything known so far, beside and then renamed: this program may be killed at any moment."""
        self.result.seconds["total"] = time.perf_counter() - self._start
        self.result.last["total"] = sum(self.result.last.get(stage, 0.0) for stage in STAGES)
        beside = self._path.with_suffix(".part")
        beside.write_text(json.dumps(asdict(self.result)))
        beside.replace(self._path)


@dataclass(frozen=True, slots=True)
class Task:
    frames: Sequence[Frame]
    config: Config

    def images(self) -> Iterator[tuple[str, Image]]:
        for frame in self.frames:
            image = load_frame(frame, reduction=self.config.reduction)
            assert not isinstance(image, Unreadable), image.reason
            yield frame.name, image


def paper(task: Task, notes: Notes) -> None:
    """The paper's recipe, literally; one picture in memory."""
    mosaic = PaperMosaic(task.config.paper, task.config.reduction)
    for number, (name, image) in enumerate(task.images(), 1):
        notes.result.last = {}
        with notes.timed("features"):
            features = mosaic.features_of(image)
        outcome = mosaic.place(features, name)
        if isinstance(outcome, Placement):
            mosaic.paint(image, name)
        else:
            notes.result.refused.append((number, outcome.reason))
        for stage, seconds in mosaic.seconds.items():
            notes.add(stage, seconds)
        notes.result.features, notes.result.frames = len(features), number
        notes.result.placements = plain_document({p.name: p.canvas_from_frame for p in mosaic.placements()})
        notes.write()


def adjusted(task: Task, notes: Notes) -> None:
    """The default method, as `gcs-mosaic stitch` runs it: tiles, ledger and final painting on disk."""
    linking = replace(task.config, originals=replace(task.config.originals, keep="link"))
    with tempfile.TemporaryDirectory() as folder:
        pipeline = Pipeline(Path(folder), linking, lambda notice: None, punctual=True)
        for number, found in enumerate(task.frames, 1):
            frame = pipeline.accept(found)
            if frame is None:
                continue
            prepared = prepare(frame, pipeline.features_of, task.config.reduction, pipeline.feature_pixels)
            notes.result.last = {}
            done = pipeline.process(prepared)
            notes.add("features", done.seconds.get("features", 0.0))
            notes.add("matching", done.seconds.get("place", 0.0))
            notes.add("stitching", done.seconds.get("paint", 0.0) + pipeline.save())
            notes.result.frames = number
            notes.write()
        last = dict(notes.result.last)
        with notes.timed("stitching"):
            for _ in pipeline.finish():
                pipeline.save()
            pipeline.save()
        notes.result.last = last
        placements = [p for p in pipeline.mosaic.placements() if isinstance(p, Placement)]
        notes.result.placements = listed(document(placements))
        pipeline.close()
    notes.write()


def opencv_scans(task: Task, notes: Notes) -> None:
    """cv2.Stitcher in SCANS mode; all frames at once."""
    names, images = zip(*task.images(), strict=True)
    stitcher = cv2.Stitcher.create(cv2.Stitcher_SCANS)
    with notes.timed("features"):  # and matching, and adjustment
        state = stitcher.estimateTransform(images)
    if state != cv2.Stitcher_OK:
        notes.result.remark = f"gives up: {STATES.get(state, state)}"
        return
    used = [names[k] for k in np.ravel(stitcher.component()).tolist()]
    scale = stitcher.workScale() / task.config.reduction
    cameras = stitcher.cameras()
    notes.result.frames = len(names)
    tell_of_cameras(notes, used, cameras, scale)
    notes.write()
    with notes.timed("stitching"):
        state, picture = stitcher.composePanorama()
    notes.result.remark = (
        f"{picture.shape[1]} x {picture.shape[0]} px"
        if state == cv2.Stitcher_OK
        else f"gives up: {STATES.get(state, state)}"
    )


def affine_stitcher(task: Task, notes: Notes) -> None:
    """AffineStitcher of the package stitching-headless; all frames at once."""
    from stitching import AffineStitcher

    names, images = zip(*task.images(), strict=True)
    kind = {"sift": "sift", "orb": "orb"}[task.config.features]

    class Telling(AffineStitcher):  # type: ignore[misc]
        """Tells of each step when it is done."""

        def find_features(self, *args: object) -> object:
            with notes.timed("features"):
                return super().find_features(*args)

        def match_features(self, *args: object) -> object:
            with notes.timed("matching"):
                return super().match_features(*args)

        def refine_camera_parameters(self, *args: object) -> object:
            with notes.timed("matching"):
                cameras = super().refine_camera_parameters(*args)
            resolution = self.images.Resolution
            scale = 1 / self.images.get_ratio(resolution.MEDIUM, resolution.FINAL) / task.config.reduction
            used = [names[int(number) - 1] for number in self.images.names]
            tell_of_cameras(notes, used, cameras, scale)
            notes.result.frames = len(names)
            notes.write()
            return cameras

    started = time.perf_counter()
    picture = Telling(detector=kind, crop=False).stitch(list(images))
    spent = notes.result.seconds.get("features", 0.0) + notes.result.seconds.get("matching", 0.0)
    notes.add("stitching", time.perf_counter() - started - spent)
    notes.result.remark = f"{picture.shape[1]} x {picture.shape[0]} px"


STATES = {1: "needs more images", 2: "no homography", 3: "no camera parameters"}
CONTESTANTS: dict[str, Callable[[Task, Notes], None]] = {
    "paper": paper,
    "adjusted": adjusted,
    "opencv-scans": opencv_scans,
    "affine-stitcher": affine_stitcher,
}


def tell_of_cameras(notes: Notes, names: Sequence[str], cameras: Sequence[Any], scale: float) -> None:
    """Where frames lie as OpenCV's affine cameras say, and as its warper paints them.

    scale: registration pixels per full-resolution pixel; each camera's R is registration pixels from those of the mosaic.
    """
    small_from_full = np.array([[scale, 0, scale / 2 - 0.5], [0, scale, scale / 2 - 0.5], [0, 0, 1]])
    pairs = list(zip(names, cameras, strict=True))
    notes.result.placements = plain_document({n: painted_from_source(c.R) @ small_from_full for n, c in pairs})
    notes.result.estimated = plain_document(
        {n: np.linalg.inv(c.R.astype(np.float64)) @ small_from_full for n, c in pairs}
    )


def painted_from_source(affine: NDArray[Any]) -> NDArray[np.float64]:
    """Where OpenCV's affine warper paints the pixels of a picture: homography (3x3), all at registration size.

    affine: a camera's R, 3x3. Painting asks of each pixel of the picture
    where it comes from; the opposite question (`warpPoint`) is answered otherwise by OpenCV 5.0.
    """
    warper, identity = cv2.PyRotationWarper("affine", 1.0), np.eye(3, dtype=np.float32)
    painted = np.array([[0, 0], [1000, 0], [1000, 1000], [0, 1000]], np.float32)
    matrix = np.asarray(affine, np.float32)
    source = np.array([warper.warpPointBackward(tuple(p.tolist()), identity, matrix) for p in painted], np.float32)
    return np.asarray(cv2.getPerspectiveTransform(source, painted))


def plain_document(homographies: dict[str, NDArray[np.float64]]) -> Document:
    """A parsed placements.json with one island."""
    entries = [{"name": n, "island": 0, "canvas_from_frame": h.tolist()} for n, h in homographies.items()]
    return {"frames": entries}


def listed(placements: Document) -> Document:
    """The same with lists in place of arrays, so that it can be written; `known_flights` takes both."""
    for entry in placements["frames"]:
        entry["warp"] = {key: values.tolist() for key, values in entry["warp"].items()}
    return placements


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.contestants", allow_abbrev=False)
    parser.add_argument("name", choices=CONTESTANTS)
    parser.add_argument("result", type=Path)
    parser.add_argument("--frames", type=Path, nargs="+", required=True, metavar="FILE|DIR")
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--features", choices=["sift", "orb", "surf"], default="sift")
    given = parser.parse_args()
    config = replace(Config().with_features(given.features), scale=given.scale)
    config = replace(config, method="paper" if given.name == "paper" else "adjusted")
    frames = [item for item in frames_in(given.frames, config.frames).frames if isinstance(item, Frame)]
    notes = Notes(given.result)
    CONTESTANTS[given.name](Task(frames, config), notes)
    notes.result.done = True
    notes.write()


if __name__ == "__main__":
    main()
