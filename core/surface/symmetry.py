"""Mirror images of a face surface in the plane x = 0.

The template's parametrisation is symmetric: the mirror image of the surface point at
``(u, v)`` lies at ``(1 - u, v)``.  The uniform basis has the same symmetry, so the
control points mirror like the points.
"""

from __future__ import annotations

from .bspline import BSplineSurface

SIDES = ("both", "left", "right")


def mirrored(surface: BSplineSurface) -> BSplineSurface:
    """The mirror image ``F'(u, v) = diag(-1, 1, 1) F(1 - u, v)``; exact."""
    return BSplineSurface(surface.control_points[::-1] * (-1.0, 1.0, 1.0))


def symmetrised(
    surface: BSplineSurface, side: str = "both", amount: float = 1.0
) -> BSplineSurface:
    """The surface made mirror symmetric.

    Parameters
    ----------
    surface : BSplineSurface
    side : "both", "left" or "right"
        Which half is the model: the mean of both, the one at the left of the picture
        (small u, x < 0) or the one at its right.  The points of the middle column, and
        on both sides of the middle where there is none, always become the mean, so that
        the halves meet.
    amount : float
        0 leaves the surface as it is, 1 makes it symmetric.
    """
    if side not in SIDES:
        raise ValueError(f"side must be one of {', '.join(SIDES)}, not {side!r}")
    b, other = surface.control_points, mirrored(surface).control_points
    mean = (b + other) / 2
    if side == "both":
        goal = mean
    else:
        m = len(b)
        # Whole columns of one half, the mean in the middle one or two.
        kept, taken = (b, other) if side == "left" else (other, b)
        goal = mean.copy()
        half = (m - 1) // 2
        goal[:half], goal[m - half :] = kept[:half], taken[m - half :]
    return BSplineSurface(b + amount * (goal - b))
