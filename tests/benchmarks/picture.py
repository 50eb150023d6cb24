"""How good the picture of each blending mode is: detail, steps across seams, moving people, small still things.

    python -m tests.benchmarks.picture [FOLDER ...] [--scale 0.25] [--without-gains] [--modes edge,newest] [--each]

FOLDER: a recorded flight, of which detail and steps are told. Without one, a simulated flight with people and vehicles that
move, marks of 6x6 px, automatic exposure in steps of 2x and vignetting; there all is told. Beside the modes stand the mean of
all frames and the paper's own alpha blend.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.render.blend_modes import MODES
from gcs_mosaic.render.light_field import COLUMNS, ROWS
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.repaint_queue import PaintSettings
from sitl.camera import Camera
from sitl.flight import Flight, plan
from sitl.path import Plan
from sitl.targets import Crowd
from sitl.truth import Truth
from tests.benchmarks.painted_flights import PlacedFlight, Window, painted_map, recorded, shown, simulated
from tests.benchmarks.picture_measures import (
    HALF_SHOWN,
    Detail,
    all_detail,
    contrast,
    contrast_kept,
    detail,
    seam_steps,
    shown_share,
    transparent_share,
)
from tests.benchmarks.picture_places import CORE, Frames, Sight, frames_alone, sights, squares
from tests.benchmarks.picture_references import REFERENCES

Colours = NDArray[Any]
SOFT = 3.0  # px that a target's edge is blurred by at most, in its frame and on the way to the map
SQUARES = 40  # of 512 px: enough that another choice of them changes no figure's second digit by much


@dataclass(frozen=True, slots=True)
class Quality:
    """What is known of one mode's map.

    detail: of overlaps. steps: (n,) grey levels. movers: of each person and vehicle by its number, the greatest share of its
    contrast shown anywhere; half, transparent: how many of `places` where one was seen show it by half, and with the ground
    shining through. marks: contrast kept of each still mark. gains: log of each frame's gain and light field times its true
    exposure, less the mean of all, in capture order: 0 where the map is as bright everywhere as the ground is.
    """

    detail: Detail
    steps: NDArray[np.float64]
    movers: dict[int, float]
    places: int
    half: int
    transparent: int
    marks: NDArray[np.float64]
    gains: NDArray[np.float64]

    @property
    def whole(self) -> int:
        """How many movers are shown with all their contrast somewhere."""
        return sum(share >= HALF_SHOWN[1] for share in self.movers.values())

    def __str__(self) -> str:
        told = f"detail {self.detail.kept:6.1%} of the most central frame, {self.detail.kept_of_sharpest:6.1%} of the sharpest"
        if len(self.steps):
            told += f"  steps {self.steps.mean():5.2f}, 95 % {np.quantile(self.steps, 0.95):5.2f} (n={len(self.steps)})"
        if len(self.movers):
            told += f"  movers {self.whole}/{len(self.movers)} shown, worst {min(self.movers.values()):4.0%}"
            told += f"; half there {self.half}, transparent {self.transparent} of {self.places} places"
        if len(self.marks):
            told += f"  marks {self.marks.min():4.0%} at least, median {np.median(self.marks):4.0%}"
        if len(self.gains):
            told += f"  gains right within {np.abs(self.gains).max():.1%}"
        return told


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.picture", allow_abbrev=False)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("--scale", type=float, choices=(1, 0.5, 0.25), default=1, help="size of recorded frames (1)")
    parser.add_argument("--modes", default=",".join(MODES), help=f"some of these ({','.join(MODES)})")
    parser.add_argument("--without-gains", action="store_true", help="brightness as the camera left it")
    parser.add_argument(
        "--registered", action="store_true", help="the simulated flight as it is stitched, not by its truth"
    )
    parser.add_argument("--relief", type=float, default=0.0, help="of the simulated flight (0)")
    parser.add_argument("--seed", type=int, default=1, help="of the simulated flight (1)")
    parser.add_argument("--each", action="store_true", help="tell which people and vehicles are not shown")
    given = parser.parse_args()
    settings = without_gains(PaintSettings()) if given.without_gains else PaintSettings()
    flights = [recorded(folder, round(1 / given.scale)) for folder in given.folders] or [
        simulated(busy_flight(given.relief, seed=given.seed), registered=given.registered)
    ]
    for flight in flights:
        for mode, quality in measured(flight, given.modes.split(","), settings).items():
            print(f"{flight.name:10} {mode:14} {quality}", flush=True)
            if given.each and mode in MODES:
                lost = [number for number, share in quality.movers.items() if share < HALF_SHOWN[1]]
                print(f"  not shown whole anywhere: {', '.join(told(flight, number) for number in lost) or 'nobody'}")


def told(flight: PlacedFlight, number: int) -> str:
    """A target and the frames it was seen in."""
    assert flight.truth is not None
    frames = [
        Path(frame.name).stem for frame in flight.truth.frames if number in {one.target for one in frame.sightings}
    ]
    return f"{flight.truth.targets[number].kind} {number} ({' '.join(frames)})"


def busy_flight(relief: float = 0.0, size: tuple[int, int] = (1200, 900), frames: int = 24, seed: int = 1) -> Flight:
    """People, vehicles and marks below a camera whose exposure steps and whose corners are dark."""
    camera = Camera(exposure_step=2.0, step_every=4, vignetting=0.3)
    crowd = Crowd(people=40, vehicles=6, marks=20)
    return plan(
        "survey", size, seed=seed, route=Plan(frames=frames, height=100), camera=camera, crowd=crowd, relief=relief
    )


def without_gains(settings: PaintSettings) -> PaintSettings:
    """Brightness as the camera left it: no gains, no vignetting taken out."""
    exposure = replace(settings.exposure, least_gain=1.0, most_gain=1.0)
    return replace(settings, exposure=exposure, vignetting=replace(settings.vignetting, sigma=1e-6))


def measured(
    flight: PlacedFlight, modes: Sequence[str], settings: PaintSettings, count: int = SQUARES
) -> dict[str, Quality]:
    """The quality of each of these modes and of all references."""
    found: dict[str, Quality] = {}
    known: dict[str, RenderItem] = {}
    for mode in modes:
        chosen = replace(settings, canvas=replace(settings.canvas, blend=mode))
        with painted_map(flight, chosen) as painted:
            if painted.frames != known:  # most modes paint the same frames with the same gains
                known = painted.frames
                seen = sights(flight.truth, known) if flight.truth else []
                windows = squares(known, count)
                frames = frames_alone(flight, known, chosen, [*windows, *(sight.window for sight in seen)], seen)
            maps: dict[Window, Colours] = {at: shown(painted.canvas, at).colour for at in frames.by_window}
            gains = gain_errors(flight.truth, known) if flight.truth else np.empty(0)
        found[mode] = replace(judged(maps, frames, windows, seen), gains=gains)
    for name, reference in REFERENCES.items():
        maps = {window: reference([one for _, one in alone]) for window, alone in frames.by_window.items()}
        found[name] = judged(maps, frames, windows, seen)
    return found


def judged(maps: dict[Window, Colours], frames: Frames, windows: Sequence[Window], seen: Sequence[Sight]) -> Quality:
    """The quality of a map of which these windows are known."""
    details, steps = [], []
    for window in windows:
        alone = [one for _, one in frames.by_window[window]]
        colours, covered = [one.colour for one in alone], [one.covered for one in alone]
        details.append(detail(maps[window], colours, covered, [one.weight for one in alone]))
        steps.append(seam_steps(maps[window], colours, covered))
    movers, half, transparent = moving(maps, frames, [one for one in seen if one.kind != "mark"])
    return Quality(
        detail=all_detail(details),
        steps=np.concatenate(steps),
        movers=movers,
        places=sum(one.kind != "mark" and one.alone for one in seen),
        half=half,
        transparent=transparent,
        marks=still(maps, frames, [one for one in seen if one.kind == "mark" and one.alone]),
        gains=np.empty(0),
    )


def gain_errors(truth: Truth, painted: dict[str, RenderItem]) -> NDArray[np.float64]:
    """By frame in capture order, as in Quality; of the green channel, over the middle half of the frame: that is what shows."""
    there = [(painted[frame.name], frame.gain) for frame in truth.frames if frame.name in painted]
    logs = np.array([np.log(one.gain[1] * exposure) + light_of(one) for one, exposure in there])
    return np.asarray(logs - logs.mean(), np.float64)


def light_of(painted: RenderItem) -> float:
    """The mean log factor of a frame's light field over its middle half; of the green channel."""
    grid = np.zeros((ROWS, COLUMNS, 3)) if painted.light is None else painted.light.grid
    return float(grid[ROWS // 4 : -(ROWS // 4), COLUMNS // 4 : -(COLUMNS // 4), 1].mean())


def moving(maps: dict[Window, Colours], frames: Frames, seen: Sequence[Sight]) -> tuple[dict[int, float], int, int]:
    """Of each target the greatest share shown anywhere; how many places show one by half; how many transparently."""
    best: dict[int, float] = {}
    half = transparent = 0
    for sight in seen:
        parts = maps[sight.window], *with_and_without(frames, sight)
        share = shown_share(*parts)
        best[sight.target] = max(share, best.get(sight.target, 0.0))
        if sight.alone:
            half += HALF_SHOWN[0] < share < HALF_SHOWN[1]
            transparent += transparent_share(*parts) > 0.5
    return best, half, transparent


def with_and_without(frames: Frames, sight: Sight) -> tuple[Colours, Colours]:
    """A sight's frame in its window, (h, w, 3), with the target alone of all that may stand there, and without."""
    frame, bare = dict(frames.by_window[sight.window])[sight.frame].colour, frames.bare[sight].colour
    y, x = np.mgrid[: sight.window.height, : sight.window.width]
    its_own = np.hypot(x - sight.middle[0], y - sight.middle[1]) <= sight.reach + SOFT
    return np.where(its_own[..., None], frame, bare), bare


def still(maps: dict[Window, Colours], frames: Frames, seen: Sequence[Sight]) -> NDArray[np.float64]:
    """Of each mark the contrast that the map keeps, relative to the frame that sees it best, alone."""
    kept: dict[int, tuple[float, float]] = {}
    for sight in seen:
        frame = dict(frames.by_window[sight.window])[sight.frame]
        weight = float(frame.weight[round(sight.middle[1]), round(sight.middle[0])])
        radius = CORE * sight.frame_pixel
        one, other = (contrast(picture, sight.middle, radius) for picture in (maps[sight.window], frame.colour))
        kept[sight.target] = max(kept.get(sight.target, (-1.0, 0.0)), (weight, contrast_kept(one, other)))
    return np.array([share for _, share in kept.values()])


if __name__ == "__main__":
    main()
