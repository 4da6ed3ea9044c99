"""Which pixels of a photo are skin of this face: hair, clothes and background are not.

Each photo is divided by its own light, fitted to the middle of the face, which leaves
the colour of what is there.  The spread of that colour over the middle of the face in
all photos is this person's skin.  Towards the outline of the face, where hair, collars
and the background lie, a pixel counts as skin as far as its colour is likely under that
spread; then the light is fitted again to all that is skin.  Within the outline brows,
lips and shadows differ from skin as much as any hair does, and are told apart by the
robust weights of the methods.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial import cKDTree

from .._types import Array, Array32, Mask, Picture8
from ..camera.camera import Camera
from ..images.photo import Photo, Window, cut, pixels_in, pixels_of
from ..images.remap import interpolate
from ..progress import CheckCancelled, never_cancelled
from ..surface.bspline import BSplineSurface
from ..surface.template import Template
from . import harmonics
from .lighting import robust_weights, shading_of, solve_albedo, solve_lights
from .sampling import smooth_photo, view_weights

GRID = 48  #: samples on a side of the parameter square
MIDDLE = 0.15  #: distance from the outline, in (u, v), at which the middle begins
BLUR_MM = 1.5
GRAZING = 0.2  #: cosine of the viewing angle below which the light is not fitted
ROUNDS = 4
LIGHT_ROUNDS = 5
NOISE = 0.15  #: Cauchy scale of intensities, relative to the photo's median
#: Of the lights, relative: what the middle does not show of them stays even.
RIDGE = np.array([1e-4] * 4 + [0.03] * 5)
#: Range of the shading about the photo's median: a light fitted to the middle of the
#: face may be anything beyond it.
SHADING = (0.25, 2.5)
BLACK = 2e-3  #: linear intensity below which colours are noise
#: Luminance, red over green, blue over green of logarithmic colours.
OPPONENT = np.array([[0.3, 0.6, 0.1], [1.0, -1.0, 0.0], [0.0, -1.0, 1.0]]).T
#: Smallest standard deviations of these, and factor on that of the luminance: shadows
#: that the nine harmonics do not follow.
LEAST_SPREAD = np.array([0.25, 0.06, 0.05])
SHADOWED = 1.5
#: Standard deviations up to which a colour is skin, and from which on it is not.
SKIN, OTHER = 5.0, 8.0
PIXEL_MM = 1.2  #: of the masks
MARGIN_MM = 15.0  #: of the masks about the face
NEIGHBOURS = 6
NEAR_MM = 4.0  #: a pixel farther than this from all samples is not on the face
SOFT_MM = 0.8  #: standard deviation of the Gaussian that softens the masks
FEWEST = 30  #: samples of the middle without which a photo has no mask


@dataclass(frozen=True, eq=False)
class SkinMask:
    """How far each pixel of a photo is skin of the face.

    Attributes
    ----------
    values : (h, w) float32 array
        1 = skin, 0 = something else.
    window : Window
        Which part of the original the mask covers.
    measured : (h, w) float32 array or None
        The values before the photo's own mask corrected them; None without one.
    """

    values: Array32
    window: Window
    measured: Array32 | None = None

    def read(self, xy: Array) -> Array:
        """The mask at pixels (p, 2) of the original, ``(p,)``; as at its rim beyond."""
        return interpolate(self.values, pixels_in(self.window, xy))

    def on(self, photo: Photo) -> Array32:
        """The mask in the pixels of a cut-out, ``(h, w)``."""
        h, w = photo.pixels.shape[:2]
        xy = _original_pixels((h, w), photo.window)
        return self.read(xy).reshape(h, w).astype(np.float32)


def _original_pixels(shape: tuple[int, ...], window: Window) -> Array:
    """Pixels of the original under those of a part of it, row by row, (h * w, 2)."""
    y, x = np.indices(shape[:2])
    return pixels_of(window, np.stack([x, y], -1).reshape(-1, 2))


class _Colours(NamedTuple):
    """Colours of n photos at p samples of the surface, by their light and the rest.

    Attributes
    ----------
    middle : (p,) bool array
        Samples of the middle of the face.
    xy : (n, p, 2) array
        Pixels of the original.
    seen : (n, p) bool array
    shading : (n, p, 3) array
        Logarithm of what skin would show.
    spread : (3,) array
        Standard deviations of the skin in the opponent colours.
    """

    middle: Mask
    xy: Array
    seen: Mask
    shading: Array
    spread: Array


def skin_masks(
    photos: Sequence[Photo],
    faces: BSplineSurface | Sequence[BSplineSurface],
    cameras: Sequence[Camera],
    template: Template,
    check_cancelled: CheckCancelled = never_cancelled,
) -> tuple[SkinMask, ...]:
    """What is skin of the face in each photo, corrected by the photos' mask files.

    Parameters
    ----------
    photos : sequence of n Photo
    faces : BSplineSurface, or sequence of n
        The face that all photos share, or that with the expression of each.
    cameras : sequence of n Camera
    template : Template
    check_cancelled : callable
        Called for each photo; may raise `Cancelled`.
    """
    colours = _colours(photos, faces, cameras, template, check_cancelled)
    masks = []
    for i, (photo, camera) in enumerate(zip(photos, cameras, strict=True)):
        check_cancelled()
        mask = _mask(photo, camera, colours, i)
        if photo.mask is not None:
            scale = photo.mask.shape[1] / photo.size[0]
            mask = corrected(mask, SkinMask(photo.mask, (0.0, 0.0, scale)))
        masks.append(mask)
    return tuple(masks)


def corrected(mask: SkinMask, given: SkinMask) -> SkinMask:
    """A measured mask as another one has it, whose 0.5 leaves it as it is."""
    if mask.values.size == 1:
        # nothing was measured: there is no grid yet to correct it on
        mask = replace(given, values=np.ones_like(given.values))
    at = _original_pixels(mask.values.shape, mask.window)
    say = 2 * given.read(at).reshape(mask.values.shape).astype(np.float32) - 1
    values = np.where(say > 0, mask.values + say * (1 - mask.values), mask.values)
    values *= 1 + np.minimum(say, 0)
    return replace(mask, values=values, measured=mask.values)


def overlay(photo: Photo, mask: SkinMask) -> Picture8:
    """The cut-out with all that is not skin tinted magenta, ``(h, w, 3)``."""
    picture = photo.bytes8().astype(np.float32)
    other = 1 - mask.on(photo)[..., None]
    tint = np.array([200.0, 0.0, 200.0], np.float32)
    mixed = picture * (1 - 0.65 * other) + 0.5 * other * tint
    return np.clip(np.round(mixed), 0, 255).astype(np.uint8)


def _colours(
    photos: Sequence[Photo],
    faces: BSplineSurface | Sequence[BSplineSurface],
    cameras: Sequence[Camera],
    template: Template,
    check_cancelled: CheckCancelled,
) -> _Colours:
    uv = _samples(template)
    middle = _from_outline(template, uv) > MIDDLE
    even = template.is_skin(uv)  # not eyes, nostrils, the gap between the lips
    view = view_weights(faces, cameras, uv, 0.0)
    shared = isinstance(faces, BSplineSurface)
    own = [faces] * len(photos) if shared else list(faces)
    xy = np.zeros((*view.shape, 2))
    values = np.zeros((*view.shape, 3))
    exposure = np.ones((len(photos), 1, 3))
    for i, (photo, camera) in enumerate(zip(photos, cameras, strict=True)):
        check_cancelled()
        xy[i] = camera.project(own[i].evaluate(*uv.T))
        field = smooth_photo(photo, camera, BLUR_MM, colour=True)
        found, _, inside = field.read(xy[i])
        view[i] *= inside
        values[i] = np.maximum(found, BLACK)
        exposure[i] = _median(values[i], middle & even & (view[i] > GRAZING), 1.0)
    seen = view > 0
    known = (view > GRAZING) & middle & even
    values /= exposure
    different = own[:1] if shared else own
    Y = np.stack([harmonics.basis(face.normals(*uv.T)) for face in different])
    skin = known.astype(float)
    albedo = np.ones(values.shape[1:])
    shading = np.zeros_like(values)
    spread = LEAST_SPREAD
    for _ in range(ROUNDS):
        check_cancelled()
        for c in range(3):
            albedo[:, c], shading[..., c] = _relight(
                values[..., c], view * skin, Y, albedo[:, c]
            )
        colour = np.log(values) - np.log(shading)
        for i in range(len(photos)):
            # White balance and exposure of the photo, so that its skin is at 0.
            centre = _median(colour[i], known[i], 0.0)
            shading[i] *= np.exp(centre)
            colour[i] -= centre
        colour = np.asarray(colour @ OPPONENT, float)
        if known.any():
            spread = 1.4826 * np.median(np.abs(colour[known]), axis=0)
            spread = np.maximum(spread, LEAST_SPREAD) * (SHADOWED, 1, 1)
        skin = np.where(middle, 1.0, _likeness(colour, spread)) * (
            even & (view > GRAZING)
        )
    return _Colours(middle, xy, seen, np.log(shading * exposure), spread)


def _relight(
    values: Array, trusted: Array, Y: Array, albedo: Array
) -> tuple[Array, Array]:
    """Albedo (p,) and shading (n, p) of one channel under robust lights."""
    W = trusted
    s = np.ones_like(values)
    for _ in range(LIGHT_ROUNDS):
        lights = solve_lights(values, W, Y, albedo, RIDGE)
        s = np.clip(shading_of(lights, Y), *SHADING)
        W = robust_weights(trusted, values - albedo * s, NOISE)
    return solve_albedo(values, W, s), s


def _median(colours: Array, which: Mask, default: float) -> Array:
    """Median colour of some samples, ``(3,)``."""
    return np.median(colours[which], axis=0) if which.any() else np.full(3, default)


def _likeness(colour: Array, spread: Array) -> Array:
    """1 for the colour of skin, falling to 0; of opponent colours about it, (..., 3).

    Brighter than skin is still skin: highlights.
    """
    away = colour / spread
    away[..., 0] = np.minimum(away[..., 0], 0.0)
    distance = np.linalg.norm(away, axis=-1)
    t = np.clip((OTHER - distance) / (OTHER - SKIN), 0, 1)
    return t * t * (3 - 2 * t)


def _mask(photo: Photo, camera: Camera, colours: _Colours, i: int) -> SkinMask:
    """The mask of photo ``i``: the colours of all pixels about the face."""
    seen = colours.seen[i]
    if (seen & colours.middle).sum() < FEWEST:
        return SkinMask(np.ones((1, 1), np.float32), photo.window)
    xy = colours.xy[i, seen]
    margin = MARGIN_MM * camera.s
    box = np.concatenate([xy.min(0) - margin, xy.max(0) + margin])
    part = cut(photo, box, max_side=max(photo.pixels.shape))
    x0, y0, scale = part.window
    shrink = max(1.0, PIXEL_MM * camera.s * scale)
    # With dsize empty both axes shrink by exactly this factor.
    small = cv2.resize(
        part.linear(), None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA
    )
    scale /= shrink
    h, w = small.shape[:2]
    light, inner = _expected((h, w), (x0, y0, scale), camera, colours, i)
    colour = np.log(np.maximum(small, BLACK)) - light
    skin = np.where(inner, 1.0, _likeness(colour @ OPPONENT, colours.spread))
    skin = skin.astype(np.float32)
    # Softened inwards: a pixel beside hair is part hair.
    sigma = max(SOFT_MM * camera.s * scale, 0.3)
    skin = 2 * cv2.GaussianBlur(skin, (0, 0), sigma) - 1
    return SkinMask(np.clip(skin, 0, 1).astype(np.float32), (x0, y0, scale))


def _expected(
    shape: tuple[int, int],
    window: Window,
    camera: Camera,
    colours: _Colours,
    i: int,
) -> tuple[Array32, Mask]:
    """What skin would show (h, w, 3), and what is the middle of the face, (h, w).

    Both are smooth, so they are looked up at half the resolution of the mask.
    """
    h, w = shape
    x0, y0, scale = window
    half = (h + 1) // 2, (w + 1) // 2
    seen = colours.seen[i]
    at = _original_pixels(half, (x0, y0, scale / 2))
    tree = cKDTree(colours.xy[i, seen] / camera.s)
    distance, nearest = tree.query(at / camera.s, k=NEIGHBOURS)
    # Beyond all samples the nearest ones decide.
    weight = np.exp(-0.5 * (distance / NEAR_MM) ** 2)
    weight += 1e-12 / np.square(np.square(1 + distance))
    weight /= weight.sum(1, keepdims=True)
    shading = np.einsum("pk,pkc->pc", weight, colours.shading[i, seen][nearest])
    inner = np.einsum("pk,pk->p", weight, colours.middle[seen][nearest])
    inner[distance[:, 0] >= NEAR_MM] = 0
    both = np.concatenate([shading, inner[:, None]], 1).reshape(*half, 4)
    both = cv2.resize(both.astype(np.float32), None, fx=2, fy=2)[:h, :w]
    both = np.asarray(both, np.float32)
    return both[..., :3], both[..., 3] > 0.5


def _samples(template: Template) -> Array:
    """The face on a regular grid of (u, v), ``(p, 2)``."""
    x = (np.arange(GRID) + 0.5) / GRID
    uv = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    return uv[template.is_skin(uv) | template.inside(uv)]


def _from_outline(template: Template, uv: Array) -> Array:
    """Distance from the face's outline in (u, v), negative outside, ``(p,)``."""
    polygon = template.outline_uv.astype(np.float32)[:, None]
    points = uv.astype(np.float32)
    return np.array(
        [cv2.pointPolygonTest(polygon, (float(u), float(v)), True) for u, v in points]
    )
