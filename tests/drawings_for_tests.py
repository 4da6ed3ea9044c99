"""Photos to drawings and paintings, and to worse photos, pixel by pixel in place."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import cv2
import numpy as np

Style = Callable[[np.ndarray], np.ndarray]


def few_colours(rgb: np.ndarray, count: int) -> np.ndarray:
    """Each pixel in the nearest of so many colours, by k-means."""
    smooth = cv2.medianBlur(np.ascontiguousarray(rgb), 5)
    flat = smooth.reshape(-1, 3).astype(np.float32)
    some = flat[:: max(len(flat) // 10_000, 1)]
    cv2.setRNGSeed(1)
    stop = (cv2.TERM_CRITERIA_COUNT, 15, 0.0)
    _, _, centres = cv2.kmeans(some, count, None, stop, 1, cv2.KMEANS_PP_CENTERS)
    nearest = ((flat[:, None] - centres) ** 2).sum(axis=2).argmin(axis=1)
    return centres[nearest].reshape(rgb.shape).round().astype(np.uint8)


def comic(rgb: np.ndarray) -> np.ndarray:
    """Flat areas, few levels, black outlines."""
    flat = np.ascontiguousarray(rgb)
    for _ in range(4):
        flat = cv2.bilateralFilter(flat, 9, 40, 9)
    flat = (flat // 32 * 32 + 16).astype(np.uint8)
    grey = cv2.medianBlur(cv2.cvtColor(flat, cv2.COLOR_RGB2GRAY), 5)
    kind = (cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY)
    return flat & cv2.adaptiveThreshold(grey, 255, *kind, 9, 4)[..., None]


def toon(rgb: np.ndarray) -> np.ndarray:
    """Smooth as plastic, with strong colours."""
    flat = np.ascontiguousarray(rgb)
    for _ in range(3):
        flat = cv2.edgePreservingFilter(flat, flags=1, sigma_s=30, sigma_r=0.3)
    hsv = cv2.cvtColor(flat, cv2.COLOR_RGB2HSV).astype(int)
    hsv[..., 1] = np.minimum(hsv[..., 1] * 1.4, 255)
    return cv2.cvtColor(hsv.astype(np.uint8), cv2.COLOR_HSV2RGB)


def oil(rgb: np.ndarray) -> np.ndarray:
    """Brush strokes: at each pixel the calmest of four neighbourhoods (Kuwahara)."""
    side, shift = 5, 2
    grey = cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2GRAY).astype(float)
    mean = cv2.blur(rgb.astype(float), (side, side))
    spread = cv2.blur(grey**2, (side, side)) - cv2.blur(grey, (side, side)) ** 2
    shifts = [(y, x) for y in (-shift, shift) for x in (-shift, shift)]
    means = np.stack([np.roll(mean, s, (0, 1)) for s in shifts])
    calm = np.stack([np.roll(spread, s, (0, 1)) for s in shifts]).argmin(axis=0)
    return np.take_along_axis(means, calm[None, ..., None], 0)[0].astype(np.uint8)


def pencil(rgb: np.ndarray) -> np.ndarray:
    grey, _ = cv2.pencilSketch(
        np.ascontiguousarray(rgb), sigma_s=40, sigma_r=0.07, shade_factor=0.03
    )
    return np.repeat(grey[..., None], 3, axis=2)


def worse(rgb: np.ndarray, quality: int) -> np.ndarray:
    """As JPEG of low quality."""
    options = [cv2.IMWRITE_JPEG_QUALITY, quality]
    _, data = cv2.imencode(".jpg", np.ascontiguousarray(rgb[..., ::-1]), options)
    return cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1]


def noisy(rgb: np.ndarray) -> np.ndarray:
    noise = np.random.default_rng(0).normal(0, 12, rgb.shape)
    return np.clip(rgb + noise, 0, 255).astype(np.uint8)


def soft(rgb: np.ndarray) -> np.ndarray:
    """Made small and large again."""
    h, w = rgb.shape[:2]
    small = cv2.resize(rgb, (w // 2, h // 2), interpolation=cv2.INTER_AREA)
    return cv2.resize(small, (w, h), interpolation=cv2.INTER_CUBIC)


DRAWINGS: Mapping[str, Style] = {
    "6 colours": lambda rgb: few_colours(rgb, 6),
    "12 colours": lambda rgb: few_colours(rgb, 12),
    "5 levels": lambda rgb: (rgb // 51 * 51 + 25).astype(np.uint8),
    "comic": comic,
    "pencil": pencil,
    "toon": toon,
    "stylised": lambda rgb: cv2.stylization(
        np.ascontiguousarray(rgb), sigma_s=60, sigma_r=0.45
    ),
    "oil": oil,
}
PHOTOS: Mapping[str, Style] = {
    "as it is": lambda rgb: rgb,
    "JPEG 30": lambda rgb: worse(rgb, 30),
    "noise": noisy,
    "soft": soft,
    "grey": lambda rgb: np.repeat(rgb.mean(2, keepdims=True), 3, 2).astype(np.uint8),
    "dark": lambda rgb: (rgb * 0.2).astype(np.uint8),
    "burnt out": lambda rgb: np.minimum(rgb * 1.5, 255).astype(np.uint8),
}
