"""Ground truth of a simulated flight: the true ground positions of every frame's pixels. Stored as truth.json."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .camera import Scene
from .geometry import CameraState, Lens, resolution
from .targets import Sighting, Target, sightings

FORMAT = 2
COLUMNS, ROWS = 9, 7  # grid points of a frame, including its corners
COARSEST = 4.0  # a point is used up to this multiple of the frame's finest metres per pixel; beyond is the horizon


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueFrame:
    """grid_px: (63, 2) pixels, row-major; grid_ground: (63, 2) metres, NaN for sky; grid_height: (63,) metres of the surface
    seen; grid_used: (63,) mask of used points; gsd: metres per pixel at the centre, at most COARSEST times the finest; gain:
    exposure factor, 1 is nominal; sightings: targets fully inside the picture."""

    name: str
    gsd: float
    state: CameraState
    grid_px: NDArray[np.float64]
    grid_ground: NDArray[np.float64]
    grid_height: NDArray[np.float64]
    grid_used: NDArray[np.bool_]
    gain: float = 1.0
    sightings: tuple[Sighting, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """vignetting: share of light lost in the corners, quadratic in the radius."""

    lens: Lens
    frames: tuple[TrueFrame, ...]
    targets: tuple[Target, ...] = ()
    vignetting: float = 0.0

    @property
    def gsd(self) -> float:
        """Metres per pixel of the median frame: the unit of all pixel errors."""
        return float(np.median([frame.gsd for frame in self.frames]))


def true_frame(scene: Scene, state: CameraState, name: str, index: int = 0) -> TrueFrame:
    """Ground truth of frame number `index`."""
    lens = scene.camera.lens
    grid = grid_of(lens)
    ground = scene.ground_from_pixels(state, grid)
    coarseness = resolution(lens, state, np.concatenate([grid, [lens.centre]]))
    heights = scene.surface(ground[:, 0], ground[:, 1]) if scene.relief else 0 * ground[:, 0]
    return TrueFrame(
        name=name,
        gsd=float(np.fmin(coarseness[-1], COARSEST * np.nanmin(coarseness))),
        state=state,
        grid_px=grid,
        grid_ground=np.asarray(ground, np.float64),
        grid_height=np.asarray(heights, np.float64),
        grid_used=counting(lens, state, grid) & scene.world.contains(ground),
        gain=scene.gain(index),
        sightings=tuple(sightings(scene.targets, lens, state, scene.pixels_from_ground)),
    )


def counting(lens: Lens, state: CameraState, pixels: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mask of the pixels (n, 2), a grid over the whole picture, that see ground at a useful resolution."""
    coarseness = resolution(lens, state, pixels)
    with np.errstate(invalid="ignore"):
        return np.asarray(coarseness <= COARSEST * np.nanmin(coarseness), np.bool_)


def grid_of(lens: Lens) -> NDArray[np.float64]:
    x, y = np.meshgrid(np.linspace(0, lens.width - 1, COLUMNS), np.linspace(0, lens.height - 1, ROWS))
    return np.stack([x.ravel(), y.ravel()], axis=1)


def write(truth: Truth, path: Path) -> None:
    frames = [
        {
            "name": frame.name,
            "width": truth.lens.width,
            "height": truth.lens.height,
            "gsd": frame.gsd,
            "state": asdict(frame.state),
            "grid_px": frame.grid_px.tolist(),
            "grid_ground": with_nulls(frame.grid_ground),
            "grid_height": with_nulls(frame.grid_height),
            "grid_used": frame.grid_used.tolist(),
            "gain": frame.gain,
            "sightings": [
                {"target": one.target, "px": one.px.tolist(), "ground": one.ground.tolist()} for one in frame.sightings
            ],
        }
        for frame in truth.frames
    ]
    of_all = {"lens": asdict(truth.lens), "vignetting": truth.vignetting}
    targets = [asdict(target) for target in truth.targets]
    path.write_text(json.dumps({"format": FORMAT, **of_all, "targets": targets, "frames": frames}))


def read(path: Path) -> Truth:
    """Read a truth.json. Raises ValueError if it is none of this format."""
    try:
        data = json.loads(path.read_text())
        if data["format"] != FORMAT:
            raise ValueError(f"format {data['format']}, wanted {FORMAT}")
        return Truth(
            lens=Lens(**data["lens"]),
            frames=tuple(frame_of(entry) for entry in data["frames"]),
            targets=tuple(target_of(entry) for entry in data["targets"]),
            vignetting=float(data["vignetting"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} is not a truth.json of a simulated flight: {error}") from error


def frame_of(entry: dict[str, Any]) -> TrueFrame:
    return TrueFrame(
        name=str(entry["name"]),
        gsd=float(entry["gsd"]),
        state=CameraState(**entry["state"]),
        grid_px=np.array(entry["grid_px"], np.float64),
        grid_ground=np.array(entry["grid_ground"], np.float64),
        grid_height=np.array(entry["grid_height"], np.float64),
        grid_used=np.array(entry["grid_used"], np.bool_),
        gain=float(entry["gain"]),
        sightings=tuple(
            Sighting(target=int(one["target"]), px=np.array(one["px"]), ground=np.array(one["ground"]))
            for one in entry["sightings"]
        ),
    )


def target_of(entry: dict[str, Any]) -> Target:
    return Target(**{**entry, "colour": tuple(entry["colour"])})


def with_nulls(values: NDArray[np.float64]) -> Any:
    """Nested lists with None for NaN, which JSON lacks. `read` restores NaN, as float arrays convert None to it."""
    kept = values.astype(object)
    kept[~np.isfinite(values)] = None
    return kept.tolist()
