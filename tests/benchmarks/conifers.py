"""People beneath conifers, all the way: files of a thermal flight, own poses, a click, its focus and hints.

    python -m tests.benchmarks.conifers [--hidden D] [--seed SEED] [--kind agc|counts|palette|colour] [--trees conifers|leaves]
                                        [--route grid|line|circle] [--frames N] [--step M] [--in FOLDER]

Of `canopy_files`. Told are the islands of the map, how far its cameras lie from the true ones after one similarity, and for each
person whom ten looks or more see: the focus that a click finds, as a share of the way down to the ground if the focal length
were right (1 is the ground), and the rank of a hint within a metre of him, of eight; and how many hints are of nobody. At last
what own poses cost: the contrast of each person in the mean of the looks at the focus that is best for him, with the poses of the
map and with the true ones. Two minutes of computing for 24 frames.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

import sitl.flight
from gcs_mosaic.errors import UsageError
from gcs_mosaic.integral.focal_plane import camera_height
from gcs_mosaic.integral.forms import mean
from gcs_mosaic.integral.lens_keeper import LensKeeper, LensView, LensWish
from gcs_mosaic.integral.stack import GroundLook, GroundWindow, laid_together
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import FloatImage
from gcs_mosaic.views.flight_view import FlightView, pixels_of
from sitl.targets import Target
from tests.benchmarks.canopy_files import Wood, planned, written
from tests.benchmarks.canopy_own import residual, similarity
from tests.benchmarks.canopy_scene import Floats, Units, true_looks
from tests.benchmarks.canopy_scores import OUTER, contrast

ENOUGH, HINTS, NEAR = 10, 8, 1.0  # looks at a person; hints asked for; metres
CELL = 0.05  # metres
AROUND = np.linspace(-0.15, 0.15, 31)  # shares of the flying height: a step moves looks ten metres apart by 0.1 m


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.conifers", allow_abbrev=False)
    parser.add_argument(
        "--in", dest="folder", type=Path, help="keep the flight and its map here, and use those that are there"
    )
    usual = Wood()
    for name in ("hidden", "step"):
        parser.add_argument(f"--{name}", type=float, default=getattr(usual, name))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--frames", type=int, default=24)
    for name, choices in (
        ("kind", ("agc", "counts", "palette", "colour")),
        ("trees", ("conifers", "leaves")),
        ("route", ("grid", "line", "circle")),
    ):
        parser.add_argument(f"--{name}", choices=choices, default=getattr(usual, name))
    asked = vars(parser.parse_args())
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as folder:
        told(asked.pop("folder") or Path(folder), Wood(**asked))


def told(folder: Path, wood: Wood) -> None:
    """Fly, stitch and look."""
    flight = planned(wood)
    if not (folder / "map").exists():
        written(flight, wood, folder / "frames")
        command = [sys.executable, "-m", "gcs_mosaic", "stitch", str(folder / "frames"), "--out", str(folder / "map")]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    view = FlightView(folder / "map")
    table = view.table()
    islands = Counter(table.islands.tolist())
    island = islands.most_common(1)[0][0]
    print(f"{len(table.frames)} of {wood.frames} frames, on islands of {sorted(islands.values(), reverse=True)}")
    its = [one.number for one, where in zip(table.frames, table.islands.tolist(), strict=True) if where == island]
    painted = [one for number in its if (one := view.painted(number)) is not None]
    units = laid_on_truth(painted, flight)
    true_scale = flight.scene.camera.lens.focal / painted[0].camera.focal / wood.height
    people = np.array([one.place(0.0) for one in flight.scene.targets])
    keeper = LensKeeper(view)
    found = [clicked(keeper, island, painted, people, number, units, true_scale) for number in range(len(people))]
    tried = [one for one in found if one is not None]
    print(f"{sum(one.rank > 0 for one in tried)} of {len(tried)} people are among {HINTS} hints of the lens over them")
    false, hectares = sum(one.false for one in tried), max(sum(one.square_m for one in tried) / 1e4, 1e-9)
    before = sum(one.false_before for one in tried if one.rank)
    print(
        f"{false} hints are of nobody, {false / hectares:.0f} a hectare looked at; {before} stand out more than who was found"
    )
    seen = [one for one, click in zip(flight.scene.targets, found, strict=True) if click is not None]
    tell_cost_of_own_poses(folder / "frames", painted, flight, seen, units)


def laid_on_truth(painted: Sequence[RenderItem], flight: sitl.flight.Flight) -> Units:
    states = {Path(name).name: state for name, state in zip(flight.names, flight.states, strict=True)}
    true = [states[Path(one.name).name] for one in painted]
    canvas = np.array([[one.pose.x, one.pose.y] for one in painted])
    world = np.array([[one.x, one.y] for one in true])
    units = similarity(canvas, world)
    print(
        f"cameras {residual(units, canvas, world):.2f} m from the true ones, focal length {painted[0].camera.focal:.2f}",
        end="",
    )
    print(f" (true {flight.scene.camera.lens.focal:.2f})")
    return units


@dataclass(frozen=True, slots=True)
class Clicked:
    """`rank`: of the hint at a person, 0 for none; hints that are `false`, of nobody, and of these `false_before` his; how many
    metres square the lens is."""

    rank: int
    false: int
    false_before: int
    square_m: float


def clicked(
    keeper: LensKeeper,
    island: int,
    painted: Sequence[RenderItem],
    people: Floats,
    number: int,
    units: Units,
    true_scale: float,
) -> Clicked | None:
    """A lens over a person; None where too few looks see him."""
    x, y = units.canvas(*people[number].tolist()).tolist()
    seeing = sum(_sees(one, x, y) for one in painted)
    if seeing < ENOUGH:
        return None
    try:
        seen = keeper.look(LensWish(island=island, x=x, y=y, hints=HINTS, unit_m=units.metres))
    except UsageError as error:
        print(f"  {seeing} looks: {error}")
        return Clicked(0, 0, 0, 0.0)
    away = [np.linalg.norm(people - units.world(one.x, one.y), axis=1) for one in seen.hints]
    rank = next((at for at, one in enumerate(away, 1) if one[number] < NEAR), 0)
    nobody = [bool(one.min() >= NEAR) for one in away]
    known = "known" if seen.focus.known else "as around it" if seen.focus.beside else "a guess"
    way = true_scale * _away(seen, units)
    print(f"  {seeing} looks: focus {way:.2f} of the way down, {known}; hint {rank or 'none'}", flush=True)
    side = seen.lens.window.side * units.metres
    return Clicked(rank, sum(nobody), sum(nobody[: max(rank - 1, 0)]), side * side)


def tell_cost_of_own_poses(
    frames: Path, painted: Sequence[RenderItem], flight: sitl.flight.Flight, people: Sequence[Target], units: Units
) -> None:
    """Medians over people, each at the focus that is best for him: own heights and true ones are not the same."""
    images = {path.name: _grey(path) for path in frames.iterdir()}
    own = [GroundLook(one.name, one.pose, one.camera, images[Path(one.name).name], one.relief) for one in painted]
    known = {Path(one.name).name for one in painted}
    pairs = [one for one in zip(flight.names, flight.states, strict=True) if Path(one[0]).name in known]
    names, states = tuple(name for name, _ in pairs), tuple(state for _, state in pairs)
    part = replace(flight, names=names, states=states)
    pictures = [images[Path(name).name] for name in names]
    true, metres, _ = true_looks(part, pictures)
    focal = flight.scene.camera.lens.focal / painted[0].camera.focal
    contrasts = [
        [_at_best_focus(looks, one, unit, height) for one in people]
        for looks, unit, height in ((own, units, flight.states[0].height / focal / units.metres), (true, metres, 0.0))
    ]
    of_own, of_true = (float(np.median(one)) for one in contrasts)
    each = float(np.median(np.array(contrasts[0]) / contrasts[1]))
    print(f"contrast of a person: {of_own:.2f} with own poses, {of_true:.2f} with true ones; {each:.0%} of it, median")


def _grey(path: Path) -> FloatImage:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, "it was written by this program"
    bands: FloatImage = image.reshape(*image.shape[:2], -1).astype(np.float32)
    return np.asarray(bands.mean(axis=2, keepdims=True))


def _at_best_focus(looks: Sequence[GroundLook], person: Target, units: Units, below: float) -> float:
    """Contrast in the mean at the best of many heights around the ground. `below`: canvas units from the cameras down to it, as
    far as the focal length is right; 0: it is the map's."""
    x, y = units.canvas(*person.place(0.0)).tolist()
    above = float(np.median([camera_height(one.pose, one.camera) for one in looks]))
    window = GroundWindow(x, y, 2 * OUTER / units.metres, round(2 * OUTER / CELL))
    ground = above - below if below else 0.0
    return max(contrast(mean(laid_together(looks, window, ground + one * above)), CELL) for one in AROUND)


def _away(seen: LensView, units: Units) -> float:
    """Metres from the cameras down to what is in focus."""
    return seen.lens.flying_height * (1 - seen.height) * units.metres


def _sees(one: RenderItem, x: float, y: float) -> bool:
    at = pixels_of(one, np.array([[x, y]]))[0]
    return bool(((at > 0) & (at < [one.camera.width, one.camera.height])).all())


if __name__ == "__main__":
    main()
