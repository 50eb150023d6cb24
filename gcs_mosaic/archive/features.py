"""Stage 2: features, thumbnail and facts of each frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from gcs_mosaic.app.waiting.prefetch import UndecodableFrame, prepare_or_raise
from gcs_mosaic.archive.arrivals import ArchiveFrame, bytes_of_file
from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.decoding import limited
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.sources import SourceFile
from gcs_mosaic.archive.tasks import Parts, Passing, Unmade, task
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.decode import Unreadable, load_frame
from gcs_mosaic.frames.decoding.limits import DecodeSettings, refusal
from gcs_mosaic.frames.structure import Whole
from gcs_mosaic.messages import Frame, content_hash
from gcs_mosaic.render.counts_range import Sketch, sketch_of
from gcs_mosaic.stitch.arrays import Bands, Descriptors
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER, DeadBorder
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract, model_digest, without_border
from gcs_mosaic.stitch.features.retrieval import PER_FRAME

TOGETHER = 32  # frames of one batch
KEPT = 256  # frames' features that a worker keeps at hand: 120 MB
Size = tuple[int, int]  # width, height


@dataclass(frozen=True, slots=True)
class FrameFacts:
    """What is known of a frame without its picture: the size as taken and as painted, its bands and their depth."""

    size: Size
    painted: Size
    bands: int
    depth: str
    features: int
    scale: float
    sharpness: float
    faint: bool  # whether its picture is so faint that a fixed pattern may show more than the ground
    counts: Sketch = ()  # of a frame of counts: their quantiles

    @property
    def kind(self) -> tuple[Size, int, str]:
        """Frames of one kind are shown alike, and have the same dead border."""
        return self.painted, self.bands, self.depth


@dataclass(frozen=True, slots=True)
class SeenFrame:
    """A frame with the keys of its features and, once it was looked at, of what painting wants to know of it."""

    frame: ArchiveFrame
    key: str
    facts: FrameFacts
    blend_maps: str = ""


@dataclass(frozen=True, slots=True)
class SetAside:
    """A frame that takes no part, and why; `damaged`: it cannot be decoded."""

    frame: ArchiveFrame
    reason: str
    damaged: bool


def features_of(
    engine: Engine, frames: Sequence[ArchiveFrame], config: Config
) -> tuple[list[SeenFrame], list[SetAside]]:
    """The frames with features, and those that take no part, each in order."""
    settings = config.stitch.features, config.reduction, config.frames.max_pixels, model_digest(config.stitch.features)
    aside = _too_large(frames, config.decode)
    refused = {one.frame.content_hash for one in aside}
    frames = [frame for frame in frames if frame.content_hash not in refused]
    tasks = [task(features, frame.content_hash, *settings, hints=(frame.file, config.decode)) for frame in frames]
    seen = list[SeenFrame]()
    for frame, one, outcome in zip(frames, tasks, engine.run("features", tasks, TOGETHER), strict=True):
        if isinstance(outcome, Unmade):
            aside.append(SetAside(frame, outcome.reason, outcome.damaged))
        elif isinstance(outcome.summary, str):
            aside.append(SetAside(frame, outcome.summary, damaged=True))
        else:
            seen.append(SeenFrame(frame, one.key, outcome.summary))
    return seen, aside


def _too_large(frames: Sequence[ArchiveFrame], settings: DecodeSettings) -> list[SetAside]:
    """Those refused by their headers, as in a flight: several times as large as the largest before."""
    aside, largest = list[SetAside](), 0
    for frame in frames:
        reason = refusal(Whole(*frame.size), largest, None, settings)
        if reason is not None:
            aside.append(SetAside(frame, reason, damaged=True))
        else:
            largest = max(largest, frame.size[0] * frame.size[1])
    return aside


def features(
    artefacts: Artefacts,
    digest: str,
    settings: FeatureSettings,
    reduction: int,
    max_pixels: int,
    model: str | None,
    file: SourceFile,
    limits: DecodeSettings,
) -> Parts:
    """A frame's facts, its features with and without descriptors, the strongest of those, and its thumbnail; or why it cannot be
    decoded. `model`: digest of the learned model's file, so that another file gives other features. Raises Passing."""
    find, load = partial(extract, settings=settings), limited(limits, max_pixels)
    found = prepare_or_raise(frame_at(file, digest), find, reduction, settings.megapixels * 1e6, load=load)
    if isinstance(found, UndecodableFrame):
        if found.passing:
            raise Passing(found.reason, damaged=True)
        return {"summary": found.reason}
    seen, image = found.features, found.image
    facts = FrameFacts(
        size=(seen.width, seen.height),
        painted=(image.shape[1], image.shape[0]),
        bands=image.shape[2],
        depth=str(image.dtype),
        features=len(seen),
        scale=seen.scale,
        sharpness=seen.sharpness,
        faint=seen.faint is not None,
        counts=() if image.dtype == np.uint8 else sketch_of(image),
    )
    return {"summary": facts, **parts_of(seen), "thumbnail": found.thumbnail}


def parts_of(seen: Features) -> dict[str, object]:
    """Of an artefact: features with and without what is large, and the strongest descriptors."""
    places = replace(seen, kept_descriptors=seen.descriptors[:, :0], kept_faint=None, kept_texture=None, learned=None)
    parts = {"places": places, "descriptors": seen.descriptors, "faint": seen.faint, "texture": seen.texture}
    parts["learned"] = seen.learned
    return parts | {"strongest": seen.descriptors[:PER_FRAME]}


def frame_at(file: SourceFile, digest: str) -> Frame:
    """The frame that a file held when it was looked at first, with its bytes. Raises Passing if it is another one by now."""
    try:
        data = bytes_of_file(file)
    except Passing as error:
        raise Passing(f"{file.name} {error}") from None
    if content_hash(data) != digest:
        raise Passing(f"{file.name} has changed since it was read first")
    return frame_of_file(file, digest, data)


def frame_of_file(file: SourceFile, digest: str, data: bytes | None = None) -> Frame:
    """The frame of a file whose content is known to be this; `data`: it, if at hand."""
    return Frame(
        name=file.name,
        path=Path(file.path),
        content_hash=digest,
        size=file.size,
        received=0.0,
        modified=file.modified_ns / 1e9,
        data=data,
    )


def image_of(file: SourceFile, digest: str, reduction: int, max_pixels: int) -> Bands | None:
    """A frame's pixels as painted; None if it cannot be decoded. Raises Passing."""
    image = load_frame(frame_at(file, digest), max_pixels, reduction)
    if not isinstance(image, Unreadable):
        return image
    if image.passing:
        raise Passing(f"{file.name}: {image.reason}")
    return None


@lru_cache(KEPT)
def whole_features(artefacts: Artefacts, key: str, dead: DeadBorder = NO_BORDER) -> Features:
    """A frame's features without those at a dead border, which is in its full-resolution pixels. Raises Lost."""
    parts = {f"kept_{part}": artefacts.part(key, part) for part in ("descriptors", "faint", "texture")}
    learned = artefacts.part(key, "learned")
    return without_border(replace(artefacts.part(key, "places"), learned=learned, **parts), dead)


def places_of(artefacts: Artefacts, key: str, dead: DeadBorder) -> Features:
    """As `whole_features`, without descriptors and whatever else is large. Raises Lost."""
    return without_border(artefacts.part(key, "places"), dead)


def strongest_of(artefacts: Artefacts, key: str, dead: DeadBorder) -> Descriptors:
    """A frame's PER_FRAME strongest descriptors, repeated if it has fewer; zeros if it has none. Raises Lost."""
    known: Descriptors
    if dead == NO_BORDER:
        known = artefacts.part(key, "strongest")
    else:
        known = whole_features(artefacts, key, dead).descriptors[:PER_FRAME]
    if not len(known):
        return np.zeros((PER_FRAME, known.shape[1]), known.dtype)
    return np.asarray(known[np.resize(np.arange(len(known)), PER_FRAME)])
