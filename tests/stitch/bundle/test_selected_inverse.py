"""The selected inverse is the inverse where it is asked for."""

from dataclasses import replace

import numpy as np
import pytest
from linked_frames import equations_of, problem_with, shapes

from gcs_mosaic.stitch.arrays import Indices, Mask
from gcs_mosaic.stitch.bundle import elimination
from gcs_mosaic.stitch.bundle.elimination import BLOCK
from gcs_mosaic.stitch.bundle.normal_equations import Normal
from gcs_mosaic.stitch.bundle.selected_inverse import covariances

SHAPES = shapes(150)
DETERMINED = [name for name in SHAPES if "without" not in name and name not in ("one frame", "no frame")]


def normal_of(shape: str, cameras: int) -> Normal:
    return equations_of(problem_with(*SHAPES[shape], cameras), rows=60)[0]


def lens_of_each(normal: Normal) -> Indices:
    """Frame by frame, as `problem_with` gives cameras to them."""
    partners = np.full(normal.layout.vertices, -1)
    partners[normal.layout.frames] = np.resize(normal.layout.lenses, len(normal.layout.frames))
    return partners


def assert_blocks_of_inverse(normal: Normal, known: Mask, partners: Indices) -> None:
    layout, dense = normal.layout, normal.dense()
    rest = np.flatnonzero(~known.ravel())
    inverse = np.zeros_like(dense)
    inverse[np.ix_(rest, rest)] = np.linalg.inv(dense[np.ix_(rest, rest)])
    blocks = inverse.reshape(layout.vertices, BLOCK, layout.vertices, BLOCK)
    found = covariances(normal, partners, known)
    assert found is not None
    for vertex, partner in enumerate(partners.tolist()):
        own = blocks[vertex, :, vertex]
        assert np.abs(found.own[vertex] - own).max() < 1e-9 * np.abs(own).max()
        common = blocks[vertex, :, partner] if partner >= 0 else np.zeros((BLOCK, BLOCK))
        assert np.abs(found.with_partner[vertex] - common).max() < 1e-9 * np.abs(inverse).max()


@pytest.mark.parametrize("cameras", [1, 2])
@pytest.mark.parametrize("shape", DETERMINED)
def test_blocks_are_those_of_the_inverse(shape: str, cameras: int) -> None:
    normal = normal_of(shape, cameras)
    assert_blocks_of_inverse(normal, np.zeros((normal.layout.vertices, BLOCK), bool), lens_of_each(normal))


@pytest.mark.parametrize("shape", DETERMINED)
def test_what_is_known_is_certain_and_the_rest_is_the_inverse_without_it(shape: str) -> None:
    normal = normal_of(shape, 1)
    known = np.zeros((normal.layout.vertices, BLOCK), bool)
    known[normal.layout.frames[1], :4] = True
    assert_blocks_of_inverse(normal, known, lens_of_each(normal))


@pytest.mark.long
def test_two_lenses_that_have_nothing_to_do_with_each_other() -> None:
    links, places = SHAPES["a survey"]
    problem = problem_with(np.concatenate([links, links + 150]), np.concatenate([places, places]), cameras=2)
    normal = equations_of(replace(problem, camera=np.arange(300) // 150), rows=60)[0]
    first, second = normal.layout.lenses
    assert not (normal.layout.edges == [first, second]).all(axis=1).any()
    partners = np.full(normal.layout.vertices, -1)
    partners[normal.layout.frames] = normal.layout.lenses.repeat(150)
    assert_blocks_of_inverse(normal, np.zeros((normal.layout.vertices, BLOCK), bool), partners)


@pytest.mark.parametrize("shape", DETERMINED)
def test_tasks_change_nothing(shape: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def found() -> list[bytes]:
        normal = normal_of(shape, 1)
        blocks = covariances(normal, lens_of_each(normal), np.zeros((normal.layout.vertices, BLOCK), bool))
        assert blocks is not None
        return [blocks.own.tobytes(), blocks.with_partner.tobytes()]

    together = found()
    monkeypatch.setattr(elimination, "WHOLE_VERTICES", 60)
    monkeypatch.setattr(elimination, "TASK_VERTICES", 40)
    assert found() == together


@pytest.mark.parametrize("shape", ["frames without links", "a survey and frames without links"])
def test_what_nothing_determines_is_said(shape: str) -> None:
    normal = normal_of(shape, 1)
    vertices = normal.layout.vertices
    assert covariances(normal, np.full(vertices, -1), np.zeros((vertices, BLOCK), bool)) is None
