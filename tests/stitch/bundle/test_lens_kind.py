"""Fisheyes are told from other lenses by what matches say, and no other lens is taken for one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matched_frames import problem_of

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.bundle import lens_kind
from gcs_mosaic.stitch.bundle.lens_kind import as_other_kind, through_likelier_lenses
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings, Solution, adjust
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.camera import geometry
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.projection import lens_terms, with_lens

SIZE = 4000, 3000
FISHEYES = {
    "110 degrees": Camera(*SIZE, 1.04, fisheye=True),
    "150 degrees": Camera(*SIZE, 0.77, fisheye=True),
    "stereographic, 140 degrees": Camera(*SIZE, 0.75, 0.083, 0.008, fisheye=True),
}
OTHERS = {
    "small drone": Camera(*SIZE, 1.4, -0.1, 0.02),
    "action camera": Camera(*SIZE, 0.75, -0.26, 0.07),
    "wide": Camera(*SIZE, 0.59),
    "long": Camera(*SIZE, 2.19, -0.151, 0.112),
}


def survey(camera: Camera, seed: int, noise_px: float = 2.0) -> Problem:
    """Three lines of five frames, tilted a little, whose matches are known but for noise; poses and lens a little off."""
    rng = np.random.default_rng(seed)
    step = 0.35 * np.array(SIZE)
    x, y = np.meshgrid(np.arange(5) * step[0], np.arange(3) * step[1])
    poses = np.c_[x.ravel(), y.ravel(), rng.normal(0, 0.05, 15), rng.normal(0, 0.3, 15), rng.normal(0, 0.05, (15, 2))]
    pairs, of_a, of_b = [], [], []
    for b in range(15):
        for a in range(b):
            found = matched(camera, poses[a], poses[b], rng)
            if found is not None:
                pairs.append((a, b))
                of_a.append(found[0] + rng.normal(0, noise_px, found[0].shape))
                of_b.append(found[1] + rng.normal(0, noise_px, found[1].shape))
    start = poses + rng.normal(0, 1, poses.shape) * [60, 60, 0.03, 0.03, 0, 0]
    return problem_of(camera, start, [np.log(1.5), 0.0, 0.0, 0.0, 0.0], pairs, of_a, of_b)


def matched(camera: Camera, one: Array, other: Array, rng: np.random.Generator) -> tuple[Array, Array] | None:
    """Pixels (24, 2) of two frames that show the same places; None if they have too few in common."""
    pixels = rng.uniform(0, 1, (200, 2)) * SIZE
    there = geometry.pixels_from_canvas(Pose(*other), camera, geometry.canvas_from_pixels(Pose(*one), camera, pixels))
    inside = np.flatnonzero(((there > 0) & (there < SIZE)).all(axis=1))[:24]
    return (pixels[inside], there[inside]) if len(inside) == 24 else None


def solved(problem: Problem) -> tuple[Solution, bool]:
    settings = AdjustmentSettings()
    solution, fisheye = through_likelier_lenses(problem, adjust(problem, settings), settings)
    return solution, bool(fisheye[0])


@pytest.mark.long
@pytest.mark.parametrize("camera", FISHEYES.values(), ids=FISHEYES)
def test_a_fisheye_is_found_to_be_one(camera: Camera) -> None:
    """As the other kind they are 12 to 500 px off."""
    solution, fisheye = solved(survey(camera, 1))
    assert fisheye
    assert np.exp(solution.lenses[0, 0]) == pytest.approx(camera.focal, rel=0.06)
    assert shown_apart_px(with_lens(camera, solution.lenses[0]), camera) < 6  # of 2500 to the corner


@pytest.mark.long
@pytest.mark.parametrize("camera", OTHERS.values(), ids=OTHERS)
def test_no_other_lens_is_taken_for_one(camera: Camera) -> None:
    solution, fisheye = solved(survey(camera, 1))
    assert not fisheye
    assert np.exp(solution.lenses[0, 0]) == pytest.approx(camera.focal, rel=0.05)


@pytest.mark.long
def test_one_that_was_taken_for_a_fisheye_is_given_back() -> None:
    """As it never is where either kind describes it: lenses of little distortion."""
    camera = OTHERS["action camera"]
    taken = replace(survey(camera, 1), fisheye=np.array([True]), lenses=as_other_kind(camera)[None])
    solution, fisheye = solved(taken)
    assert not fisheye
    assert shown_apart_px(with_lens(camera, solution.lenses[0]), camera) < 6


@pytest.mark.long
def test_of_two_cameras_each_has_its_kind() -> None:
    """A fisheye and an action camera that is none, on one island: as one kind, neither would be right."""
    cameras = FISHEYES["150 degrees"], OTHERS["action camera"]
    both = together(*(survey(camera, 1) for camera in cameras))
    settings = AdjustmentSettings()
    solution, fisheye = through_likelier_lenses(both, adjust(both, settings), settings)
    assert fisheye.tolist() == [True, False]
    for camera, lens in zip(cameras, solution.lenses, strict=True):
        assert shown_apart_px(with_lens(camera, lens), camera) < 6


def together(one: Problem, other: Problem) -> Problem:
    """The problem of both, of two cameras."""
    frames = len(one.poses)
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(one, name), getattr(other, name)])
        for name in ("poses", "lenses", "half_diagonal", "unit_px", "pixels_a", "pixels_b", "present", "free")
    }
    pairs, camera = [one.pairs, other.pairs + frames], [one.camera, other.camera + 1]
    return replace(one, **joined, pairs=np.concatenate(pairs), camera=np.concatenate(camera))


def shown_apart_px(one: Camera, other: Camera) -> float:
    """Median distance in a frame of where two lenses show the same rays, once these are as long and as turned as fit best."""
    pixels = geometry.pixel_grid(other, 21, 16)
    rays = geometry.undistort(other, geometry.normalised(other, pixels).T)
    lengths = np.linspace(0.8, 1.25, 91)
    back = [geometry.distort(one, rays * length) * one.focal_px + one.principal_point[:, None] for length in lengths]
    return float(min(np.nanmedian(np.linalg.norm(found.T - pixels, axis=1)) for found in back))


def test_with_few_frames_nothing_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lens_kind, "LEAST_FRAMES", 16)
    problem = replace(
        survey(FISHEYES["110 degrees"], 1), lenses=np.array([lens_terms(Camera(*SIZE, 1.0, -0.25, 0.05))])
    )
    solution = adjust(problem, AdjustmentSettings(steps=1))
    found, fisheye = through_likelier_lenses(problem, solution, AdjustmentSettings())
    assert found is solution
    assert not fisheye.any()


@pytest.mark.parametrize("camera", [*FISHEYES.values(), *OTHERS.values()], ids=[*FISHEYES, *OTHERS])
def test_the_other_kind_shows_the_middle_where_this_one_does(camera: Camera) -> None:
    other = with_lens(replace(camera, fisheye=not camera.fisheye), as_other_kind(camera))
    assert other.focal == pytest.approx(camera.focal)
    inner = np.array([[0.3 * side for side in SIZE], [0.5 * side for side in SIZE], [0.6 * side for side in SIZE]])
    rays = geometry.undistort(camera, geometry.normalised(camera, inner).T)
    off = geometry.distort(other, rays) - geometry.normalised(camera, inner).T
    assert np.abs(off).max() * camera.focal_px < 60
