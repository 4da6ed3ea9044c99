"""The face as a uniform bicubic B-spline surface (section 2.1, Eq. 1-5).

Conventions
-----------
Parameters ``(u, v)`` run over the unit square, ``u`` to the right of the picture and
``v`` **down**; the knots are the integers ``0 .. M+3`` and ``0 .. N+3``, so the valid
knot interval is ``[3, M]`` (``[3, N]``) and ``t = 3 + u (M - 3)``.  Control points have
shape ``(M, N, 3)``, first index ``u``.  Because ``v`` runs down, the normal that points
out of the face is ``F_v x F_u`` (the paper's figure 3 has this order, its Eq. 3 the
other).

Deviations from the printed text
--------------------------------
"Degree 4 x 4" is *order* 4: the surface is bicubic (``M + 4`` knots, C2).  The printed
derivative of Eq. 2 has the factor 4, the wrong knot spans and derivatives on both
sides; the right one is ``N'_{m,4} = 3/(u_{m+3}-u_m) N_{m,3} - 3/(u_{m+4}-u_{m+1})
N_{m+1,3}``, which is what the cardinal segment polynomials below differentiate to.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy  # its interpolate loads when it is used, in a tenth of a second
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from .._types import Array
from ..kinds import coordinates, expect_whole, real_numbers
from .closest import closest_points

#: Of a derivative: the pieces are cubic.
HIGHEST_ORDER = 3
#: Along one side of a grid of points, and of Newton steps.
MOST_SAMPLES, MOST_STEPS = 100_000, 10_000
#: No point that is looked for is farther from the origin, mm.
FARTHEST = 1e9
# The four cubic pieces of the cardinal B-spline on one knot span, as polynomials of
# the local coordinate x in [0, 1]: row = power of x, column = control point.
_SEGMENT = (
    np.array(
        [
            [1.0, 4.0, 1.0, 0.0],
            [-3.0, 0.0, 3.0, 0.0],
            [3.0, -6.0, 3.0, 0.0],
            [-1.0, 3.0, -3.0, 1.0],
        ]
    )
    / 6.0
)


def segment_basis(count: int, x: ArrayLike, order: int = 0) -> tuple[NDArray, Array]:
    """Nonzero basis functions ``N_{m,4}`` (Eq. 1) or their derivatives.

    Parameters
    ----------
    count : int
        Number of control points in this direction, at least 4.
    x : (p,) array
        Parameters in [0, 1]; outside, the border polynomials are continued.
    order : int
        Derivative with respect to ``x``, 0 to 3.

    Returns
    -------
    first : (p,) int array
        Index of the first of the four control points.
    values : (p, 4) array
        Their coefficients.
    """
    if count < 4:
        raise ValueError(
            f"a cubic B-spline needs at least 4 control points, got {count}"
        )
    if order < 0:
        raise ValueError(f"the order of a derivative is 0 or more, got {order}")
    t = np.asarray(x, float).ravel() * (count - 3)
    first = np.clip(np.floor(t), 0, count - 4).astype(np.int64)
    local = t - first
    powers = np.zeros((len(t), 4))
    for k in range(order, 4):
        # d^order/dx^order of x^k
        factor = np.prod(np.arange(k - order + 1, k + 1)) if order else 1.0
        powers[:, k] = factor * local ** (k - order)
    return first, powers @ _SEGMENT * float(count - 3) ** order


def basis_matrix(
    shape: tuple[int, int], u: ArrayLike, v: ArrayLike, du: int = 0, dv: int = 0
) -> sparse.csr_array:
    """The coefficient matrices ``T, T1, T2, T11, T22, T12`` of Eq. 2 and 5.

    Parameters
    ----------
    shape : (M, N)
        Size of the control net.
    u, v : (p,) arrays
        Parameters in [0, 1].
    du, dv : int
        Order of the partial derivative: ``T`` (0, 0), ``T1`` (1, 0), ``T2`` (0, 1),
        ``T11`` (2, 0), ``T22`` (0, 2), ``T12`` (1, 1).

    Returns
    -------
    (p, M*N) sparse array
        Acts on each coordinate of ``b.reshape(M*N, 3)``; the paper's matrix with three
        rows a point is its Kronecker product with the 3 x 3 identity.
    """
    m, n = shape
    iu, bu = segment_basis(m, u, du)
    iv, bv = segment_basis(n, v, dv)
    if len(iu) != len(iv):
        raise ValueError(f"u and v differ in length: {len(iu)} and {len(iv)}")
    rows = len(iu)
    four = np.arange(4)
    columns = (iu[:, None] + four)[:, :, None] * n + (iv[:, None] + four)[:, None, :]
    data = bu[:, :, None] * bv[:, None, :]
    return sparse.csr_array(
        (data.ravel(), columns.ravel(), np.arange(rows + 1) * 16), shape=(rows, m * n)
    )


def unit_normals(s_u: Array, s_v: Array) -> Array:
    """Unit normals out of the face (Eq. 3) for the partial derivatives (..., 3)."""
    h = np.cross(s_v, s_u)
    return h / np.maximum(np.linalg.norm(h, axis=-1, keepdims=True), 1e-12)


def dense_basis(count: int, x: Array, order: int = 0) -> Array:
    """As `segment_basis`, as one dense matrix ``(p, count)``."""
    first, value = segment_basis(count, x, order)
    dense = np.zeros((len(x), count))
    np.put_along_axis(dense, first[:, None] + np.arange(4), value, 1)
    return dense


def grid_parameters(nu: int, nv: int) -> tuple[Array, Array]:
    """Flattened ``(u, v)`` of a regular grid, ends included, index ``iu * nv + iv``."""
    u, v = np.meshgrid(np.linspace(0, 1, nu), np.linspace(0, 1, nv), indexing="ij")
    return u.ravel(), v.ravel()


def grid_triangles(nu: int, nv: int) -> NDArray[np.int64]:
    """Two triangles a grid cell, counter-clockwise seen from outside, ``(t, 3)``."""
    a = (np.arange(nu - 1)[:, None] * nv + np.arange(nv - 1)).ravel()
    b, c, d = a + nv, a + 1, a + nv + 1
    return np.concatenate([np.stack([a, c, d], 1), np.stack([a, d, b], 1)])


@dataclass(frozen=True, eq=False)
class BSplineSurface:
    """Uniform bicubic B-spline surface ``F(u, v) = sum R_mn(u, v) b_mn`` (Eq. 1).

    Parameters
    ----------
    control_points : (M, N, 3) array
        ``b`` in millimetres; first index ``u``, second ``v`` (downwards).
    """

    control_points: Array = field()

    def __post_init__(self) -> None:
        b = np.array(real_numbers(self.control_points, "control points"))
        if b.ndim != 3 or b.shape[2] != 3 or min(b.shape[:2]) < 4:
            raise ValueError(f"control points must be (M>=4, N>=4, 3), got {b.shape}")
        if not np.isfinite(b).all():
            raise ValueError("control points must be finite")
        b.setflags(write=False)
        object.__setattr__(self, "control_points", b)

    def __setstate__(self, state: dict[str, Array]) -> None:
        # Copies and pickles bring arrays that can be written.
        self.__dict__.update(state)
        self.__post_init__()

    @property
    def shape(self) -> tuple[int, int]:
        """Size ``(M, N)`` of the control net."""
        return self.control_points.shape[0], self.control_points.shape[1]

    @property
    def vector(self) -> Array:
        """Control points as ``(M*N, 3)``: what the basis matrices act on."""
        return self.control_points.reshape(-1, 3)

    def matrix(
        self, u: ArrayLike, v: ArrayLike, du: int = 0, dv: int = 0
    ) -> sparse.csr_array:
        """Coefficient matrix at ``(u, v)``; see `basis_matrix`.

        Raises
        ------
        TypeError, ValueError
            Parameters that are not finite numbers, or orders that are not 0 to 3.
        """
        expect_whole(0, HIGHEST_ORDER, du=du, dv=dv)
        u, v = real_numbers(u, "u"), real_numbers(v, "v")
        if not (np.isfinite(u).all() and np.isfinite(v).all()):
            raise ValueError("u and v must be finite numbers.")
        return basis_matrix(self.shape, u, v, du, dv)

    def evaluate(
        self, u: ArrayLike, v: ArrayLike, du: int = 0, dv: int = 0
    ) -> NDArray[np.float64]:
        """Points or partial derivatives, ``(..., 3)`` for ``u, v`` of shape ``...``.

        Raises
        ------
        TypeError, ValueError
            See `matrix`.
        """
        u, v = np.broadcast_arrays(real_numbers(u, "u"), real_numbers(v, "v"))
        value = self.matrix(u, v, du, dv) @ self.vector
        return value.reshape(*u.shape, 3)

    def normals(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Unit normals out of the face (Eq. 3 for ``v`` running down), ``(..., 3)``."""
        return unit_normals(self.evaluate(u, v, du=1), self.evaluate(u, v, dv=1))

    @property
    def greville(self) -> Array:
        """Greville abscissae of the control points, within [0, 1], ``(M*N, 2)``."""
        along = [np.clip((np.arange(c) - 1.0) / (c - 3), 0, 1) for c in self.shape]
        return np.stack(np.meshgrid(*along, indexing="ij"), -1).reshape(-1, 2)

    def grid(self, nu: int, nv: int) -> Array:
        """Points on a regular parameter grid, ends included, ``(nu, nv, 3)``."""
        expect_whole(1, MOST_SAMPLES, nu=nu, nv=nv)
        m, n = self.shape
        across = dense_basis(m, np.linspace(0, 1, nu)) @ self.control_points.reshape(
            m, -1
        )
        down = dense_basis(n, np.linspace(0, 1, nv))
        return np.asarray(down @ across.reshape(nu, n, 3), float)

    def transformed(
        self, scale: float = 1.0, R: ArrayLike | None = None, t: ArrayLike = 0.0
    ) -> BSplineSurface:
        """The surface under ``x -> scale R x + t`` (affine invariance).

        Raises
        ------
        ValueError
            A scale that is 0 or no finite number, R that is not (3, 3), or t that is
            neither one number nor three.
        """
        size = real_numbers(scale, "scale")
        if size.ndim or not np.isfinite(size) or size == 0:
            raise ValueError(f"scale must be a finite number and not 0, not {scale!r}.")
        R = np.eye(3) if R is None else real_numbers(R, "R")
        t = real_numbers(t, "t")
        if R.shape != (3, 3) or t.shape not in ((), (3,)):
            raise ValueError(
                f"R must be (3, 3) and t (3,), not {R.shape} and {t.shape}."
            )
        return BSplineSurface(scale * self.control_points @ R.T + t)

    def resampled(self, shape: tuple[int, int]) -> BSplineSurface:
        """Least-squares surface with another number of control points.

        Exact where the new knots contain the old ones (``M' - 3`` a multiple of
        ``M - 3``).

        Raises
        ------
        ValueError
            When ``shape`` is not two whole numbers, each 4 or more.
        """
        return BSplineSurface(resampled_net(self.control_points, net_shape(shape)))

    def clamped(self) -> tuple[Array, Array, Array]:
        """The same surface with clamped knots on [0, 1], for CAD files.

        Returns
        -------
        control_points : (M, N, 3) array
        knots_u, knots_v : (M + 4,), (N + 4,) arrays

        Notes
        -----
        Inserting the two end knots to multiplicity 4 and cutting off what lies outside
        is exact and keeps the number of control points.
        """
        b = self.control_points
        knots = []
        for axis in (0, 1):
            count = b.shape[axis]
            spline = scipy.interpolate.BSpline(
                np.arange(count + 4.0), np.moveaxis(b, axis, 0), 3
            )
            for end in (3.0, float(count)):
                spline = spline.insert_knot(end, 3)
            keep = slice(3, 3 + count + 4)
            b = np.moveaxis(np.asarray(spline.c)[3 : 3 + count], 0, axis)
            knots.append((np.asarray(spline.t)[keep] - 3) / (count - 3))
        return b, knots[0], knots[1]

    def closest_point(
        self, points: ArrayLike, iterations: int = 20
    ) -> tuple[Array, Array]:
        """Parameters and distance of the surface points closest to ``points``.

        Starts at the nearest vertex of a dense grid and takes damped Newton steps
        (Gauss-Newton where the distance is not convex), kept inside the unit square.

        Parameters
        ----------
        points : (..., 3) array
            Millimetres, in the frame of the surface; ``p`` of them.
        iterations : int
            Newton steps.

        Returns
        -------
        uv : (p, 2) array
            In [0, 1].
        distance : (p,) array
            Millimetres.

        Raises
        ------
        ValueError
            Points are not finite, or farther than any face.
        """
        expect_whole(0, MOST_STEPS, iterations=iterations)
        q = coordinates(points, "points", 3).reshape(-1, 3)
        if not (np.abs(q) < FARTHEST).all():
            raise ValueError("points must be finite places in millimetres")
        return closest_points(self, q, iterations)

    def signed_distance(self, points: ArrayLike) -> Array:
        """Distance to the surface, ``(p,)``: positive outside (in front), negative in.

        The surface is a sheet, not a closed solid: the side is that of the outward
        normal at the closest point.
        """
        q = coordinates(points, "points", 3).reshape(-1, 3)
        uv, distance = self.closest_point(q)
        offset = ((q - self.evaluate(*uv.T)) * self.normals(*uv.T)).sum(1)
        return np.where(offset < 0, -distance, distance)


def net_shape(given: object, name: str = "shape") -> tuple[int, int]:
    """Size of a control net, checked.

    Raises
    ------
    ValueError
        When it is not two whole numbers, each 4 or more.
    """
    numbers = list(given) if isinstance(given, tuple | list | np.ndarray) else []
    whole = [x for x in numbers if isinstance(x, int | np.integer)]
    fits = len(numbers) == len(whole) == 2 and min(whole) >= 4
    if not fits or any(isinstance(x, bool) for x in whole):
        raise ValueError(
            f"{name} must be two whole numbers of at least 4, such as (42, 44), not "
            f"{given!r:.60}."
        )
    return int(whole[0]), int(whole[1])


def resampled_net(control_points: Array, shape: tuple[int, int]) -> Array:
    """As `BSplineSurface.resampled`, of any values on the net, (M, N, ...)."""
    b = np.asarray(control_points)
    for axis, count in enumerate(shape):
        old = b.shape[axis]
        if count == old:
            continue
        x = np.linspace(0, 1, 12 * max(count, old) + 1)
        new = dense_basis(count, x)
        change = np.linalg.lstsq(new, dense_basis(old, x), rcond=None)[0]
        b = np.moveaxis(np.tensordot(change, b, (1, axis)), 0, axis)
    return b
