"""The rows of the joint system, against numerical derivatives of the definition."""

from dataclasses import replace

import numpy as np
import reference
from bsface.camera.camera import PARAMETERS
from bsface.surface.bspline import BSplineSurface
from bsface.surface.prior import shape_prior
from bsface.surface.template import load_template
from joint_waves import PHOTOS, SHAPE, Residual, cameras, directions, first_step, wave


def test_residual_is_the_one_of_the_definition(case):
    _, one, residual, _ = case
    np.testing.assert_allclose(residual(), one.rows.residual, atol=1e-9)


def row_errors(one, residual, surface, every):
    """Relative error of the rows of some control points, against the definition."""
    ways, errors, rows = directions(surface), [], one.rows
    used = np.flatnonzero(np.abs(rows.samples.T[0].toarray()).sum(0) > 0.5)
    for k in used[::every]:

        def moved(e, k=k):
            b = surface.vector.copy()
            b[k] += e[0] * ways[k]
            return residual(BSplineSurface(b.reshape(*surface.shape, 3)))

        expected = reference.numerical_derivative(moved, 1, 1e-4)[..., 0]
        T = [t[:, [k]].toarray()[:, 0] for t in rows.samples.T]
        found = sum(rows.by_displacement[a] * T[a] for a in range(3))
        errors.append(np.linalg.norm(found - expected) / np.linalg.norm(expected))
    return errors


def test_rows_of_the_displacement(case):
    """Moving a control point along its direction changes the residual as T c says.

    On the template the directions of neighbours differ, so the model is coarse there.
    """
    kind, one, residual, surface = case
    errors = row_errors(one, residual, surface, 5)
    assert np.median(errors) < (1e-4 if kind == "plane" else 0.3)


def test_rows_of_a_curved_surface_get_better_with_the_net(template):
    medians = []
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    for shape in (SHAPE, (14, 16)):
        finer = load_template() if shape != SHAPE else template
        finer = replace(
            finer,
            identity_modes=finer.identity_modes[:1],
            expression_modes=finer.expression_modes[:1],
        ).resampled(shape)
        prior = shape_prior(finer, 1.0, 0.5, 1.0, 0.2)
        one = first_step(finer, prior, finer.surface, views, pictures)
        residual = Residual(one, finer.surface, pictures)
        medians.append(np.median(row_errors(one, residual, finer.surface, 7)))
    assert medians[1] < 0.5 * medians[0]
    assert medians[1] < 0.1


def test_rows_of_the_cameras_and_expressions(case):
    kind, one, residual, _ = case
    count = one.before.motions
    assert count == PARAMETERS + (kind == "expressions")
    for i in range(PHOTOS):

        def moved(e, i=i):
            views, own = list(residual.views), one.before.expressions.copy()
            views[i] = views[i].moved(e[:PARAMETERS])
            own[i] += e[PARAMETERS:]
            return residual(views=views, expressions=own)

        expected = reference.numerical_derivative(moved, count, 1e-5)
        found = np.zeros_like(expected)
        found[i] = one.rows.by_photo(i)[:, :count]
        np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_rows_of_the_lights_and_of_the_albedo(case):
    _, one, residual, _ = case
    known, albedo = one.before.lights, one.before.albedo
    for i in range(PHOTOS):

        def moved(e, i=i):
            lights = known.copy()
            lights[i] += e
            return residual(lights=lights)

        expected = reference.numerical_derivative(moved, known.shape[1], 1e-3)
        found = one.rows.by_photo(i)[:, one.before.motions :]
        np.testing.assert_allclose(found, expected[i], atol=1e-8)
        assert np.abs(np.delete(expected, i, 0)).max() == 0
    slope = residual(albedo=albedo + 1e-3) - residual(albedo=albedo - 1e-3)
    np.testing.assert_allclose(one.rows.shading, -slope / 2e-3, atol=1e-9)
