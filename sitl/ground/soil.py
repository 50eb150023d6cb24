"""Paints the soil: parcel labels, colours, patches, rows and wheel tracks."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .raster import SHIFT, Field, Grain, Image, fixed, fixed_length, strips
from .shapes import DIRT, GRASS, STREAM, YARD, Crop, Land

MOST_PARCELS = 250  # labels are bytes; in a larger world parcels share labels
SPECIAL: dict[str, tuple[int, Crop]] = {
    "dirt": (251, DIRT),
    "grass": (252, GRASS),
    "stream": (253, STREAM),
    "yard": (254, YARD),
}
ROWS_PER_TRACK = 14  # rows between wheel tracks
YARD_RADIUS = 13.0  # metres of gravel around a building
VERGE = 3.0  # metres of grass along an asphalt road, both sides together


@dataclass(frozen=True, slots=True)
class Looks:
    """Per label (256): colour, difference to the patch colour (256, 3), row frequency in cycles per pixel, row strength."""

    colour: Field
    drift: Field
    east: Field
    south: Field
    rows: Field


def paint_soil(land: Land, grain: Grain, patches: Field, gsd: float) -> Image:
    """(size, size, 3). Field edges are frayed by displacing each look-up with the noise."""
    size = len(grain)
    labels, looks = draw_labels(land, size, gsd), looks_of(land, gsd)
    picture = np.empty((size, size, 3), np.uint8)
    across = np.arange(size, dtype=np.float32)[None]
    for rows in strips(size):
        down = np.arange(rows.start, rows.stop, dtype=np.float32)[:, None]
        patch = enlarged(patches, size, rows)
        fray = grain[rows].astype(np.float32) * (0.012 / gsd) + patch * (0.35 / gsd)
        index = cv2.remap(labels, across + fray, down - fray, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        picture[rows] = colour_soil(looks, np.asarray(index, np.uint8), (across, down), patch)
    return picture


def draw_labels(land: Land, size: int, gsd: float) -> Image:
    """(size, size): label of the parcel or unpaved way at each pixel."""
    grass, yard = SPECIAL["grass"][0], SPECIAL["yard"][0]
    labels = np.full((size, size), grass, np.uint8)
    for k, parcel in enumerate(land.parcels):
        cv2.fillConvexPoly(labels, fixed(parcel.corners, gsd), k % MOST_PARCELS, cv2.LINE_8, SHIFT)
    for way in land.ways:
        width = max(1, round((way.width + VERGE * (way.kind == "asphalt")) / gsd))
        label = grass if way.kind == "asphalt" else SPECIAL[way.kind][0]
        cv2.polylines(labels, [fixed(way.points, gsd)], False, label, width, cv2.LINE_8, SHIFT)
    for building in land.buildings:
        x, y = fixed(building.centre, gsd).tolist()
        cv2.circle(labels, (x, y), fixed_length(YARD_RADIUS, gsd), yard, -1, cv2.LINE_8, SHIFT)
    return labels


def enlarged(coarse: Field, size: int, rows: slice) -> Field:
    """Rows of a coarse field, upsampled to full size."""
    scale = len(coarse) / size
    matrix = np.array([[scale, 0, 0], [0, scale, rows.start * scale]], np.float32)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    out = cv2.warpAffine(coarse, matrix, (size, rows.stop - rows.start), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(out, np.float32)


def looks_of(land: Land, gsd: float) -> Looks:
    crops, turns = [GRASS] * 256, np.zeros(256)
    for k, parcel in enumerate(land.parcels[:MOST_PARCELS]):
        crops[k], turns[k] = parcel.crop, parcel.row_heading
    for label, crop in SPECIAL.values():
        crops[label] = crop
    tone = 1 + 0.12 * np.sin(np.arange(256) * 2.4)[:, None]  # fields of one crop differ slightly
    colour, patch = (np.array([getattr(crop, name) for crop in crops]) * tone for name in ("colour", "patch"))
    frequency = np.array([gsd / crop.row_spacing for crop in crops])
    strength = np.array([crop.row_strength for crop in crops])
    parts = (colour, patch - colour, -np.sin(turns) * frequency, np.cos(turns) * frequency, strength)
    return Looks(*(part.astype(np.float32) for part in parts))


def colour_soil(looks: Looks, index: Image, place: tuple[Field, Field], patch: Field) -> Image:
    """One strip: label colour blended with its patch colour, darkened along rows and wheel tracks."""
    across, down = place
    phase = looks.east[index] * across + looks.south[index] * down + 0.35 * patch
    rows = looks.rows[index]
    wheels = np.abs((phase / ROWS_PER_TRACK) % 1 - 0.5) < 0.04
    light = 1 + 0.07 * patch + rows * np.sin(phase * np.float32(2 * np.pi)) - 2.2 * rows * wheels
    share = np.clip(0.5 + 0.45 * patch, 0, 1)
    colour = looks.colour[index] + looks.drift[index] * share[..., None]
    return np.asarray(np.clip(colour * light[..., None], 0, 255), np.uint8)
