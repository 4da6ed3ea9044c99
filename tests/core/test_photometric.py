"""Photometric stereo on made-up shading of known normals, lights and albedo."""

import numpy as np
import pytest
from bsface.photometry import harmonics
from bsface.photometry.lighting import (
    NOISE_RANGE,
    USUAL_RESIDUAL,
    estimate_lighting,
    independent_share,
    light_diversity,
    photo_noise,
    robust_normals,
    tangents,
)
from hypothesis import given, settings
from hypothesis import strategies as st

PHOTOS, POINTS = 24, 500


def ellipsoid_normals(seed=0, count=POINTS):
    """Normals of the front of an ellipsoid of 75 x 100 x 60 mm."""
    rng = np.random.default_rng(seed)
    r, angle = np.sqrt(rng.random(count)) * 0.9, rng.random(count) * 2 * np.pi
    x, y = r * np.cos(angle), r * np.sin(angle)
    n = np.stack([x / 75, y / 100, np.sqrt(1 - x * x - y * y) / 60], 1)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def scene(order=9, seed=1):
    """Normals, albedo, lights and the intensities that they make."""
    rng = np.random.default_rng(seed)
    n = ellipsoid_normals()
    albedo = rng.uniform(0.5, 1.3, POINTS)
    lights = np.zeros((PHOTOS, order))
    lights[:, 0] = 1.0
    direction = rng.normal(size=(PHOTOS, 3)) + (0, 0, 1.2)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    lights[:, 1:4] = 0.7 * direction
    if order == 9:
        lights[:, 4:] = rng.normal(0, 0.06, (PHOTOS, 5))
    values = albedo * np.maximum(lights @ harmonics.basis(n, order).T, 0.01)
    scale = np.median(values, 1, keepdims=True)
    return n, albedo, lights / scale, values / scale


def angle(a, b):
    return np.degrees(np.arccos(np.clip((a * b).sum(1), -1, 1)))


def tilted(n, degrees, seed=5):
    """Normals that are wrong by ``degrees``, each in a direction of its own."""
    a, b = tangents(n)
    turn = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(n))
    wave = 2**0.5 * np.stack([np.cos(turn), np.sin(turn)], 1)
    out = n + np.tan(np.radians(degrees)) * (wave[:, :1] * a + wave[:, 1:] * b) / 2**0.5
    return out / np.linalg.norm(out, axis=1, keepdims=True)


@given(seed=st.integers(0, 2**32 - 1))
def test_tangents_complete_a_frame(seed):
    n = np.random.default_rng(seed).normal(size=(9, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    a, b = tangents(np.vstack([n, np.eye(3), -np.eye(3)]))
    n = np.vstack([n, np.eye(3), -np.eye(3)])
    frames = np.stack([a, b, n], 1)
    np.testing.assert_allclose(
        frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (15, 1, 1)), atol=1e-12
    )


@pytest.mark.parametrize("order", [4, 9])
def test_lights_and_albedo_of_known_normals(order):
    n, albedo, lights, _ = scene(order)
    Y = harmonics.basis(n, order)
    values = albedo * (lights @ Y.T)
    found = estimate_lighting(
        values,
        np.ones_like(values),
        Y,
        np.zeros((PHOTOS, order)),
        albedo,
        noise=0.06,
        rounds=40,
    )
    got_lights, got_albedo, W, residual = found
    assert np.sqrt((residual**2).mean()) < 0.01
    np.testing.assert_allclose(residual, values - got_albedo * (got_lights @ Y.T))
    assert W.min() > 0.5
    # up to one factor, which goes from the lights to the albedo
    scale = np.median(got_albedo / albedo)
    ratio = got_albedo / scale / albedo
    assert np.quantile(np.abs(ratio - 1), 0.9) < 0.08
    # what is left is smooth: a little of the shading that all photos share
    Y, rest = harmonics.basis(n), ratio - ratio.mean()
    left = rest - Y @ np.linalg.lstsq(Y, rest, rcond=None)[0]
    assert left.std() < 0.3 * max(rest.std(), 0.01)


def test_right_answer_is_a_fixed_point():
    n, albedo, lights, values = scene()
    Y = harmonics.basis(n)
    values = albedo * (lights @ Y.T)
    got_lights, got_albedo, _, residual = estimate_lighting(
        values,
        np.ones_like(values),
        Y,
        lights,
        albedo,
        noise=0.06,
        rounds=3,
        ridge=1e-12,
    )
    np.testing.assert_allclose(got_lights, lights, atol=1e-6)
    np.testing.assert_allclose(got_albedo, albedo, atol=1e-6)
    assert np.abs(residual).max() < 1e-6


@pytest.mark.parametrize("order", [4, 9])
def test_wrong_normals_become_right(order):
    n, albedo, _, values = scene(order)
    start = tilted(n, 12)
    found, got, _, _ = robust_normals(values, np.ones_like(values), start, order=order)
    before, after = angle(start, n).mean(), angle(found, n).mean()
    assert before > 11
    assert after < 0.5 * before
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, rtol=1e-12)
    assert np.corrcoef(got, albedo)[0, 1] > 0.9


def test_shadows_and_highlights_are_outvoted():
    """A fifth of the samples is wrong: robust weights hold the normals."""
    n, _, _, values = scene()
    rng = np.random.default_rng(2)
    bad = rng.random(values.shape)
    spoilt = np.where(bad < 0.1, 0.1 * values, values)
    spoilt = np.where(bad > 0.9, values + 1.5, spoilt)
    start = tilted(n, 12)
    clean = robust_normals(values, np.ones_like(values), start)[0]
    found, _, _, W = robust_normals(spoilt, np.ones_like(values), start)
    assert angle(found, n).mean() < 0.6 * angle(start, n).mean()
    assert angle(found, n).mean() < angle(clean, n).mean() + 1.5
    wrong = (bad < 0.1) | (bad > 0.9)
    assert np.median(W[wrong]) < 0.1 * np.median(W[~wrong])


def test_hidden_samples_count_nothing():
    n, _, _, values = scene()
    rng = np.random.default_rng(3)
    view = (rng.random(values.shape) < 0.7).astype(float)
    start = tilted(n, 8)
    one = robust_normals(values, view, start)
    other = robust_normals(np.where(view > 0, values, 7.0), view, start)
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


def test_brightness_of_the_photos_does_not_matter():
    """Twice the light: twice the coefficients, the same normals."""
    n, _, _, values = scene()
    start = tilted(n, 8)
    one = robust_normals(values, np.ones_like(values), start, noise=0.06)
    two = robust_normals(2 * values, np.ones_like(values), start, noise=0.12)
    np.testing.assert_allclose(one[0], two[0], atol=2e-3)


def test_points_that_no_photo_sees_keep_their_normal():
    n, _, _, values = scene()
    view = np.ones_like(values)
    view[:, :40] = 0
    start = tilted(n, 8)
    found, albedo, lights, W = robust_normals(values, view, start)
    np.testing.assert_allclose(found[:40], start[:40], atol=1e-9)
    assert (W[:, :40] == 0).all()
    assert np.isfinite(albedo).all() and np.isfinite(lights).all()


@given(seed=st.integers(0, 2**32 - 1), order=st.sampled_from([4, 9]))
@settings(max_examples=25)
def test_no_input_gives_nan(seed, order):
    """Black, white, constant and random photos, hidden or not."""
    rng = np.random.default_rng(seed)
    n = ellipsoid_normals(count=30)
    photos = int(rng.integers(1, 6))
    values = rng.choice([0.0, 1.0, 1e-6, 1e4], (photos, 1)) * rng.choice(
        [np.ones((photos, 30)), rng.random((photos, 30))]
    )
    view = (rng.random((photos, 30)) < rng.choice([0, 0.3, 1])).astype(float)
    for part in robust_normals(values, view, n, order=order, rounds=3):
        assert np.isfinite(part).all()
    assert np.isfinite(light_diversity(values, view)).all()


def test_diversity_of_light():
    n, albedo, lights, values = scene()
    full = np.ones_like(values)
    same = albedo * (lights[:1] @ harmonics.basis(n).T) * np.linspace(1, 2, 8)[:, None]
    flat = light_diversity(same, np.ones_like(same))
    assert flat[0] == 1
    assert flat[1] < 1e-12
    varied = light_diversity(values, full)
    assert varied[1] > 0.1
    assert (np.diff(varied) <= 1e-12).all()
    holes = full.copy()
    holes[::3, ::4] = 0
    assert light_diversity(values, holes)[1] > 0.5 * varied[1]


@pytest.mark.parametrize("photos", [2, 3, 20])
def test_noise_of_a_photo_follows_its_residuals(photos):
    """Also with few photos, where the albedo takes a part of the residuals away."""
    size = np.linspace(0.8, 1.6, photos)[:, None] * USUAL_RESIDUAL
    residual = size.mean() * np.random.default_rng(2).normal(size=(photos, 40000))
    residual -= residual.mean(0)
    view = np.ones_like(residual)
    np.testing.assert_allclose(
        photo_noise(view, residual, 0.06), 0.06 * size.mean() / USUAL_RESIDUAL, 0.02
    )
    residual = size * np.random.default_rng(2).normal(size=(photos, 40000))
    found = photo_noise(view, residual, 1.0).ravel()
    assert (np.diff(found) > 0).all()


def test_noise_is_the_usual_one_where_nothing_tells():
    """One photo has no residuals, and a photo that sees nothing has none either."""
    residual = 0.01 * np.ones((3, 50))
    view = np.zeros((3, 50))
    view[0] = 1
    assert (photo_noise(view, residual, 0.06) == 0.06).all()
    residual[1], view[1] = 100, 1
    np.testing.assert_allclose(
        photo_noise(view, residual, 0.06)[1:, 0], (0.06 * NOISE_RANGE[1], 0.06)
    )


@given(st.lists(st.floats(0.4, 3.0), min_size=1, max_size=12), st.floats(0.001, 1.0))
def test_noisier_photos_have_fewer_independent_samples(relative, share):
    noise = 0.06 * np.array(relative)[:, None]
    found = independent_share(noise, 0.06, share)
    assert found.shape == noise.shape
    order = np.argsort(noise.ravel(), kind="stable")
    assert (np.diff(found.ravel()[order]) <= 1e-12).all()
    # the noise times the share is the same for all photos that do not count whole
    assert found.max() <= 1
    product = (found * noise)[found < 1]
    np.testing.assert_allclose(product, product[:1].repeat(len(product)))


@pytest.mark.parametrize(("relative", "expected"), [(0.5, 0.3), (1, 0.3), (4, 0.3 / 8)])
def test_equal_photos_have_the_share_of_the_settings_unless_all_are_noisy(
    relative, expected
):
    assert independent_share(0.06 * relative, 0.06, 0.3) == pytest.approx(expected)
