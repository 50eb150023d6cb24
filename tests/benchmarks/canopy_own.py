"""The looks of `canopy` where the map that is made of its frames has the cameras."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence

import numpy as np

import sitl.flight
from gcs_mosaic.integral.stack import GroundLook
from gcs_mosaic.stitch.arrays import FloatImage
from gcs_mosaic.stitch.mosaic import Mosaic
from sitl.targets import Target
from tests.benchmarks.canopy_scene import Floats, Units
from tests.benchmarks.canopy_scores import person_contrast


def own_looks(flight: sitl.flight.Flight, images: Sequence[FloatImage]) -> tuple[list[GroundLook], Units, float]:
    """The looks where the map's own adjustment has the cameras, laid on the true ones for scoring alone."""
    mosaic = Mosaic()
    for name, image in zip(flight.names, images, strict=True):
        mosaic.add(np.repeat(image, 3 // image.shape[2], axis=2).astype(np.uint8), name)
    mosaic.adjust()
    placed, by_name = mosaic.placements(), dict(zip(flight.names, zip(flight.states, images, strict=True), strict=True))
    islands = [one.island for one in placed]
    placed = [one for one in placed if one.island == max(set(islands), key=islands.count)]
    if len(placed) < len(images) / 2:
        sys.exit(f"  own poses: {len(placed)} of {len(images)} frames on one island, too few to look through gaps with")
    looks = [GroundLook(one.name, one.pose, one.camera, by_name[one.name][1], one.relief) for one in placed]
    canvas = np.array([[one.pose.x, one.pose.y] for one in looks])
    world = np.array([[by_name[one.name][0].x, by_name[one.name][0].y] for one in looks])
    units = similarity(canvas, world)
    print(f"  own poses: {len(looks)} of {len(images)} frames on one island, focal {looks[0].camera.focal:.3f}", end="")
    print(f" (true {flight.scene.camera.lens.focal:.3f}), nadirs {residual(units, canvas, world):.2f} m off")
    above = math.exp(np.median([one.pose.log_gsd for one in looks])) * looks[0].camera.focal_px
    heights = np.linspace(-0.25, 0.15, 41) * above
    contrasts = [median_contrast(looks, flight.scene.targets, units, height) for height in heights]
    best = int(np.argmax(contrasts))
    print(f"  focus best at {heights[best] / above:.1%} of the flying height above the map's ground")
    return looks, units, float(heights[best])


def median_contrast(looks: Sequence[GroundLook], targets: Sequence[Target], units: Units, height: float) -> float:
    return float(np.median([person_contrast(looks, one, units, height)[0] for one in targets[::3]]))


def similarity(canvas: Floats, world: Floats) -> Units:
    """The turn, scale and shift that lay points (n, 2) on others best."""
    one, other = (places @ [1, 1j] for places in (canvas, world))
    middle, there = one.mean(), other.mean()
    factor = np.vdot(one - middle, other - there) / np.vdot(one - middle, one - middle)
    shift = there - factor * middle
    turn = np.array([[factor.real, -factor.imag], [factor.imag, factor.real]])
    return Units(turn, np.array([shift.real, shift.imag]))


def residual(units: Units, canvas: Floats, world: Floats) -> float:
    return float(np.sqrt((((canvas @ units.turn.T + units.shift) - world) ** 2).sum(axis=1).mean()))
