"""The HTML of the report: plain sections, no script, no outside resource."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np
import numpy.typing as npt

from ..drawing.pictures import colour_map, encode_jpeg, encode_png
from ..errors import FailureCode
from .style_sheet import STYLE

_MAP_NAMES = {
    "z": "z, depth",
    "z_u": "∂z/∂u",
    "z_v": "∂z/∂v",
    "z_uu": "∂²z/∂u²",
    "z_vv": "∂²z/∂v²",
    "z_uv": "∂²z/∂u∂v",
}

#: Share of the area within the stated standard deviation, %: the mean over the sets
#: with ground truth, from the table "reliability" of docs/accuracy.md.
WITHIN_DEVIATION = 67


def page(
    facts: Mapping[str, Any],
    pictures: Mapping[str, npt.NDArray[np.uint8]],
    drawn: Mapping[str, str],
    photos: Mapping[str, bytes],
    skin: Mapping[str, bytes],
) -> str:
    """The whole page.

    Parameters
    ----------
    facts : mapping
        See `facts.result_facts`.
    pictures : mapping of (h, w, 3) uint8 arrays
    drawn : mapping of SVG texts
    photos, skin : mapping of photo name to JPEG bytes
        With landmarks; tinted where it is not skin.
    """
    body = [
        _head(facts),
        _views(pictures),
        _next(facts),
        _coverage(drawn, facts),
        _trust(pictures),
        _photos(facts, photos, skin),
        _convergence(drawn),
        _maps(pictures),
        _texture(pictures),
        _settings(facts),
    ]
    title = escape(str(facts["title"]))
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{title} - bsface</title><style>{STYLE}</style></head>\n<body><main>\n"
        + "\n".join(part for part in body if part)
        + "\n</main></body></html>\n"
    )


def _image(picture: npt.NDArray[np.uint8], alt: str, lossless: bool = False) -> str:
    content = encode_png(picture) if lossless else encode_jpeg(picture, 90)
    kind = "png" if lossless else "jpeg"
    return _embedded(content, kind, alt)


def _embedded(content: bytes, kind: str, alt: str) -> str:
    data = base64.b64encode(content).decode("ascii")
    return f'<img alt="{escape(alt)}" src="data:image/{kind};base64,{data}">'


def _head(facts: Mapping[str, Any]) -> str:
    photos = facts["photos"]
    m, n = facts["control_points"]
    boxes = [
        (f"{photos['used']} of {photos['all']}", "photos used"),
        (f"{m} × {n}", "control points"),
        (f"{facts['settings'].get('eye_distance_mm', 0):g} mm", "between the eyes"),
    ]
    error = facts["residuals"]["reprojection_pct"]
    if error is not None:
        boxes.append((f"{error:.1f} %", "landmark error, median"))
    if "confidence_mm" in facts:
        deviation = facts["confidence_mm"]["median"]
        boxes.append((f"± {deviation:.2f} mm", "median deviation"))
    if "seconds" in facts:
        boxes.append((f"{sum(facts['seconds'].values()):.0f} s", "computing time"))
    cells = "".join(f"<div><b>{a}</b><span>{b}</span></div>" for a, b in boxes)
    method = escape(str(facts["settings"].get("method", "")))
    return (
        f"<h1>{escape(str(facts['title']))}</h1>"
        f'<p class="lead">B-spline face surface from photos, method “{method}”. '
        "Landmark error is in per cent of the eye distance.</p>"
        f'<div class="facts">{cells}</div>'
    )


def _views(pictures: Mapping[str, npt.NDArray[np.uint8]]) -> str:
    parts = [
        f'<div class="card views">{_image(pictures[name], alt)}</div>'
        for name, alt in (
            ("views", "The surface from the front, three-quarter and in profile"),
            ("textured", "The surface with the mean texture of the photos"),
        )
        if name in pictures
    ]
    return "<h2>The face</h2>" + '<div style="height:12px"></div>'.join(parts)


def _next(facts: Mapping[str, Any]) -> str:
    sentences = facts["warnings"] or [
        "Nothing is missing: poses and lights are spread well over the face."
    ]
    items = "".join(f"<li>{escape(str(s))}</li>" for s in sentences)
    return (
        f'<h2>What to photograph next</h2><div class="card"><ul class="next">{items}'
        "</ul></div>"
    )


def _plot(drawn: Mapping[str, str], name: str, title: str, words: str) -> str:
    if name not in drawn:
        return ""
    return (
        f'<div class="card plot"><h3>{title}</h3>{drawn[name]}'
        f"<p>{escape(words)}</p></div>"
    )


def _coverage(drawn: Mapping[str, str], facts: Mapping[str, Any]) -> str:
    share = facts.get("rank_4_share")
    light = (
        "Four are what light on a matt surface needs; a steep fall before the fourth "
        "means that the light hardly changed between photos."
    )
    if share is not None:
        light += f" The first four hold {100 * share:.1f} % of the variation."
    parts = [
        _plot(
            drawn,
            "pose",
            "Poses",
            "One dot a photo. Dashed zones have none: photos there would help most.",
        ),
        _plot(
            drawn,
            "light",
            "Light",
            "Where the main light of each photo comes from, as the camera of a frontal "
            "photo sees it: middle = from the front, rim = 90 degrees; a larger dot is "
            "harder light.",
        ),
        _plot(drawn, "singular", "Is the light diverse enough?", light),
    ]
    body = "".join(parts)
    return f'<h2>Coverage</h2><div class="grid">{body}</div>' if body else ""


def _scale(name: str, low: str, high: str) -> str:
    ramp = colour_map(np.linspace(0, 1, 9), 0, 1, name)
    stops = ",".join(f"rgb({r},{g},{b})" for r, g, b in ramp.tolist())
    return (
        f'<div class="scale">{escape(low)}<i style="background:linear-gradient(90deg,'
        f'{stops})"></i>{escape(high)}</div>'
    )


def _trust(pictures: Mapping[str, npt.NDArray[np.uint8]]) -> str:
    entries = (
        ("confidence", "Standard deviation of the surface", "magma", "0", "2 mm"),
        ("residual", "Difference of photos and model", "magma", "0", "20 %"),
        ("seen", "How many photos see it", "viridis", "none", "most"),
    )
    cards = "".join(
        f'<div class="card plot"><h3>{title}</h3><div class="views">'
        f"{_image(pictures[name], title)}</div>{_scale(ramp, low, high)}</div>"
        for name, title, ramp, low, high in entries
        if name in pictures
    )
    if not cards:
        return ""
    note = ""
    if "confidence" in pictures:
        note = (
            '<p class="soft">On the test sets, whose faces are known, '
            f"{WITHIN_DEVIATION} % of the skin lies within one standard deviation "
            "(68 % if it were exact).</p>"
        )
    return f'<h2>How far to trust it</h2>{note}<div class="grid">{cards}</div>'


def _photos(
    facts: Mapping[str, Any], photos: Mapping[str, bytes], skin: Mapping[str, bytes]
) -> str:
    if not facts["report"]:
        return ""
    # What went wrong first: that is what one looks for.
    entries = sorted(facts["report"], key=lambda e: e["status"] == "used")
    cards = "".join(
        _photo(entry, photos.get(entry["name"]), skin.get(entry["name"]))
        for entry in entries
    )
    inset = ". The small picture is tinted where it is not skin of the face"
    return (
        "<h2>Photos</h2>"
        '<p class="soft key"><i style="background:#40e078;margin-left:0"></i>landmarks '
        'as detected<i style="background:#ff46a0"></i>the same points of the finished '
        f"face, seen by the photo’s camera{inset if skin else ''}</p>"
        f'<div class="photos">{cards}</div>'
    )


def _word(status: str) -> str:
    """A photo's status for people."""
    try:
        return FailureCode(status).label
    except ValueError:  # "used", or of a file that a newer version wrote
        return status


def _photo(entry: Mapping[str, Any], jpeg: bytes | None, skin: bytes | None) -> str:
    name = str(entry["name"])
    used = entry["status"] == "used"
    word = _word(str(entry["status"]))
    picture = (
        _embedded(jpeg, "jpeg", name)
        if jpeg
        else f'<div class="none">{escape(word)}</div>'
    )
    if skin:
        picture += _embedded(skin, "jpeg", f"{name}, skin")
    lines = []
    if used and entry["yaw"] is not None:
        lines.append(
            f"yaw {entry['yaw']:.0f}°, pitch {entry['pitch']:.0f}°, "
            f"roll {entry['roll']:.0f}°"
        )
        if entry["reprojection_pct"] is not None:
            lines.append(f"landmark error {entry['reprojection_pct']:.1f} %")
    if entry["reason"]:
        lines.append(str(entry["reason"]))
    badge = f'<span class="badge{"" if used else " bad"}">{escape(word)}</span>'
    details = "".join(f"<small>{escape(line)}</small>" for line in lines)
    name = escape(name)
    return (
        f'<div class="card">{picture}<strong title="{name}">{badge}{name}</strong>'
        f"{details}</div>"
    )


def _convergence(drawn: Mapping[str, str]) -> str:
    words = {
        "motion": "Landmarks and poses: root mean square distance, mm.",
        "refine": "Shading and motion: intensity, relative to the photo's median.",
    }
    cards = "".join(
        _plot(drawn, name, escape(stage.capitalize()), words.get(stage, "Residual."))
        for name in drawn
        if name.startswith("convergence_")
        for stage in [name.removeprefix("convergence_")]
    )
    return f'<h2>Convergence</h2><div class="grid">{cards}</div>' if cards else ""


def _maps(pictures: Mapping[str, npt.NDArray[np.uint8]]) -> str:
    cells = "".join(
        f"<figure>{_image(pictures[f'map_{name}'], label, True)}"
        f"<figcaption>{label}</figcaption></figure>"
        for name, label in _MAP_NAMES.items()
        if f"map_{name}" in pictures
    )
    return (
        "<h2>Depth and its derivatives over (u, v)</h2>"
        '<p class="soft">The surface is twice continuously differentiable: these maps '
        "have no steps (figure 1 of the method’s paper). Derivatives: blue negative, "
        "white zero, red positive; v runs down.</p>"
        f'<div class="card maps">{cells}</div>'
    )


def _texture(pictures: Mapping[str, npt.NDArray[np.uint8]]) -> str:
    cells = "".join(
        f"<figure>{_image(pictures[name], label)}"
        f"<figcaption>{label}</figcaption></figure>"
        for name, label in (
            ("mean", "mean of the photos, balanced"),
            ("albedo", "skin without its light (albedo)"),
        )
        if name in pictures
    )
    if not cells:
        return ""
    return f'<h2>Texture over (u, v)</h2><div class="card maps wide">{cells}</div>'


def _settings(facts: Mapping[str, Any]) -> str:
    def table(values: Mapping[str, Any]) -> str:
        rows = "".join(
            f"<tr><th>{escape(str(k))}</th><td>{escape(_short(v))}</td></tr>"
            for k, v in values.items()
        )
        return f"<table>{rows}</table>"

    parts = [
        f'<div class="card plot"><h3>Settings</h3>{table(facts["settings"])}</div>',
        f'<div class="card plot"><h3>Versions</h3>{table(facts["versions"])}</div>',
    ]
    if "seconds" in facts:
        seconds = {k: f"{v:.1f}" for k, v in facts["seconds"].items()}
        parts.append(f'<div class="card plot"><h3>Seconds</h3>{table(seconds)}</div>')
    return f'<h2>To reproduce it</h2><div class="grid">{"".join(parts)}</div>'


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list | tuple):
        return " × ".join(_short(item) for item in value)
    return str(value)
