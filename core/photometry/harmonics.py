"""Lambertian shading under distant light as spherical harmonics of the normal.

A convex Lambertian surface sees any distant illumination through nine numbers (Basri
and Jacobs, PAMI 2003; Ramamoorthi and Hanrahan, SIGGRAPH 2001): ``I = rho L . Y(n)``.
The first four are the paper's model ``M = L S`` with ``S = rho (1, n)``.
"""

from __future__ import annotations

import numpy as np

from .._types import Array


def basis(n: Array, order: int = 9) -> Array:
    """``Y(n)``: 1, x, y, z, xy, xz, yz, x^2 - y^2, 3 z^2 - 1, without norm factors.

    Parameters
    ----------
    n : (..., 3) array
        Unit normals.
    order : 4 or 9

    Returns
    -------
    (..., order) array
    """
    x, y, z = np.moveaxis(n, -1, 0)
    parts = [np.ones_like(x), x, y, z]
    if order == 9:
        parts += [x * y, x * z, y * z, x * x - y * y, 3 * z * z - 1]
    return np.stack(parts, -1)


def slope(n: Array, order: int = 9) -> Array:
    """Derivative of `basis` by the normal, ``(..., order, 3)``."""
    x, y, z = np.moveaxis(n, -1, 0)
    o, i = np.zeros_like(x), np.ones_like(x)
    rows = [(o, o, o), (i, o, o), (o, i, o), (o, o, i)]
    if order == 9:
        rows += [
            (y, x, o),
            (z, o, x),
            (o, z, y),
            (2 * x, -2 * y, o),
            (o, o, 6 * z),
        ]
    return np.stack([np.stack(r, -1) for r in rows], -2)


def rotation(R: Array, order: int = 9) -> Array:
    """Matrix that turns light coefficients with the head.

    Parameters
    ----------
    R : (3, 3) array
        New normals are ``R n``.
    order : 4 or 9

    Returns
    -------
    (order, order) array
        ``lights @ rotation(R)`` shades ``R n`` as ``lights`` shades ``n``.
    """
    # The space of the harmonics is closed under rotation, so any spread of directions
    # determines the matrix exactly.
    n = even_directions(40)
    turned, plain = basis(n @ R.T, order), basis(n, order)
    return np.asarray(np.linalg.lstsq(turned, plain, rcond=None)[0].T, float)


def even_directions(count: int) -> Array:
    """Fibonacci points on the unit sphere, ``(count, 3)``."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, k * np.pi * (1 + 5**0.5)
    r = np.sqrt(1 - z * z)
    return np.asarray(np.stack([r * np.cos(angle), r * np.sin(angle), z], 1), float)
