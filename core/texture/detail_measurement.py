"""Relief that the control net cannot hold, measured in the shading of all photos.

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

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from .._types import Array
from ..progress import CheckCancelled
from ..result import Reconstruction
from ..surface.bspline import BSplineSurface
from ..surface.template import Template
from .blend import COARSE, inner_part
from .delit import DelitPhotos
from .detail import Detail, Tangents, tangent_normals, tangents_of
from .height import SlopeEvidence, solve_height
from .views import channel_mean, prefiltered, resized, sample, texel_centres

Picture = npt.NDArray[np.float32]

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
