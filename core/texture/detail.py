"""Relief that the control net cannot hold: normal map and displacement over (u, v).

Photometric stereo with known lights, linearised about the surface (Woodham 1980;
Nehab et al. 2005 for the joining of coarse shape and fine normals).  A displacement
``z`` along the normal turns the normal by minus its gradient on the surface, so that
the logarithm of photo i divided by its light is, at each texel,

    d_i = a + h_i . (z_u, z_v),   h_i = -(dL_i/dn . F^u, dL_i/dn . F^v) / L_i

with the albedo in ``a``, the shading ``L_i`` and the dual basis ``F^u``, ``F^v`` of the
tangent plane.  Photos of different light tell slopes from albedo: what does not turn
with the light is albedo.  Each photo's own coarse band is taken out of ``d_i`` first:
it holds the errors of the lights and the shape that the net can hold.  The slopes of
all texels are then fitted by one height field, see :mod:`.height`.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from .._types import Array
from ..drawing.pictures import write_png
from ..images.colour import stored_type
from ..kinds import expect, expect_paths
from ..progress import CheckCancelled
from ..result import Reconstruction
from ..surface.bspline import BSplineSurface, dense_basis
from ..surface.template import Template
from .blend import COARSE, inner_part
from .delit import DelitPhotos
from .height import SlopeEvidence, solve_height
from .views import channel_mean, prefiltered, resized, sample, texel_centres

Picture = npt.NDArray[np.float32]

#: Displacement of a white texel of the displacement picture, mm; black is as far in.
WHITE_MM = 1.0
#: Texels a side at most: what photos that are aligned by their landmarks can share.
LARGEST = 1024
_TILE = 64  # rows at a time
#: Standard deviation of the Gaussian that separates net and detail, in knot spans: half
#: of the amplitude passes at 2.2 spans, about the shortest wave of the net.
_CUT = 0.5
_SCALE = 0.08  # Cauchy scale of d_i, relative intensities
_LEAST_NOISE = 0.01  # smallest standard deviation of d_i
_FEWEST = 4.5  # photos, counted by their weights, that a texel needs
_DARK = 2e-3  # linear intensity below which a pixel says nothing
#: Millimetres from eyes, nostrils and lips' gap within which the detail fades.
_FADE_MM = 3.0


@dataclass(frozen=True)
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


@dataclass(frozen=True)
class PhotoDetail:
    """Detail in n photos, before it is told what of it is relief.

    Attributes
    ----------
    delit : DelitPhotos
    sources : list of (h, w, 3) float32 arrays
        Linear cut-outs, blurred to ``size`` texels.
    own : list of (C, C) float32 arrays
        Coarse band of each photo's logarithm.
    slopes : list of (C, C, 3) float32 arrays
        See `Sky.slopes`.
    tangents : Tangents
    size : int
        Texels a side.
    usual : float
        Weight of a photo that sees a texel well.
    """

    delit: DelitPhotos
    sources: list[Picture]
    own: list[Picture]
    slopes: list[Picture]
    tangents: Tangents
    size: int
    usual: float

    @classmethod
    def of(cls, reconstruction: Reconstruction, delit: DelitPhotos) -> PhotoDetail:
        """At the size that the photos can fill."""
        size = min(delit.size, delit.natural, LARGEST)
        sources = delit.sources
        if size < delit.size:
            pairs = zip(reconstruction.photos, delit.views, strict=True)
            sources = [prefiltered(photo, view, size) for photo, view in pairs]
        surface = reconstruction.surface
        sigma = _cut(surface, COARSE)
        own = [
            _blurred_over(channel_mean(np.log(np.maximum(c, _DARK))), w > 0, sigma)
            for c, w in zip(delit.colours, delit.weight, strict=True)
        ]
        slopes = list(delit.sky.slopes(delit.lights.coefficients, COARSE))
        usual = float(np.percentile(delit.weight[delit.weight > 0], 90))
        tangents = tangents_of(surface, size)
        return cls(delit, sources, own, slopes, tangents, size, usual)

    def rows(self, rows: slice) -> tuple[Picture, Picture, Picture]:
        """``d`` (n, r, S), ``h`` (2, n, r, S) and weights (n, r, S) of some rows."""
        delit, size, tangents = self.delit, self.size, self.tangents
        shape = len(delit.views), rows.stop - rows.start, size
        d, weight = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        h = np.zeros((2, *shape), np.float32)
        for i, view in enumerate(delit.views):
            # Neighbouring texels of one pixel say the same: they share its weight.
            share = min((view.resolution / size) ** 2, 1.0) / self.usual
            weight[i] = share * np.maximum(resized(delit.weight[i], size, rows), 0)
            if not weight[i].any():
                continue
            colours = sample(self.sources[i], resized(view.xy, size, rows))
            shading = resized(delit.shading[i], size, rows)
            colours = np.maximum(colours, _DARK) / np.maximum(shading, 1e-6)
            d[i] = channel_mean(np.log(colours)) - resized(self.own[i], size, rows)
            slope = resized(self.slopes[i], size, rows)
            for k, dual in enumerate((tangents.dual_u, tangents.dual_v)):
                h[k, i] = -np.einsum("vuc,vuc->vu", slope, dual[rows])
        return d, h, weight


def measure_detail(
    reconstruction: Reconstruction,
    delit: DelitPhotos,
    measured: npt.NDArray[np.bool_],
    check_cancelled: CheckCancelled,
) -> Detail:
    """Normal map and displacement from the shading of all used photos.

    Parameters
    ----------
    reconstruction : Reconstruction
        With pixels.
    delit : DelitPhotos
        Its photos without their light.
    measured : (C, C) bool array
        Places of the coarse grid that enough photos see.
    check_cancelled : callable
        Called now and then; may raise `Cancelled`.
    """
    seen = PhotoDetail.of(reconstruction, delit)
    surface, tangents, size = reconstruction.surface, seen.tangents, seen.size
    evidence = _evidence(seen, check_cancelled)
    lengths = tangents.length_u, tangents.length_v
    height = solve_height(evidence, lengths, check_cancelled)
    sigma = _cut(surface, size)
    height -= cv2.GaussianBlur(height, (0, 0), sigma[0], sigmaY=sigma[1])
    fade = resized(inner_part(measured), size)
    fade = np.clip(fade, 0, 1) * _skin_fade(reconstruction.template, tangents, size)
    height = (height * fade).astype(np.float32)
    return Detail(height, tangent_normals(height, tangents))


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
    return _quantised((detail.normals + 1) / 2, depth)


def displacement_picture(detail: Detail) -> npt.NDArray[np.uint16]:
    """The displacement as a 16-bit picture (S, S): grey 0, white `WHITE_MM`."""
    expect(Detail, "a Detail", detail=detail)
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


def tangents_of(surface: BSplineSurface, size: int) -> Tangents:
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
    normal = np.cross(F_v, F_u)
    normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-9)
    return Tangents(
        dual_u=((G[..., None] * F_u - F[..., None] * F_v) / area).astype(np.float32),
        dual_v=((E[..., None] * F_v - F[..., None] * F_u) / area).astype(np.float32),
        tangent=tangent.astype(np.float32),
        up=np.cross(normal, tangent).astype(np.float32),
        length_u=float(np.median(np.sqrt(E))),
        length_v=float(np.median(np.sqrt(G))),
    )


def _cut(surface: BSplineSurface, size: int) -> tuple[float, float]:
    """Standard deviations of the separating Gaussian in texels, along u and v."""
    m, n = surface.shape
    return _CUT * size / (m - 3), _CUT * size / (n - 3)


def _evidence(seen: PhotoDetail, check_cancelled: CheckCancelled) -> SlopeEvidence:
    """What the photos say about the slopes of each texel."""
    found = SlopeEvidence.empty(seen.size)
    for start in range(0, seen.size, _TILE):
        rows = slice(start, min(start + _TILE, seen.size))
        check_cancelled()
        found.put(rows, *slope_equations(*seen.rows(rows)))
    return found.weighed(_LEAST_NOISE)


def slope_equations(
    d: Picture, h: Picture, weight: Picture, rounds: int = 4
) -> tuple[Picture, Picture, Picture]:
    """Robust normal equations of the slopes, the albedo eliminated.

    Parameters
    ----------
    d : (n, ...) array
        Logarithmic colours of n photos without their light.
    h : (2, n, ...) array
        Their derivatives by the slopes.
    weight : (n, ...) array
    rounds : int

    Returns
    -------
    A : (..., 2, 2) array
    b : (..., 2) array
        ``A x = b`` for the slopes x, as if the noise had variance 1.
    noise : (...) array
        Variance of d; infinite where too few photos see a texel to tell.
    """

    def total_of(a: Picture, b: Picture) -> Picture:
        return np.einsum("n...,n...->...", a, b)

    robust = weight
    shape = weight.shape[1:]
    A, b = np.zeros((*shape, 2, 2), np.float32), np.zeros((*shape, 2), np.float32)
    noise = np.full(shape, np.inf, np.float32)
    for _ in range(rounds):
        part = robust / np.maximum(robust.sum(axis=0), 1e-12)
        rest = d - total_of(part, d)
        turned = [column - total_of(part, column) for column in h]
        for k, column in enumerate(turned):
            weighted = robust * column
            b[..., k] = total_of(weighted, rest)
            for j in range(k, 2):
                A[..., k, j] = A[..., j, k] = total_of(weighted, turned[j])
        # A little of the trace: a direction that no light shows stays flat.
        ridge = 1e-3 * (A[..., 0, 0] + A[..., 1, 1]) + 1e-20
        uu, uv, vv = A[..., 0, 0] + ridge, A[..., 0, 1], A[..., 1, 1] + ridge
        slopes = np.stack(
            (vv * b[..., 0] - uv * b[..., 1], uu * b[..., 1] - uv * b[..., 0])
        )
        slopes /= uu * vv - uv * uv
        rest -= turned[0] * slopes[0]
        rest -= turned[1] * slopes[1]
        square = rest * rest
        # Of as many photos as count, three numbers are fitted.
        count = 1 / np.maximum(total_of(part, part), 1e-12)
        spread = total_of(part, square)
        enough = count > _FEWEST
        noise = np.where(enough, spread * count / np.maximum(count - 3, 1), np.inf)
        robust = weight / (1 + square / _SCALE**2)
    return A, b, noise


def _blurred_over(
    picture: Picture, known: npt.NDArray[np.bool_], sigma: tuple[float, float]
) -> Picture:
    """Gaussian blur over what is known only."""
    mask = known.astype(np.float32)
    total, blurred = (
        cv2.GaussianBlur(part, (0, 0), sigma[0], sigmaY=sigma[1])
        for part in (mask, np.where(known, picture, 0).astype(np.float32))
    )
    return np.where(total > 1e-3, blurred / np.maximum(total, 1e-3), picture)


def _skin_fade(template: Template, tangents: Tangents, size: int) -> Picture:
    """1 on the skin of the face, falling to 0 at eyes, nostrils, lips' gap, outline."""
    at = texel_centres(COARSE)
    uv = np.stack(np.meshgrid(at, at), axis=-1)
    inside = template.inside(uv.reshape(-1, 2)).reshape(uv.shape[:2])
    skin = (template.is_skin(uv) & inside).astype(np.uint8)
    away = cv2.distanceTransform(skin, cv2.DIST_L2, 5)
    millimetres: Array = away * (tangents.length_u + tangents.length_v) / (2 * COARSE)
    t = np.clip(resized(millimetres, size) / _FADE_MM, 0, 1)
    return np.asarray(t * t * (3 - 2 * t), np.float32)
