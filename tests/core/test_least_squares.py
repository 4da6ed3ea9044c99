"""The sparse solver against dense least squares."""

import numpy as np
import pytest
from bsface.solve.least_squares import (
    Block,
    ridge,
    solve_least_squares,
    solve_symmetric,
)
from scipy import sparse


def random_blocks(rng, n=30, columns=3):
    a = sparse.random_array((50, n), density=0.2, rng=rng, format="csr")
    b = sparse.random_array((20, n), density=0.3, rng=rng, format="csr")
    return [
        Block(a, rng.normal(size=(50, columns)), rng.uniform(0.5, 2, 50)),
        Block(b, rng.normal(size=(20, columns)), 0.3),
        ridge(n, 1e-3, rng.normal(size=(n, columns))),
    ]


@pytest.mark.parametrize("columns", [1, 3])
def test_equals_dense_least_squares(columns):
    blocks = random_blocks(np.random.default_rng(1), columns=columns)
    root = [np.sqrt(np.broadcast_to(b.weight, len(b.target)))[:, None] for b in blocks]
    dense = np.concatenate(
        [r * b.matrix.toarray() for r, b in zip(root, blocks, strict=True)]
    )
    target = np.concatenate([r * b.target for r, b in zip(root, blocks, strict=True)])
    expected, _, _, singular = np.linalg.lstsq(dense, target, rcond=None)
    solution = solve_least_squares(blocks)
    assert np.allclose(solution.x, expected, atol=1e-10)
    total = np.sum((dense @ expected - target) ** 2)
    assert sum(solution.residuals) == pytest.approx(total)
    exact = np.linalg.cond(dense.T @ dense, 1)
    assert exact / 3 < solution.condition < exact * 1.001
    assert singular[0] > 0


def test_condition_grows_as_the_ridge_shrinks():
    matrix = sparse.csr_array(np.array([[1.0, 1.0, 0.0]]))
    conditions = [
        solve_least_squares(
            [Block(matrix, np.ones(1)), ridge(3, weight, np.zeros(3))]
        ).condition
        for weight in (1e-2, 1e-6)
    ]
    assert conditions[1] > 1e3 * conditions[0]


def test_indefinite_matrix_falls_back_on_pivoting():
    matrix = sparse.csc_array(np.array([[0.0, 2.0], [2.0, 0.0]]))
    x, condition = solve_symmetric(matrix, np.array([2.0, 4.0]))
    assert np.allclose(x, [2.0, 1.0])
    assert condition == pytest.approx(1.0)


def test_undetermined_system_is_refused():
    matrix = sparse.csr_array(np.array([[1.0, 1.0, 0.0]]))
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        solve_least_squares([Block(matrix, np.ones(1))])


def test_not_finite_is_refused():
    eye = sparse.eye_array(2, format="csr")
    with pytest.raises(np.linalg.LinAlgError, match="finite"):
        solve_least_squares([Block(eye, np.array([1.0, np.nan]))])


def test_shapes_are_checked():
    eye = sparse.eye_array(2, format="csr")
    with pytest.raises(ValueError, match="block 1"):
        solve_least_squares([Block(eye, np.ones(2)), Block(eye, np.ones(3))])
    with pytest.raises(ValueError, match="at least one"):
        solve_least_squares([])
