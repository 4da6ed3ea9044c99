"""Small SVG plots for the report, drawn here so that the page needs nothing else.

Colours come from the page's style sheet (classes ``label``, ``grid``, ``dot``, ...), so
that plots follow its light or dark scheme.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from .._types import Array
from ..result import HistoryEntry

WIDTH, HEIGHT = 360, 270
_LEFT, _RIGHT, _TOP, _BOTTOM = 56, 10, 14, 36


def _svg(body: Sequence[str], label: str) -> str:
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(label)}">'
        + "".join(body)
        + "</svg>"
    )


def _text(x: float, y: float, text: str, anchor: str = "middle", kind: str = "") -> str:
    extra = f' class="{kind}"' if kind else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{extra}>'
        f"{escape(text)}</text>"
    )


class _Axes:
    """A rectangle of data inside the picture."""

    def __init__(
        self, x: tuple[float, float], y: tuple[float, float], labels: tuple[str, str]
    ) -> None:
        self.x, self.y, self.labels = x, y, labels

    def at(self, x: float, y: float) -> tuple[float, float]:
        width, height = WIDTH - _LEFT - _RIGHT, HEIGHT - _TOP - _BOTTOM
        across = (x - self.x[0]) / (self.x[1] - self.x[0] or 1)
        up = (y - self.y[0]) / (self.y[1] - self.y[0] or 1)
        return _LEFT + across * width, _TOP + (1 - up) * height

    def frame(
        self, x_ticks: Sequence[float], y_ticks: Sequence[tuple[float, str]]
    ) -> list[str]:
        parts = []
        for tick in x_ticks:
            x, bottom = self.at(tick, self.y[0])
            _, top = self.at(tick, self.y[1])
            parts.append(
                f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{top:.1f}" '
                f'y2="{bottom:.1f}"/>'
            )
            parts.append(_text(x, bottom + 14, f"{tick:g}"))
        for tick, name in y_ticks:
            left, y = self.at(self.x[0], tick)
            right, _ = self.at(self.x[1], tick)
            parts.append(
                f'<line class="grid" x1="{left:.1f}" x2="{right:.1f}" y1="{y:.1f}" '
                f'y2="{y:.1f}"/>'
            )
            parts.append(_text(left - 5, y + 3.5, name, "end"))
        middle = (_LEFT + WIDTH - _RIGHT) / 2
        parts.append(_text(middle, HEIGHT - 6, self.labels[0], kind="label"))
        y = (_TOP + HEIGHT - _BOTTOM) / 2
        parts.append(
            f'<text class="label" text-anchor="middle" '
            f'transform="translate(10 {y:.1f}) rotate(-90)">{escape(self.labels[1])}'
            "</text>"
        )
        return parts


def pose_plot(yaw: Array, pitch: Array, names: Sequence[str]) -> str:
    """Where the head looks in each photo, and the zones that should not be empty."""
    reach_x = max(60.0, 10 * np.ceil(np.abs(yaw).max(initial=0) / 10 + 0.5))
    reach_y = max(30.0, 10 * np.ceil(np.abs(pitch).max(initial=0) / 10 + 0.5))
    axes = _Axes(
        (-reach_x, reach_x),
        (-reach_y, reach_y),
        ("yaw: nose to the picture's left or right, degrees", "pitch: up, degrees"),
    )
    parts = []
    for low_x, high_x, low_y, high_y, count in pose_zones(yaw, pitch):
        x0, y1 = axes.at(max(low_x, -reach_x), max(low_y, -reach_y))
        x1, y0 = axes.at(min(high_x, reach_x), min(high_y, reach_y))
        kind = "zone" if count else "zone empty"
        parts.append(
            f'<rect class="{kind}" x="{x0:.1f}" y="{y0:.1f}" width="{x1 - x0:.1f}" '
            f'height="{y1 - y0:.1f}" rx="3"/>'
        )
    ticks = [t for t in range(-90, 91, 30) if abs(t) <= reach_x]
    levels = [t for t in range(-90, 91, 15) if abs(t) <= reach_y]
    parts += axes.frame(ticks, [(t, f"{t}") for t in levels])
    for x, y, name in zip(yaw, pitch, names, strict=True):
        px, py = axes.at(float(x), float(y))
        parts.append(
            f'<circle class="dot" cx="{px:.1f}" cy="{py:.1f}" r="4">'
            f"<title>{escape(name)}: yaw {x:.0f}, pitch {y:.0f}</title></circle>"
        )
    return _svg(parts, "Poses of the photos")


def pose_zones(yaw: Array, pitch: Array) -> list[tuple[float, ...]]:
    """(yaw from, to, pitch from, to, photos in it): a 3 x 3 grid of views."""
    zones = []
    for low_x, high_x in ((-75.0, -20.0), (-20.0, 20.0), (20.0, 75.0)):
        for low_y, high_y in ((-40.0, -8.0), (-8.0, 8.0), (8.0, 40.0)):
            inside = (yaw >= low_x) & (yaw < high_x) & (pitch >= low_y)
            count = float((inside & (pitch < high_y)).sum())
            zones.append((low_x, high_x, low_y, high_y, count))
    return zones


def light_plot(lights: Array, names: Sequence[str]) -> str:
    """Main direction of each photo's light as seen from the camera of a frontal photo.

    The middle is light from the front, the inner circle 45 degrees, the rim 90 and
    more; a larger dot is a harder light.
    """
    cx, cy, radius = WIDTH / 2, (HEIGHT - 24) / 2 + 4, (HEIGHT - 50) / 2
    parts = [
        f'<circle class="disc" cx="{cx}" cy="{cy}" r="{radius}"/>',
        f'<circle class="ring" cx="{cx}" cy="{cy}" r="{radius / 2}"/>',
        f'<path class="grid" d="M{cx - radius} {cy}h{2 * radius}"/>',
        f'<path class="grid" d="M{cx} {cy - radius}v{2 * radius}"/>',
        _text(cx, cy - radius - 4, "from above"),
        _text(cx, cy + radius + 13, "from below"),
        _text(cx - radius - 6, cy + 4, "left", "end"),
        _text(cx + radius + 6, cy + 4, "right", "start"),
    ]
    for (azimuth, angle), strength, name in zip(
        *light_directions(lights), names, strict=True
    ):
        r = radius * min(angle / 90, 1.0)
        x, y = cx + r * np.cos(azimuth), cy - r * np.sin(azimuth)
        size = 2.5 + 3.5 * min(strength, 1.2)
        parts.append(
            f'<circle class="light" cx="{x:.1f}" cy="{y:.1f}" r="{size:.1f}">'
            f"<title>{escape(name)}: {angle:.0f} degrees from the front</title>"
            "</circle>"
        )
    return _svg(parts, "Directions of the light")


def light_directions(lights: Array) -> tuple[Array, Array]:
    """Azimuth (radians, 0 = right, counter-clockwise) and angle from the front.

    Parameters
    ----------
    lights : (n, 9) array
        Harmonics in head axes; the linear terms point to the light.

    Returns
    -------
    directions : (n, 2) array
        Azimuth in radians, angle in degrees.
    strength : (n,) array
        Directed part relative to the mean light.
    """
    linear = np.asarray(lights, float)[:, 1:4]
    size = np.linalg.norm(linear, axis=1)
    unit = linear / np.maximum(size, 1e-12)[:, None]
    azimuth = np.arctan2(unit[:, 1], unit[:, 0])
    angle = np.degrees(np.arccos(np.clip(unit[:, 2], -1, 1)))
    strength = size / np.maximum(np.abs(np.asarray(lights)[:, 0]), 1e-12)
    return np.stack([azimuth, angle], axis=1), strength


def singular_plot(values: Array) -> str:
    """Singular values of the intensities, relative to the first, logarithmic."""
    values = np.asarray(values, float)[:12]
    relative = np.maximum(values / max(float(values[0]), 1e-12), 1e-3)
    axes = _Axes((0.4, len(values) + 0.6), (-3.0, 0.0), ("number", "relative size"))
    parts = axes.frame([], [(0, "1"), (-1, "0.1"), (-2, "0.01"), (-3, "0.001")])
    for index, value in enumerate(relative, 1):
        x0, y0 = axes.at(index - 0.36, float(np.log10(value)))
        x1, y1 = axes.at(index + 0.36, -3.0)
        kind = "bar" if index <= 4 else "bar weak"
        parts.append(
            f'<rect class="{kind}" x="{x0:.1f}" y="{y0:.1f}" width="{x1 - x0:.1f}" '
            f'height="{max(y1 - y0, 0):.1f}" rx="2"><title>{value:.4f}</title></rect>'
        )
        parts.append(_text((x0 + x1) / 2, y1 + 14, str(index)))
    return _svg(parts, "Singular values")


def stage_residuals(history: Sequence[HistoryEntry], stage: str) -> list[float]:
    """Finite residuals of one stage in their order."""
    values = [step.residual for step in history if step.stage == stage]
    return [value for value in values if np.isfinite(value)]


def _levels(low: float, high: float) -> list[float]:
    """Round numbers from at most ``low`` to at least ``high``."""
    if low < 0.5 * high:
        low = 0.0
    span = max(high - low, 1e-3 * abs(high), 1e-12)
    step = 10.0 ** np.floor(np.log10(span / 3))
    step *= next(f for f in (1, 2, 5, 10) if span / (step * f) <= 5)
    first, last = int(np.floor(low / step + 1e-9)), int(np.ceil(high / step - 1e-9))
    return [float(k * step) for k in range(first, max(last, first + 1) + 1)]


def convergence_plot(history: Sequence[HistoryEntry], stage: str) -> str:
    """Residual of one stage over its iterations."""
    values = stage_residuals(history, stage)
    levels = _levels(min(values), max(values))
    low, high = levels[0], levels[-1]
    reach = (0.5, max(len(values), 2) + 0.5)
    axes = _Axes(reach, (low, high), ("iteration", "residual"))
    step = max(1, -(-len(values) // 10))
    parts = axes.frame(
        list(range(1, len(values) + 1, step)), [(v, f"{v:.4g}") for v in levels]
    )
    points = [axes.at(i, v) for i, v in enumerate(values, 1)]
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    parts.append(f'<polyline class="line" points="{path}"/>')
    parts += [
        f'<circle class="dot" cx="{x:.1f}" cy="{y:.1f}" r="2.6"/>' for x, y in points
    ]
    return _svg(parts, f"Convergence of {stage}")
