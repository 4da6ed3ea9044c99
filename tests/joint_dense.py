"""The joint system as dense matrices, nothing eliminated: oracles for its tests."""

import numpy as np
import reference
from bsface.camera.camera import PARAMETERS


def dense_rows(rows):
    """Normal matrix and right side with the albedo among the unknowns."""
    n = len(rows.residual)
    T = [t.toarray() for t in rows.samples.T]
    h = np.stack([rows.by_photo(i) for i in range(n)])
    return reference.dense_gauss_newton(
        T,
        np.moveaxis(rows.by_displacement, 0, 2),
        h,
        rows.shading,
        rows.precision,
        rows.residual,
    )


def dense_system(system):
    """Matrix and right side of displacement and photos, without the shape's prior.

    Formed column by column out of the products that are never formed otherwise.
    """
    size, (n, m) = len(system.right), system.photo_right.shape
    A = np.zeros((size + n * m, size + n * m))
    if system.precision:
        A[:size, :size] = sum(system.precision[1:], system.precision[0]).toarray()
    lights = np.zeros((size, n, m - system.state.motions))
    A[:size, size:] = np.concatenate([system.coupling, lights], 2).reshape(size, -1)
    for i in range(n):
        at = slice(size + i * m, size + (i + 1) * m)
        A[at, at] = system.photo_precision[i]
    if system.border is not None:
        A[:size, :size] += system.border.displacement_precision().toarray()
        for i in range(n):
            at = slice(size + i * m, size + (i + 1) * m)
            A[at, at] += system.border.photo_blocks[i]
        for k, z in enumerate(np.eye(n * m).reshape(-1, n, m), start=size):
            sums = system.border.sums(z)
            A[:size, k] += system.border.to_shape(sums)
            nothing = np.zeros(size)
            A[size:, k] -= system.border.to_photos(nothing, sums[3]).ravel()
    A[size:, :size] = A[:size, size:].T
    return A, np.concatenate([system.right, system.photo_right.ravel()])


def full_system(one, prior, options):
    """All unknowns at once: displacement, modes, photos, albedo; right side too."""
    n, motions = len(one.before.cameras), one.before.motions
    m = motions + one.before.lights.shape[1]
    D = one.before.model.D
    size, count = D.shape
    A, g = dense_rows(one.rows)
    # the modes move the same displacement: columns [I D]
    change = np.zeros((len(A), len(A) + count))
    change[:size, :size], change[:size, size : size + count] = np.eye(size), D
    change[size:, size + count :] = np.eye(len(A) - size)
    A, g = change.T @ A @ change, change.T @ g
    # nothing is known of the albedo of a point that no photo sees
    A += np.diag(1.0 * (np.diag(A) == 0))
    A[:size, :size] += prior.along_normals.toarray()
    A[size : size + count, size : size + count] += np.eye(count)
    border = slice(size + count, size + count + n * m)
    known = np.full((n, m), options.light_damping)
    known[:, :6] = options.camera_damping
    known[:, 6] = 1 / options.distance_spread**2
    known[:, PARAMETERS:motions] = 1 / options.expression_spread**2
    A[border, border] += np.diag(known.ravel())
    for i, camera in enumerate(one.before.cameras):
        away = np.log(camera.kappa * options.distance_mm)
        g[size + count + i * m + 6] -= away / options.distance_spread**2
    return A, g, border
