"""Rank-4 photometric stereo on Lambertian data whose answer is known."""

import numpy as np
import pytest
from bsface.errors import ReconstructionError
from bsface.solve.paper.photometric import (
    G,
    choose_photos,
    constrained_shape,
    fill_missing,
    fit_ambiguity,
    photometric_svd,
)
from scipy.optimize import minimize


def ellipsoid_normals(count=300, seed=0):
    """Normals of the visible part of an ellipsoid."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.8, 0.8, (2, count))
    keep = x**2 + y**2 < 0.8
    x, y = x[keep], y[keep]
    z = np.sqrt(1 - x**2 - y**2)
    n = np.stack([x / 70, y / 90, z / 50], 1)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def lambertian(normals, photos=20, seed=1):
    """(M, albedo, lights) without shadows: ambient is larger than the direct light."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(photos, 3)) + [0, 0, 1.0]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    L = np.hstack([np.full((photos, 1), 1.2), direction]) * rng.uniform(
        0.5, 2, (photos, 1)
    )
    albedo = rng.uniform(0.7, 1.3, len(normals))
    S = albedo * np.vstack([np.ones(len(normals)), normals.T])
    return L @ S, albedo, L


def angle(a, b):
    return np.degrees(np.arccos(np.clip((a * b).sum(1), -1, 1)))


def disturbed(normals, size=0.12):
    """The template: normals with errors that no 4 x 4 map can explain."""
    wrong = normals + np.random.default_rng(2).normal(size=normals.shape) * size
    return wrong / np.linalg.norm(wrong, axis=1, keepdims=True)


def test_exact_template_gives_exact_normals():
    n = ellipsoid_normals()
    M, albedo, _ = lambertian(n)
    # The albedo of S^t comes from the mean photo and is exact for constant albedo.
    result = photometric_svd(M / albedo, np.ones_like(M), n)
    assert angle(result.normals, n).max() < 1e-4
    assert np.allclose(result.albedo, 1, atol=1e-6)
    assert result.residual < 1e-9
    assert result.singular_values[4] < 1e-9 * result.singular_values[0]
    assert result.chosen.all()


def test_photometric_stereo_improves_on_the_template():
    n = ellipsoid_normals()
    M, albedo, _ = lambertian(n)
    template = disturbed(n)
    result = photometric_svd(M, np.ones_like(M), template)
    assert angle(result.normals, n).mean() < 0.3 * angle(template, n).mean()
    assert np.corrcoef(result.albedo, albedo)[0, 1] > 0.98


def test_brightness_of_a_photo_does_not_matter():
    n = ellipsoid_normals()
    M, _, _ = lambertian(n)
    gain = np.random.default_rng(3).uniform(0.1, 5, (len(M), 1))
    a = photometric_svd(M, np.ones_like(M), disturbed(n)).normals
    b = photometric_svd(M * gain, np.ones_like(M), disturbed(n)).normals
    assert angle(a, b).max() < 0.01


def test_outliers_are_left_out_point_by_point():
    n = ellipsoid_normals()
    M, _, _ = lambertian(n, photos=24)
    rng = np.random.default_rng(4)
    bad = rng.random(M.shape) < 0.02
    M = np.where(bad, 0.2 * M, M)
    chosen = photometric_svd(M, np.ones_like(M), n)
    everything = photometric_svd(M, np.ones_like(M), n, tolerance=np.inf)
    assert angle(chosen.normals, n).mean() < 0.6 * angle(everything.normals, n).mean()
    assert chosen.chosen[bad].mean() < 0.2
    assert chosen.chosen[~bad].mean() > 0.8


def test_constraint_is_met_and_minimal():
    n = ellipsoid_normals(40)
    M, _, L = lambertian(n, photos=8)
    M = M + np.random.default_rng(5).normal(size=M.shape) * 0.1
    start = np.ones((4, len(n)))
    S = constrained_shape(M, L, np.ones(M.shape, bool), start)
    assert np.allclose(np.einsum("ap,ab,bp->p", S, G, S), 0, atol=1e-9)
    # Against a general optimiser over rho (1, n) on a few points.
    for j in range(0, len(n), 10):

        def cost(x, j=j):
            s = np.linalg.norm(x) * np.array([1, *(x / np.linalg.norm(x))])
            return np.sum((M[:, j] - L @ s) ** 2)

        best = min(minimize(cost, x0).fun for x0 in (n[j], n[j] + 0.3, -n[j]))
        assert np.sum((M[:, j] - L @ S[:, j]) ** 2) <= best + 1e-8


def test_start_is_kept_where_photos_do_not_decide():
    n = ellipsoid_normals(20)
    M, _, L = lambertian(n, photos=6)
    chosen = np.ones(M.shape, bool)
    chosen[3:, 0] = False
    start = np.full((4, len(n)), 7.0)
    S = constrained_shape(M, L, chosen, start)
    assert np.allclose(S[:, 0], 7)
    assert not np.allclose(S[:, 1], 7)


def test_missing_values_are_the_point_mean():
    M = np.array([[1.0, 2.0, 9.0], [1.0, 0.0, 9.0], [1.0, 2.0, 9.0]])
    seen = np.array([[1, 1, 0], [1, 0, 0], [1, 1, 0]], bool)
    filled = fill_missing(M, seen)
    assert np.allclose(filled[:, 0], 1) and np.allclose(filled[:, 1], 2)
    assert np.allclose(filled[:, 2], 7 / 5)


def test_unseen_values_have_no_say():
    n = ellipsoid_normals()
    M, _, _ = lambertian(n)
    weights = np.ones_like(M)
    weights[:3, : len(n) // 3] = 0
    spoilt = np.where(weights > 0, M, np.nan)
    a = photometric_svd(M, weights, n)
    b = photometric_svd(spoilt, weights, n)
    assert np.allclose(a.normals, b.normals)
    assert not a.chosen[weights == 0].any()


def test_ambiguity_is_recovered():
    rng = np.random.default_rng(8)
    S, A = rng.normal(size=(4, 50)), rng.normal(size=(4, 4))
    assert np.allclose(fit_ambiguity(S, A @ S), A)


def test_choice_keeps_the_best_share():
    M = np.ones((10, 1))
    model = M - np.arange(10.0)[:, None]
    chosen = choose_photos(M, model, np.ones((10, 1), bool), 0.1)
    assert list(np.flatnonzero(chosen)) == [0, 1, 2, 3, 4]


def test_refuses_what_cannot_work():
    n = ellipsoid_normals(30)
    M, _, _ = lambertian(n)
    with pytest.raises(ReconstructionError, match="at least 4 photos"):
        photometric_svd(M[:3], np.ones_like(M[:3]), n)
    with pytest.raises(ReconstructionError, match="No point"):
        photometric_svd(M, np.zeros_like(M), n)
    with pytest.raises(ValueError, match="do not fit"):
        photometric_svd(M, np.ones_like(M[:, 1:]), n)
