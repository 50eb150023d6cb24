"""Draws roads, shadows, roofs and tree crowns."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from .raster import SHIFT, Image, fixed, fixed_length, strips
from .shapes import Building, Land, Tree, Way

SUN = np.array([-0.62, -0.45])  # metres of shadow per metre of height, east and south: the sun is in the south-east
SHADE = np.array([0.65, 0.58, 0.55], np.float32)  # relative light in a shadow, BGR: lit by the blue sky


def draw_asphalt(picture: Image, ways: list[Way], gsd: float) -> None:
    """Asphalt roads with a worn centre and a dashed white line."""
    for way in (way for way in ways if way.kind == "asphalt"):
        line = fixed(way.points, gsd)
        for share, colour in ((1.0, (112, 116, 118)), (0.86, (134, 136, 136)), (0.45, (128, 129, 130))):
            cv2.polylines(picture, [line], False, colour, max(1, round(way.width * share / gsd)), cv2.LINE_AA, SHIFT)
        draw_dashes(picture, way, gsd)


def draw_dashes(picture: Image, way: Way, gsd: float) -> None:
    ends = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way.points, axis=0), axis=1))])
    for start in np.arange(0, ends[-1], 9.0):
        stretch = [start, start + 3.0]
        dash = np.stack([np.interp(stretch, ends, way.points[:, axis]) for axis in (0, 1)], axis=1)
        width = max(1, round(0.15 / gsd))
        cv2.polylines(picture, [fixed(dash, gsd)], False, (206, 210, 210), width, cv2.LINE_AA, SHIFT)


def draw_shadows(land: Land, size: int, gsd: float) -> Image:
    """(size, size): shadow mask, 255 in full shadow, with soft edges."""
    shadow = np.zeros((size, size), np.uint8)
    for building in land.buildings:
        corners, _ = building.outline()
        hull = cv2.convexHull(fixed(np.concatenate([corners, corners + SUN * building.height]), gsd))
        cv2.fillConvexPoly(shadow, hull, 255, cv2.LINE_AA, SHIFT)
    for tree in land.trees:
        for lift in (0.35, 0.7):
            x, y = fixed(np.array([tree.x, tree.y]) + SUN * tree.height * lift, gsd).tolist()
            cv2.circle(shadow, (x, y), fixed_length(tree.radius * 0.95, gsd), 255, -1, cv2.LINE_AA, SHIFT)
    return np.asarray(cv2.blur(shadow, (3, 3)), np.uint8)


def dim(picture: Image, shadow: Image) -> None:
    """Apply the shadows, in place."""
    for rows in strips(len(picture)):
        depth = shadow[rows].astype(np.float32)[..., None] / 255
        picture[rows] = (picture[rows] * (1 + (SHADE - 1) * depth)).astype(np.uint8)


def draw_roof(picture: Image, building: Building, gsd: float) -> None:
    """A gable roof: one sunlit half, one shaded half, and the ridge."""
    corners, ridge = building.outline()
    lit = float((corners[3] - corners[0]) @ SUN) < 0
    for a, b, bright in ((0, 1, 0.78 if lit else 1.15), (3, 2, 1.15 if lit else 0.78)):
        face = np.array([corners[a], corners[b], ridge[1], ridge[0]])
        draw_face(picture, face, tuple(int(min(255, c * bright)) for c in building.roof), gsd)
    dark = tuple(int(c * 0.75) for c in building.roof)
    cv2.polylines(picture, [fixed(ridge, gsd)], False, dark, max(1, round(0.25 / gsd)), cv2.LINE_AA, SHIFT)


def draw_face(
    picture: Image, face: np.ndarray[tuple[int, ...], np.dtype[np.float64]], colour: tuple[int, ...], gsd: float
) -> None:
    """Half a roof with rows of tiles and a window."""
    cv2.fillConvexPoly(picture, fixed(face, gsd), colour, cv2.LINE_AA, SHIFT)
    darker = tuple(int(c * 0.88) for c in colour)
    for share in np.arange(0.1, 1.0, 0.12):
        course = np.array([face[0] + share * (face[3] - face[0]), face[1] + share * (face[2] - face[1])])
        cv2.polylines(picture, [fixed(course, gsd)], False, darker, 1, cv2.LINE_AA, SHIFT)
    x, y = fixed(face[0] + 0.45 * (face[3] - face[0]) + 0.3 * (face[1] - face[0]), gsd).tolist()
    cv2.circle(picture, (x, y), fixed_length(0.45, gsd), (70, 62, 58), -1, cv2.LINE_AA, SHIFT)


def draw_crowns(rng: np.random.Generator, picture: Image, trees: list[Tree], gsd: float) -> None:
    """Crowns as clumps of leaves: dark at the bottom, brighter towards the sun."""
    for tree in trees:
        for x, y, radius, light in clumps(rng, tree):
            colour = tuple(min(255, int(c * light)) for c in tree.tone)
            px, py = fixed(np.array([x, y]), gsd).tolist()
            cv2.circle(picture, (px, py), fixed_length(radius, gsd), colour, -1, cv2.LINE_AA, SHIFT)


def clumps(rng: np.random.Generator, tree: Tree) -> Iterator[tuple[float, float, float, float]]:
    """(x, y, radius, brightness) of the leaf clumps of a crown, lowest first."""
    yield tree.x, tree.y, tree.radius * 0.9, 0.6
    count = int(6 + 7 * tree.radius)
    turn, reach = rng.uniform(0, 2 * np.pi, count), np.sqrt(rng.random(count)) * 0.85
    dx, dy = np.cos(turn) * reach, np.sin(turn) * reach
    light = 1.0 - 0.45 * (dx * SUN[0] + dy * SUN[1]) + rng.normal(0, 0.16, count)
    size = rng.uniform(0.12, 0.34, count)
    yield from zip(tree.x + dx * tree.radius, tree.y + dy * tree.radius, tree.radius * size, light, strict=True)
