"""All settings in one tree, read from YAML. Each room defines its defaults; here they are only assembled."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gcs_mosaic.baseline.mosaic import PaperSettings
from gcs_mosaic.config.layers import settings_of
from gcs_mosaic.config.methods import Method
from gcs_mosaic.config.settings_file import fields_of
from gcs_mosaic.frames.aircraft_source import AircraftSource
from gcs_mosaic.frames.decoding.limits import DecodeSettings
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.mavlink.settings import AircraftIds, Listening
from gcs_mosaic.render.repaint_queue import PaintSettings
from gcs_mosaic.stitch.features.detectors import FeatureKind
from gcs_mosaic.stitch.mosaic import StitchSettings
from gcs_mosaic.store.log import LogSettings
from gcs_mosaic.store.originals import OriginalsSettings
from gcs_mosaic.store.permissions import Readers
from gcs_mosaic.store.tiles import TileSettings
from gcs_mosaic.triggers import PairingSettings
from gcs_mosaic.triggers.shots import ShotSettings
from gcs_mosaic.web.settings import WebSettings

Resume = typing.Literal["auto", "always", "never"]
AnchorBy = typing.Literal["pins", "positions"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Config(Listening):
    """The settings of `gcs-mosaic`. Paths are relative to the working directory."""

    watch: str = "frames"  # folder in which the camera's files appear
    # live stream instead of a folder, such as rtsp://HOST:554/main; auto: as announced by the aircraft; null: none
    rtsp: str | None = None
    source: str | None = None  # frames of an installed extension beside those: NAME or NAME:ADDRESS
    # of several aircraft, each with a folder or a stream of its own; then `watch` and `rtsp` above are not used
    sources: tuple[AircraftSource, ...] = ()
    out: str = "mosaic"  # folder for tiles, ledger and originals
    # go on with the newest flight in `out`: auto: if it was written within `resume_h` with these settings; always; never
    resume: Resume = "auto"
    resume_h: float = 6.0  # hours since its last frame or event for which a flight is the same one
    http: str | None = "127.0.0.1:8470"  # address of the page; null for none
    web: WebSettings = field(default_factory=WebSettings)
    hints: HintSettings = field(default_factory=HintSettings)
    # what lays the map on earth where nobody sets pins: positions: those of the triggers, for showing only; pins: nothing else
    anchor: AnchorBy = "pins"
    method: Method = "adjusted"  # paper: the paper's method, for comparison; fails on long flights
    scale: float = 1.0  # size at which frames are decoded and painted: 1, 0.5 or 0.25; smaller is faster and coarser
    # record received packets for replay to FILE.tlog, or with true to flight.tlog in the output folder; false: do not
    record: bool | str = False
    # who of the computer's users may read what is written: owner, group or all
    permissions: Readers = "owner"
    finish_s: float = 60.0  # time limit for the last frames and the final painting after Ctrl-C
    frames: FolderSettings = field(default_factory=FolderSettings)
    decode: DecodeSettings = field(default_factory=DecodeSettings)
    stream: StreamSettings = field(default_factory=StreamSettings)
    shots: ShotSettings = field(default_factory=ShotSettings)
    pairing: PairingSettings = field(default_factory=PairingSettings)
    stitch: StitchSettings = field(default_factory=StitchSettings)
    paper: PaperSettings = field(default_factory=PaperSettings)
    paint: PaintSettings = field(default_factory=PaintSettings)
    originals: OriginalsSettings = field(default_factory=OriginalsSettings)
    tiles: TileSettings = field(default_factory=TileSettings)
    log: LogSettings = field(default_factory=LogSettings)
    # Where settings come from that are set, by their dotted names; no setting itself.
    origins: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False, metadata={"setting": False})

    def __post_init__(self) -> None:
        if self.scale not in (1, 0.5, 0.25):
            raise ValueError(f"scale: expected 1, 0.5 or 0.25, got {self.scale:g}")
        if self.resume_h < 0:
            raise ValueError(f"resume_h: expected hours, got {self.resume_h:g}")
        named = [source.vehicle for source in self.sources]
        if twice := {vehicle for vehicle in named if named.count(vehicle) > 1}:
            raise ValueError(f"sources: expected one for each aircraft, got more for {min(twice)}")
        if self.link.announce in named:
            raise ValueError(
                f"sources: {self.link.announce} is what we announce ourselves as; give --announce another number"
            )

    @property
    def aircraft(self) -> AircraftIds:
        """The aircraft whose triggers all count; none if a single one is followed, which `link.vehicle` is about alone."""
        if self.link.aircraft == "all":
            return "all"
        return tuple(sorted({*self.link.aircraft, *(source.vehicle for source in self.sources)}))

    def of_source(self, source: AircraftSource) -> Config:
        """A copy whose one source of frames is this."""
        frames = dataclasses.replace(self.frames, cameras=source.cameras or self.frames.cameras)
        return dataclasses.replace(self, watch=source.watch or self.watch, rtsp=source.rtsp, sources=(), frames=frames)

    @property
    def features(self) -> FeatureKind:
        """The features of the selected method."""
        return self.paper.features if self.method == "paper" else self.stitch.features.kind

    def with_features(self, kind: FeatureKind) -> Config:
        """A copy with other features, for either method."""
        features = dataclasses.replace(self.stitch.features, kind=kind)
        stitch = dataclasses.replace(self.stitch, features=features)
        return dataclasses.replace(self, stitch=stitch, paper=dataclasses.replace(self.paper, features=kind))

    @property
    def reduction(self) -> int:
        """Integer factor by which frames are reduced."""
        return round(1 / self.scale)


def shareable(config: Config) -> Config:
    """A copy to be logged or shown: addresses, which may contain passwords, are left out."""
    name, colon, _ = (config.source or "").partition(":")
    source = f"{name}:…" if colon else config.source
    return dataclasses.replace(config, rtsp="…" if config.rtsp else None, source=source)


def changed(config: Config) -> Iterator[str]:
    """The settings that are not the defaults, each with the place that it comes from where that is known."""
    yield from _differences(config, Config(), config.origins)


def _differences(settings: Any, defaults: Any, origins: Mapping[str, str], before: str = "") -> Iterator[str]:
    for name in fields_of(settings):
        value, default, whole = getattr(settings, name), getattr(defaults, name), f"{before}{name}"
        if dataclasses.is_dataclass(value):
            yield from _differences(value, default, origins, f"{whole}.")
        elif value != default:
            yield f"{whole}={value!r}{f' ({origins[whole]})' if whole in origins else ''}"


def configured(given: Path | None) -> Config:
    """The defaults, overridden by the user's file, by the one that is given, and by the environment. Raises UsageError."""
    config, origins = settings_of(Config, given)
    return dataclasses.replace(config, origins=origins)


def told_by(config: Config, names: Iterable[str], where: str) -> Config:
    """A copy in which settings are known to come from somewhere."""
    return dataclasses.replace(config, origins={**config.origins, **dict.fromkeys(names, where)})
