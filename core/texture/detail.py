"""Relief that the control net cannot hold: normal map and displacement over (u, v).

The maps with their tangent space, and the pictures that are written of them;
:mod:`.detail_measurement` makes them from the photos.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..drawing.pictures import write_png
from ..images.colour import stored_type
from ..kinds import expect, expect_paths, expect_picture
from ..surface.bspline import BSplineSurface, dense_basis, unit_normals
from .views import texel_centres

Picture = npt.NDArray[np.float32]

#: Displacement of a white texel of the displacement picture, mm; black is as far in.
WHITE_MM = 1.0


@dataclass(frozen=True, eq=False)
class Detail:
    """Relief on a face's (u, v), row 0 at v = 0.

    Attributes
    ----------
    displacement : (S, S) float32 array
        Millimetres outwards along the normal of the surface.
    normals : (S, S, 3) float32 array
        Unit normals in the tangent space of glTF, OpenGL and MikkTSpace: x along u, y
        up (against v), z out of the face; (0, 0, 1) where there is no detail.
    """

    displacement: Picture
    normals: Picture

    @property
    def size(self) -> int:
        """Texels a side."""
        return self.displacement.shape[0]


@dataclass(frozen=True)
class Tangents:
    """Tangent plane at the texels.

    Attributes
    ----------
    dual_u, dual_v : (S, S, 3) float32 arrays
        ``F^u``, ``F^v``: a gradient is ``z_u F^u + z_v F^v``; 1 / mm.
    tangent, up : (S, S, 3) float32 arrays
        Unit vectors: along u, and upwards at right angles to it.
    length_u, length_v : float
        Typical millimetres of one unit of u and of v.
    """

    dual_u: Picture
    dual_v: Picture
    tangent: Picture
    up: Picture
    length_u: float
    length_v: float


def tangents_of(surface: BSplineSurface, size: int) -> Tangents:
    """Tangent planes of a surface at the centres of size x size texels."""
    at = texel_centres(size)
    m, n = surface.shape
    along_u = [dense_basis(m, at, k) for k in (0, 1)]
    along_v = [dense_basis(n, at, k) for k in (0, 1)]
    net = surface.control_points
    F_u = np.einsum("pm,qn,mnc->qpc", along_u[1], along_v[0], net, optimize=True)
    F_v = np.einsum("pm,qn,mnc->qpc", along_u[0], along_v[1], net, optimize=True)
    E, F, G = ((a * b).sum(axis=2) for a, b in ((F_u, F_u), (F_u, F_v), (F_v, F_v)))
    # Where the surface is folded a slope means nothing; no gradient is seen there.
    area = np.maximum(E * G - F * F, 1e-6 * np.median(E * G))[..., None]
    tangent = F_u / np.maximum(np.sqrt(E), 1e-9)[..., None]
    return Tangents(
        dual_u=((G[..., None] * F_u - F[..., None] * F_v) / area).astype(np.float32),
        dual_v=((E[..., None] * F_v - F[..., None] * F_u) / area).astype(np.float32),
        tangent=tangent.astype(np.float32),
        up=np.cross(unit_normals(F_u, F_v), tangent).astype(np.float32),
        length_u=float(np.median(np.sqrt(E))),
        length_v=float(np.median(np.sqrt(G))),
    )


def tangent_normals(height: Picture, tangents: Tangents) -> Picture:
    """Normals of a displaced surface in its tangent space, (S, S, 3)."""
    size = len(height)
    z_v, z_u = (size * g for g in np.gradient(height))
    gradient = z_u[..., None] * tangents.dual_u + z_v[..., None] * tangents.dual_v
    x = -np.einsum("vuc,vuc->vu", gradient, tangents.tangent)
    y = -np.einsum("vuc,vuc->vu", gradient, tangents.up)
    normals = np.stack([x, y, np.ones_like(x)], axis=-1)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return normals.astype(np.float32)


def normal_picture(detail: Detail, depth: int = 8) -> npt.NDArray:
    """The normal map as a picture (S, S, 3): green up, flat is (128, 128, 255)."""
    expect(Detail, "a Detail", detail=detail)
    expect_picture(detail.normals, "detail.normals", "unit normals", 3)
    return _quantised((detail.normals + 1) / 2, depth)


def displacement_picture(detail: Detail) -> npt.NDArray[np.uint16]:
    """The displacement as a 16-bit picture (S, S): grey 0, white `WHITE_MM`."""
    expect(Detail, "a Detail", detail=detail)
    expect_picture(detail.displacement, "detail.displacement", "millimetres")
    return _quantised(0.5 + detail.displacement / (2 * WHITE_MM), 16)


def write_normals(path: str | os.PathLike, detail: Detail, depth: int = 8) -> Path:
    """Write the normal map as PNG, row 0 at v = 0; see `normal_picture`."""
    expect_paths(path=path)
    return write_png(path, normal_picture(detail, depth))


def write_displacement(path: str | os.PathLike, detail: Detail) -> Path:
    """Write the displacement as 16-bit PNG; see `displacement_picture`."""
    expect_paths(path=path)
    return write_png(path, displacement_picture(detail))


def _quantised(values: Picture, depth: int) -> npt.NDArray:
    kind = stored_type(depth)
    top = np.iinfo(kind).max
    # Half a step is rounded up: flat is 128 or 32768 everywhere.
    return np.clip(np.floor(values * top + 0.5), 0, top).astype(kind)
