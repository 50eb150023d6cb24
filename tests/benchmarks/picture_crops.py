"""The crops of the page of figures of the picture, before and after, from simulated flights that anybody can fly.

python -m tests.benchmarks.picture_crops .readme
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.debug.sheet import Sheet
from gcs_mosaic.render.repaint_queue import PaintSettings
from sitl.camera import Camera
from sitl.flight import plan
from sitl.path import Plan
from sitl.sensor import Sensor
from sitl.targets import Crowd
from tests.benchmarks.painted_flights import PlacedFlight, Window, painted_map, place_in_level, shown, simulated
from tests.benchmarks.picture import busy_flight, without_gains
from tests.benchmarks.picture_measures import detail, shown_share, transparent_share
from tests.benchmarks.picture_places import Frames, Sight, frames_alone, sights, squares
from tests.benchmarks.picture_references import alpha

Colours = NDArray[Any]
Panel = tuple[str, Colours]

GAP, CAPTION = 8, 24  # px
QUALITY = 86  # of the JPEGs
WIDE = 1100, 700  # px of the map shown where brightness is judged, at less than half the size
CLOSE = 150  # px of the map shown where detail is judged
HILLY = 0.5  # share of the heights of hills, houses and trees: at all of it steep views of crowns are smeared
PANEL = 400  # px: width of one panel of two or three


def main() -> None:
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder = Path(sys.argv[1])
    busy = simulated(busy_flight())
    made = {
        "exposure": exposure(busy),
        "vignetting": vignetting(),
        **close_up(),
        "ghosts": ghosts(busy),
        "bands": bands(),
    }
    for name, panels in made.items():
        path = folder / f"picture-{name}.jpg"
        path.write_bytes(side_by_side(panels))
        print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


def exposure(flight: PlacedFlight) -> list[Panel]:
    """Automatic exposure in steps of 2x."""
    raw = without_gains(newest(PaintSettings()))
    return [("exposure steps of 2x as taken", middle(flight, raw)), ("gcs-mosaic", middle(flight, PaintSettings()))]


def vignetting() -> list[Panel]:
    """A lens that loses half of its light in the corners."""
    camera = Camera(vignetting=0.5)
    flight = simulated(plan("survey", (1200, 900), route=Plan(frames=24, height=100), camera=camera))
    raw = without_gains(newest(PaintSettings()))
    return [("corners half as bright, as taken", middle(flight, raw)), ("gcs-mosaic", middle(flight, PaintSettings()))]


def close_up() -> dict[str, list[Panel]]:
    """Hills, houses and trees, stitched: where the paper's blend loses most detail, and most of a mark of 6x6 px."""
    flown = plan("survey", (1200, 900), route=Plan(frames=12, height=80), relief=HILLY, crowd=Crowd(marks=40))
    flight, settings = simulated(flown, registered=True), PaintSettings()
    assert flight.truth is not None
    with painted_map(flight, settings) as painted:
        seen = sights(flight.truth, painted.frames)
        taken = [sight.window for sight in seen]
        windows = [
            one for square in squares(painted.frames, 60) for one in parts(square) if not any(map(one.meets, taken))
        ]
        frames = frames_alone(flight, painted.frames, settings, [*windows, *taken], seen)
        window = min((one for one in windows if len(frames.by_window[one]) > 1), key=lambda one: kept(frames, one))
        maps = {sight: shown(painted.canvas, sight.window).colour for sight in seen}
        mark = min((sight for sight in seen if is_best(frames, sight)), key=lambda sight: paleness(frames, sight))
        best = max((one for _, one in frames.by_window[window]), key=lambda one: float(one.weight.mean()))
        sharpness = [
            ("the best frame alone", best.colour),
            ("the paper's alpha blend", blended(frames, window)),
            ("gcs-mosaic", shown(painted.canvas, window).colour),
        ]
        return {"sharpness": sharpness, "target": compared(frames, maps, mark)}


def ghosts(flight: PlacedFlight) -> list[Panel]:
    """A vehicle that drives between frames."""
    settings = PaintSettings()
    assert flight.truth is not None
    with painted_map(flight, settings) as painted:
        seen = [sight for sight in sights(flight.truth, painted.frames) if sight.kind == "vehicle"]
        frames = frames_alone(flight, painted.frames, settings, [sight.window for sight in seen], seen)
        maps = {sight: shown(painted.canvas, sight.window).colour for sight in seen}
    return compared(frames, maps, max(seen, key=lambda sight: ghostly(frames, maps, sight)))


def bands() -> list[Panel]:
    """A thermal camera's frames: one band of 16 bits, with a few hundred counts of contrast far above zero."""
    camera = Camera(sensor=Sensor(bands=1, depth=16))
    flight = simulated(plan("survey", (1200, 900), route=Plan(frames=12, height=100), camera=camera))

    def high_bytes(name: str) -> Colours:
        return (flight.load(name) >> 8).astype(np.uint8)

    return [
        ("one band of 16 bits, the upper 8 shown", middle(replace(flight, load=high_bytes), PaintSettings())),
        ("gcs-mosaic", middle(flight, PaintSettings())),
    ]


def is_best(frames: Frames, sight: Sight) -> bool:
    """Whether no frame sees the target's place more centrally."""
    alone = frames.by_window[sight.window]
    return max(alone, key=lambda one: float(one[1].weight.mean()))[0] == sight.frame


def paleness(frames: Frames, sight: Sight) -> float:
    """How much of a mark's contrast the paper's blend keeps."""
    frame, bare = dict(frames.by_window[sight.window])[sight.frame].colour, frames.bare[sight].colour
    return shown_share(blended(frames, sight.window), frame, bare)


def compared(frames: Frames, maps: dict[Sight, Colours], sight: Sight) -> list[Panel]:
    return [
        ("the frame that saw it", dict(frames.by_window[sight.window])[sight.frame].colour),
        ("the paper's alpha blend", blended(frames, sight.window)),
        ("gcs-mosaic", maps[sight]),
    ]


def ghostly(frames: Frames, maps: dict[Sight, Colours], sight: Sight) -> float:
    """How transparent the paper's blend makes a target that the map shows whole."""
    frame, bare = dict(frames.by_window[sight.window])[sight.frame].colour, frames.bare[sight].colour
    whole = shown_share(maps[sight], frame, bare) > 0.9
    return transparent_share(blended(frames, sight.window), frame, bare) if whole else -1.0


def kept(frames: Frames, window: Window) -> float:
    alone = [one for _, one in frames.by_window[window]]
    found = detail(
        alpha(alone), [one.colour for one in alone], [one.covered for one in alone], [one.weight for one in alone]
    )
    return found.kept if found.of_map.size else float("inf")


def blended(frames: Frames, window: Window) -> Colours:
    return alpha([one for _, one in frames.by_window[window]])


def parts(square: Window) -> list[Window]:
    """A square cut into pieces that are looked at closely."""
    starts = range(0, square.width - CLOSE + 1, CLOSE)
    return [replace(square, x=square.x + i, y=square.y + j, width=CLOSE, height=CLOSE) for i in starts for j in starts]


def middle(flight: PlacedFlight, settings: PaintSettings) -> Colours:
    """The map around the middle frame of a flight."""
    with painted_map(flight, settings) as painted:
        frame = painted.frames[flight.placements[len(flight.placements) // 2].name]
        x, y = place_in_level(frame, frame.camera.centre[None])[0]
        window = Window(frame.island, frame.level, round(x) - WIDE[0] // 2, round(y) - WIDE[1] // 2, *WIDE)
        return shown(painted.canvas, window).colour


def newest(settings: PaintSettings) -> PaintSettings:
    """Each frame over those before it, as it is."""
    return replace(settings, canvas=replace(settings.canvas, blend="newest"))


def side_by_side(panels: Sequence[Panel]) -> bytes:
    """A JPEG of pictures of one size with their captions above them; small ones enlarged pixel by pixel."""
    height, width = panels[0][1].shape[:2]
    size = PANEL, round(PANEL * height / width)
    how = cv2.INTER_AREA if width > PANEL else cv2.INTER_NEAREST
    sheet = Sheet(GAP + len(panels) * (PANEL + GAP), size[1] + CAPTION + GAP)
    for k, (caption, picture) in enumerate(panels):
        x = GAP + k * (PANEL + GAP)
        sheet.words((x, CAPTION - 8), caption)
        grey_levels = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
        sheet.paste(np.asarray(cv2.resize(grey_levels, size, interpolation=how), np.uint8), x, CAPTION)
    done, data = cv2.imencode(".jpg", sheet.picture(), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    assert done
    return bytes(data)


if __name__ == "__main__":
    main()
