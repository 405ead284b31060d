"""Inner products that are computed on demand."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.diagnosis.model.gram import GramMatrix, PlacedColumns

N_ATOMS, N_TRIANGLES, N_ROWS = 4, 5, 50
PLACES = np.array([[1, 1, 1, 1, 1], [1, 1, 0, 0, 0], [0, 1, 1, 0, 0], [0, 0, 0, 0, 1]], bool)
INVERSE = np.array([[0.2, 0.05], [0.05, 0.1]])


@pytest.fixture(scope="module")
def dense_and_lazy():
    """Return all inner products of 12 columns, from their rows and from the matrix that computes them on demand."""
    rng = np.random.default_rng(3)
    x, shared = rng.normal(size=(N_TRIANGLES, N_ATOMS, N_ROWS)), rng.normal(size=(N_TRIANGLES, 2, N_ROWS))
    atom, mask = np.tile(np.arange(N_ATOMS), 3), np.repeat(PLACES[[0, 2, 1]], N_ATOMS, axis=0)
    mask[-1] = PLACES[3]
    rows = x[:, atom].transpose(1, 0, 2) * mask[..., None]
    with_shared = np.einsum("ptn,tsn->ps", rows, shared)
    dense = np.einsum("ptn,qtn->pq", rows, rows) - with_shared @ INVERSE @ with_shared.T
    diagonal = 0.9 * np.diag(dense)
    np.fill_diagonal(dense, diagonal)
    by_triangle = np.matmul(x, x.transpose(0, 2, 1))
    return dense, GramMatrix(PlacedColumns(atom, mask), by_triangle, with_shared, INVERSE, diagonal)


@pytest.mark.parametrize(
    "index",
    [
        (slice(None), slice(None)), (slice(None), np.array([3, 11])), np.array([1, 4, 4]), (2, 2), (2, 7),
        np.ix_([0, 5, 11], [5, 1]), (np.array([[[0], [5]]]), np.array([[[0, 5]]])), (slice(None), np.empty(0, int)),
    ],
)  # fmt: skip
def test_a_gram_matrix_is_indexed_as_an_array_is(dense_and_lazy, index):
    dense, lazy = dense_and_lazy
    assert lazy[index] == pytest.approx(dense[index])


def test_the_diagonal_of_a_gram_matrix_is_the_one_given(dense_and_lazy):
    dense, lazy = dense_and_lazy
    assert lazy.diagonal() == pytest.approx(np.diag(dense))


def test_values_of_atoms_are_summed_over_each_columns_triangles(dense_and_lazy):
    values = np.arange(float(N_TRIANGLES * N_ATOMS)).reshape(N_TRIANGLES, N_ATOMS)
    columns = PlacedColumns(np.array([1, 3, 3]), PLACES[[0, 3, 1]])
    assert columns.summed(values).tolist() == [values[:, 1].sum(), values[4, 3], values[:2, 3].sum()]
