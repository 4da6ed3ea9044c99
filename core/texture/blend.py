"""Blending of photos that are divided by their light, on the surface's (u, v).

The steps of :mod:`.texture`: a robust mean, the choice of one photo where details
disagree, the two bands, and the filling of what no photo sees.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from ..progress import CheckCancelled, never_cancelled
from .views import View, channel_mean, resized, sample

Picture = npt.NDArray[np.float32]

#: Texels a side of the pictures on which views, lights and the coarse band live.
COARSE = 256
_SCALE = 0.12  # Cauchy scale of relative differences between photos
# Weight of all photos together from which on a place counts as measured, relative to
# the well-seen places.
_SEEN = 0.05
# Relative spread between photos up to which they are averaged, from which on the best
# is chosen, and the power that chooses.
_AGREE, _DISAGREE, _POWER = 0.09, 0.18, 30.0
# Least difference that counts as usual, and multiple of the usual one from which on a
# photo is left out.
_USUAL, _UNEXPLAINED = 0.05, 3.0
_FINE = 1.5  # power of the weights in the fine band
_ROWS = 32  # of the coarse grid at a time: what a processor's cache holds
_EYES_END = 0.42  # v between eyes and mouth, at the nose


def measured_places(weight: Picture) -> npt.NDArray[np.bool_]:
    """Places that enough photos see well enough: one piece without holes.

    What only a photo or two see at a grazing angle, under the chin for instance, is as
    often collar as skin.
    """
    seen = cv2.GaussianBlur(weight.sum(axis=0), (0, 0), COARSE / 128)
    mask = (seen > _SEEN * np.percentile(seen, 90)).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    if count > 1:
        largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
        mask = (labels == largest).astype(np.uint8)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(mask, outlines, -1, (1,), cv2.FILLED)
    # A hole that no photo sees at all stays one.
    return mask.astype(bool) & (seen > 0)


def inner_part(measured: npt.NDArray[np.bool_]) -> Picture:
    """1 inside the measured places, falling softly to 0 at their rim."""
    away = cv2.distanceTransform(
        np.pad(measured, 1, mode="edge").astype(np.uint8), cv2.DIST_L2, 5
    )[1:-1, 1:-1]
    return np.asarray(np.clip(away / (COARSE / 64), 0, 1), np.float32)


def consensus(
    delit: Picture,
    weight: Picture,
    start: Picture,
    check_cancelled: CheckCancelled = never_cancelled,
) -> tuple[Picture, Picture]:
    """Robust mean over photos, and how far each photo agrees with it.

    Parameters
    ----------
    delit : (n, S, S, 3) array
    weight : (n, S, S) array
    start : (S, S, 3) array
        See `weighted_median`.

    Returns
    -------
    base : (S, S, 3) array
    agreement : (n, S, S) array in (0, 1]
    """
    base = np.array(start, np.float32)
    agreement = np.ones_like(weight, np.float32)
    for first in range(0, len(base), _ROWS):
        check_cancelled()
        rows = slice(first, first + _ROWS)
        values, seen = channels_first(delit[:, rows]), weight[:, rows]
        mean = channels_first(base[rows])
        for _ in range(4):
            level = np.maximum(mean.mean(axis=0), 1e-4)
            away = (values - mean) / level
            square = np.einsum("ncvu,ncvu->nvu", away, away) / 3
            agreement[:, rows] = 1 / (1 + square / _SCALE**2)
            trust = seen * agreement[:, rows]
            total = trust.sum(axis=0)
            found = np.einsum("nvu,ncvu->cvu", trust, values)
            mean = np.where(total > 0, found / np.maximum(total, 1e-12), mean)
        base[rows] = np.moveaxis(mean, 0, -1)
    return base, agreement


def channels_first(pictures: Picture) -> Picture:
    """(..., S, S, 3) as (..., 3, S, S): sums over the axis of three are slow."""
    return np.ascontiguousarray(np.moveaxis(pictures, -1, -3))


def weighted_median(
    values: Picture, weight: Picture, check_cancelled: CheckCancelled = never_cancelled
) -> Picture:
    """Of each channel over the photos; (n, S, S, 3) and (n, S, S) to (S, S, 3).

    With many photos and few outliers the mean would do, with hair over half of them it
    would not.
    """
    result = np.empty(values.shape[1:], np.float32)
    for row in range(values.shape[1]):
        check_cancelled()
        part = values[:, row]
        order = np.argsort(part, axis=0)
        share = np.take_along_axis(
            np.broadcast_to(weight[:, row, :, None], part.shape), order, axis=0
        )
        share = np.cumsum(share, axis=0)
        index = (share < 0.5 * share[-1:]).sum(axis=0, keepdims=True)
        index = np.minimum(index, len(values) - 1)
        ordered = np.take_along_axis(part, order, axis=0)
        result[row] = np.take_along_axis(ordered, index, axis=0)[0]
    return result


def explained(
    delit: Picture, weight: Picture, base: Picture
) -> npt.NDArray[np.float32]:
    """How far each photo divided by its light is the skin that all show, ``(n,)``.

    1 for a usual photo, falling to 0 for one whose colours no light explains: painted,
    tinted in parts, or of somebody else.
    """
    level = np.maximum(channel_mean(base), 1e-4)
    total = np.maximum(weight.sum(axis=(1, 2)), 1e-12)
    misfit = np.empty(len(delit))
    for i, picture in enumerate(delit):
        away = np.minimum(channel_mean(np.abs(picture - base)) / level, 1)
        misfit[i] = (weight[i] * away).sum() / total[i]
    usual = max(float(np.median(misfit)), _USUAL)
    return np.clip(_UNEXPLAINED - misfit / usual, 0, 1).astype(np.float32)


def choose_where_disagreeing(
    weight: Picture,
    agreement: Picture,
    delit: Picture,
    base: Picture,
    eyes: npt.NDArray[np.float64],
    mouth: npt.NDArray[np.float64],
) -> Picture:
    """Weights that pick one photo where details disagree and average elsewhere.

    The mean of different gazes, or of hair that moved, is a smear. There the weights
    are raised to a power, so that the best of the typical photos wins. Only detail
    counts: a shadow is a broad difference, and averaging is what removes it.

    Parameters
    ----------
    weight, agreement : (n, S, S) arrays
    delit : (n, S, S, 3) array
        Photos divided by their light.
    base : (S, S, 3) array
        Their robust mean.
    eyes, mouth : (n,) arrays
        How willingly each photo is chosen in the upper and in the lower half.
    """
    level = np.maximum(channel_mean(base), 1e-4)
    fine = np.stack([d - cv2.GaussianBlur(d, (0, 0), COARSE / 64) for d in delit])
    total = np.maximum(weight.sum(axis=0), 1e-12)
    centre = (weight[..., None] * fine).sum(axis=0) / total[..., None]
    square = channel_mean((fine - centre) ** 2) / level**2
    spread = np.sqrt((weight * np.minimum(square, 1)).sum(axis=0) / total)
    spread = cv2.GaussianBlur(spread, (0, 0), COARSE / 64)
    rise = np.clip((spread - _AGREE) / (_DISAGREE - _AGREE), 0, 1)
    rise = rise * rise * (3 - 2 * rise)
    power = 1 + (_POWER - 1) * rise
    # One order of the photos for all such places of the upper half, one for those of
    # the lower: else an eye would be put together from several gazes, or the two eyes
    # would look in different directions.
    typical = np.empty_like(weight)
    middle = round(_EYES_END * COARSE)
    for half, prior in ((slice(0, middle), eyes), (slice(middle, COARSE), mouth)):
        chosen = (weight * agreement * rise)[:, half].sum(axis=(1, 2)) * prior
        typical[:, half] = (chosen / max(float(chosen.max()), 1e-12))[:, None, None]
    sees = weight / (weight + 0.2 * weight.max(axis=(1, 2), keepdims=True) + 1e-12)
    near = np.stack([_blurred(a, 170) for a in agreement])
    quality = weight * near * (1 - rise) + typical * sees * total * rise
    best = np.maximum(quality.max(axis=0), 1e-12)
    return ((quality / best) ** power * best).astype(np.float32)


def _blurred(picture: Picture, part: float) -> Picture:
    """Gaussian blur by the given part of the coarse grid."""
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), COARSE / part), np.float32)


def coarse_band(picture: Picture, known: npt.NDArray[np.bool_]) -> Picture:
    """Coarse band of a (u, v) picture, blurred over what is known only."""
    sigma = COARSE / 64
    mask = known.astype(np.float32)
    total = cv2.GaussianBlur(mask, (0, 0), sigma)[..., None]
    blurred = cv2.GaussianBlur(picture * mask[..., None], (0, 0), sigma)
    return np.where(total > 1e-3, blurred / np.maximum(total, 1e-3), picture)


def fine_band(
    sources: list[Picture],
    views: list[View],
    shading: Picture,
    own: Picture,
    weight: Picture,
    *,
    size: int,
    rows: slice,
    check_cancelled: CheckCancelled = never_cancelled,
) -> Picture:
    """Detail finer than the coarse band, for some rows of the texture."""
    detail, trust = [], []
    # Only photos of some weight: the rest cannot matter, and costs time.
    strongest = resized(weight.max(axis=0), size, rows)
    for i, view in enumerate(views):
        check_cancelled()
        w = np.maximum(resized(weight[i], size, rows), 0)
        w = np.where(w > 0.1 * strongest, w, 0)
        if not w.any():
            continue
        colours = sample(sources[i], resized(view.xy, size, rows))
        colours /= np.maximum(resized(shading[i], size, rows), 1e-6)
        detail.append(channels_first(colours - resized(own[i], size, rows)))
        trust.append(w**_FINE)
    if not detail:
        return np.zeros((rows.stop - rows.start, size, 3), np.float32)
    stack, weights = np.stack(detail), np.stack(trust)
    mean = np.zeros(stack.shape[1:], np.float32)
    robust = weights
    for _ in range(3):
        check_cancelled()
        total = np.maximum(robust.sum(axis=0), 1e-12)
        mean = np.einsum("nrs,ncrs->crs", robust, stack) / total
        away = stack - mean
        square = np.einsum("ncrs,ncrs->nrs", away, away) / 3
        # The usual difference varies slowly: every second texel will do.
        spread = np.median(square[:, ::2, ::2], axis=0).repeat(2, 0).repeat(2, 1)
        spread = np.maximum(spread[: square.shape[1], : square.shape[2]], 1e-6)
        robust = weights / (1 + square / (4 * spread))
    return np.moveaxis(mean, 0, -1)


def fill(picture: Picture, known: npt.NDArray[np.bool_]) -> Picture:
    """Fill unknown texels from around them by a pyramid (push-pull)."""
    levels = [(picture * known[..., None], known.astype(np.float32))]
    while min(levels[-1][1].shape) > 1:
        colours, mask = levels[-1]
        half = (max(1, mask.shape[1] // 2), max(1, mask.shape[0] // 2))
        small = cv2.resize(mask, half, interpolation=cv2.INTER_AREA)
        sums = cv2.resize(colours, half, interpolation=cv2.INTER_AREA)
        filled = np.where(small[..., None] > 0, sums, 0)
        # Coarser levels hold averages of what is known, at full strength.
        strength = np.minimum(4 * small, 1)
        filled = filled * (strength / np.maximum(small, 1e-9))[..., None]
        levels.append((filled, strength))
    result = levels[-1][0] / max(float(levels[-1][1].max()), 1e-9)
    for colours, mask in levels[-2::-1]:
        shape = (mask.shape[1], mask.shape[0])
        wide = cv2.resize(result, shape, interpolation=cv2.INTER_LINEAR)
        result = colours + (1 - mask[..., None]) * wide.reshape(colours.shape)
    return result.astype(np.float32)
