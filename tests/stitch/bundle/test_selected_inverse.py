"""The selected inverse is the inverse where it is asked for."""

import numpy as np
import pytest
from scipy import sparse

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.bundle.selected_inverse import covariances

U = 3  # unknowns per frame


def graph(places: Array, reach: float, common: int) -> Array:
    """A normal matrix in which each two frames nearer than `reach` are linked, and all with the common unknowns."""
    rng = np.random.default_rng(4)
    n = len(places)
    size = n * U + common
    dense = np.zeros((size, size))
    far = np.linalg.norm(places[:, None] - places[None], axis=2)
    for i, j in np.argwhere((far < reach) & (far > 0)):
        block = np.concatenate([i * U + np.arange(U), j * U + np.arange(U), n * U + np.arange(common)])
        rows = rng.normal(size=(2 * U + 2, len(block)))
        dense[np.ix_(block, block)] += rows.T @ rows
    return dense


def assert_blocks_of_inverse(dense: Array, places: Array, known: list[int]) -> None:
    n, rest = len(places), np.setdiff1d(np.arange(len(dense)), known)
    inverse = np.zeros_like(dense)
    inverse[np.ix_(rest, rest)] = np.linalg.inv(dense[np.ix_(rest, rest)])
    found = covariances(sparse.csc_matrix(dense), U, places, np.array(known, dtype=np.intp))
    assert found is not None
    scale = np.abs(inverse).max()
    for i in range(n):
        own = slice(i * U, i * U + U)
        assert np.abs(found.of_frames[i] - inverse[own, own]).max() < 1e-9 * scale
        assert np.abs(found.with_common[i] - inverse[own, n * U :]).max(initial=0) < 1e-9 * scale
    assert np.abs(found.of_common - inverse[n * U :, n * U :]).max(initial=0) < 1e-9 * scale


@pytest.mark.parametrize("common", [0, 2])
@pytest.mark.parametrize("known", [[], [4, 5]])
def test_a_survey(common: int, known: list[int]) -> None:
    """Large enough for some cuts of the map, of which several cross."""
    places = np.stack(np.meshgrid(np.arange(16.0), np.arange(12.0)), axis=-1).reshape(-1, 2)
    dense = graph(np.random.default_rng(1).permutation(places), 1.5, common)
    assert_blocks_of_inverse(dense, np.random.default_rng(1).permutation(places), known)


def test_frames_that_all_overlap() -> None:
    """No cut sets anything apart."""
    places = np.random.default_rng(2).normal(size=(60, 2))
    assert_blocks_of_inverse(graph(places, 99.0, 2), places, [0])


def test_common_unknowns_that_some_frames_know_nothing_of() -> None:
    """Two cameras: the frames of one half have no entries with the lens of the other."""
    places = np.c_[np.arange(120.0), np.zeros(120)]
    dense = graph(places, 2.5, 2)
    first, second = 120 * U, 120 * U + 1
    dense[first, : 60 * U] = dense[: 60 * U, first] = dense[second, 60 * U : 120 * U] = dense[
        60 * U : 120 * U, second
    ] = 0
    dense[first, second] = dense[second, first] = 0
    dense[[first, second], [first, second]] *= 2
    assert_blocks_of_inverse(dense, places, [0])


def test_what_nothing_determines_is_said() -> None:
    places = np.c_[np.arange(40.0), np.zeros(40)]
    dense = graph(places, 2.5, 0)
    dense[7 * U, :] = dense[:, 7 * U] = 0
    assert covariances(sparse.csc_matrix(dense), U, places, np.empty(0, np.intp)) is None


@pytest.mark.parametrize("common", [0, 2])
def test_halves_of_the_map_without_a_link_across_the_cut(common: int) -> None:
    """On a long flight some cut falls where nothing overlaps once the frames of earlier cuts are set apart."""
    x = np.concatenate([np.arange(40.0), 100 + np.arange(40.0)])
    places = np.c_[x, np.zeros(80)]
    assert_blocks_of_inverse(graph(places, 2.5, common), places, [4, 5])
