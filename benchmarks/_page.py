"""The page of the accuracy benchmark: tables, error maps, renders; one HTML file."""

from __future__ import annotations

import base64
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import cv2
import numpy as np
import scipy
from _faces import Face, draw, draw_values, views_of
from _methods import METHODS
from _reliability import LEVELS, PARTS
from _sets import FaceSet, Score
from _table import COLUMNS, averages, show
from bsface.drawing.pictures import colour_map, encode_jpeg, encode_png
from bsface.files import write_text
from bsface.settings import Settings

#: Upper end of the colour scale of all error maps, % of the eye distance.
TOP = 5.0
YAWS = {"front": 0.0, "three-quarter": 40.0, "profile": 88.0}

_STYLE = """
body{margin:0 auto;max-width:1500px;padding:24px;font:15px/1.5 system-ui,sans-serif;
color:#1e2023;background:#fff}
h1{font-size:28px;margin:0 0 6px}h2{font-size:20px;margin:40px 0 10px}
table{border-collapse:collapse;font-size:14px;margin:8px 0}
td,th{padding:3px 12px 3px 0;border-bottom:1px solid #e2e2de;text-align:right}
td.l,th.l{text-align:left}tr.best td{background:#eef5ee;font-weight:600}
.faces td{border:0;padding:2px;text-align:center;vertical-align:middle}
.faces th{border:0;text-align:center;font-weight:600;vertical-align:bottom}
.faces img{display:block;margin:0 auto}.soft{color:#6b7076}.wide{overflow-x:auto}
.scale img{height:14px;width:260px;vertical-align:middle;margin:0 8px}
pre{background:#f6f6f4;padding:10px;font-size:13px;overflow-x:auto}
"""


@dataclass(frozen=True)
class SetPictures:
    """Pictures of one set.

    Attributes
    ----------
    name : str
    columns : dict
        Heading -> pictures from top to bottom (error map from the front and from
        three-quarter, then the three shaded views), JPEG; None where there is none.
    """

    name: str
    columns: dict[str, list[bytes | None]]


def set_pictures(one: FaceSet, drawn: Mapping[str, tuple[Face, Score]]) -> SetPictures:
    """Draw the ground truth and all faces of a set, aligned, at one scale.

    Parameters
    ----------
    one : FaceSet
    drawn : mapping of method to (face in the frame of the ground truth, its score)
    """
    truth = one.face()
    views = views_of(truth, list(YAWS.values()))
    columns: dict[str, list[bytes | None]] = {
        "ground truth": [None, None, *(encode_jpeg(draw(truth, v)) for v in views)]
    }
    for method, (face, found) in drawn.items():
        maps = [draw_values(truth, found.error, TOP, view) for view in views[:2]]
        shaded = [draw(face, view) for view in views]
        columns[method] = [encode_jpeg(picture) for picture in (*maps, *shaded)]
    return SetPictures(one.name, columns)


def write_page(
    path: Path,
    rows: Sequence[Mapping[str, object]],
    pictures: Sequence[SetPictures],
    settings: Settings,
    spread: Sequence[Mapping[str, object]] = (),
) -> None:
    """Write the page.

    Parameters
    ----------
    path : Path
    rows : sequence of mappings
        ``set``, ``method`` and the keys of `COLUMNS`.
    pictures : sequence of SetPictures
    settings : Settings
    spread : sequence of mappings
        Of `reliability`.
    """
    parts = [
        "<!doctype html><html lang=en><meta charset=utf-8>",
        f"<title>Accuracy</title><style>{_STYLE}</style><h1>Accuracy</h1>",
        "<p class=soft>Distance from the ground truth to the surface after similarity "
        "alignment, % of the eye distance, weighted by area; normals in degrees; "
        "seconds with the landmarks.</p>",
        _legend(),
        "<h2>All sets</h2>",
        _table(rows, [("set", "set"), ("method", "method")]),
        "<h2>Mean over the sets</h2>",
        _table(
            averages(rows, [k for k, _, _ in COLUMNS], "method"),
            [("method", "method"), ("sets", "sets")],
        ),
    ]
    if spread:
        parts += ["<h2>Stated deviation against distance</h2>", _spread(spread)]
    parts.append(
        "<h2>Faces</h2><p class=scale>Error maps: 0 "
        f"{_image(_ramp(), 'colour scale')} {TOP:g} % of the eye distance and more"
        "</p>"
    )
    parts += [_faces(one, rows) for one in pictures]
    parts.append(f"<h2>Settings</h2><pre>{escape(_settings(settings))}</pre></html>")
    write_text(path, "\n".join(parts))


def _legend() -> str:
    lines = "".join(
        f"<tr><td class=l>{escape(name)}</td><td class=l>{escape(words)}</td></tr>"
        for name, words in METHODS.items()
    )
    return f"<table>{lines}</table>"


def _table(
    rows: Sequence[Mapping[str, object]], labels: Sequence[tuple[str, str]]
) -> str:
    head = "".join(f"<th class=l>{escape(h)}</th>" for _, h in labels)
    head += "".join(f"<th>{escape(h)}</th>" for _, h, _ in COLUMNS)
    best: dict[object, float] = {}
    for row in rows:
        mean = _number(row.get("mean"))
        best[row.get("set")] = min(best.get(row.get("set"), np.inf), mean)
    body = []
    for row in rows:
        first = _number(row.get("mean")) == best[row.get("set")]
        cells = "".join(
            f"<td class=l>{escape(str(row.get(k, '')))}</td>" for k, _ in labels
        )
        cells += "".join(f"<td>{show(row.get(k), form)}</td>" for k, _, form in COLUMNS)
        cells += f"<td class=l>{escape(str(row.get('note', '')))}</td>"
        body.append(f"<tr{' class=best' if first else ''}>{cells}</tr>")
    return f"<div class=wide><table><tr>{head}</tr>{''.join(body)}</table></div>"


def _number(value: object) -> float:
    number = np.inf if value is None else float(value)  # type: ignore[arg-type]
    return number if np.isfinite(number) else np.inf


def _faces(one: SetPictures, rows: Sequence[Mapping[str, object]]) -> str:
    means = {r["method"]: r.get("mean") for r in rows if r["set"] == one.name}
    heads = "".join(
        f"<th>{escape(name)}<br><span class=soft>"
        f"{show(means.get(name), '.2f')} %</span></th>"
        for name in one.columns
    )
    labels = ["error", "error", *YAWS]
    lines = []
    for k, label in enumerate(labels):
        cells = "".join(
            f"<td>{_image(column[k], f'{name}, {label}')}</td>"
            for name, column in one.columns.items()
        )
        lines.append(f"<tr><th>{label}</th>{cells}</tr>")
    return (
        f"<h2>{escape(one.name)}</h2><div class=wide><table class=faces>"
        f"<tr><th></th>{heads}</tr>{''.join(lines)}</table></div>"
    )


def _image(content: bytes | None, words: str) -> str:
    if content is None:
        return ""
    kind = "png" if content[:4] == b"\x89PNG" else "jpeg"
    data = base64.b64encode(content).decode("ascii")
    return f'<img alt="{escape(words)}" src="data:image/{kind};base64,{data}">'


def _ramp() -> bytes:
    values = np.broadcast_to(np.linspace(0, 1, 256), (12, 256))
    return encode_png(colour_map(values, 0.0, 1.0, "magma"))


def _spread(spread: Sequence[Mapping[str, object]]) -> str:
    """Reliability plot: stated probability against the share that is within."""
    side, pad = 300, 40
    place = lambda x, y: (pad + x * side, pad / 2 + (1 - y) * side)  # noqa: E731
    lines = [
        f'<line x1="{pad}" y1="{pad / 2 + side}" x2="{pad + side}" y2="{pad / 2}" '
        'stroke="#bbb"/>',
        f'<rect x="{pad}" y="{pad / 2}" width="{side}" height="{side}" fill="none" '
        'stroke="#bbb"/>',
    ]
    for row in spread:
        corners = [
            place(p, float(row[f"within {p:.0%}"]))  # type: ignore[arg-type]
            for p in LEVELS
        ]
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
        name = escape(f"{row['set']} {row['method']}")
        lines.append(
            f'<polyline points="{points}" fill="none" stroke="#2b6cb0" '
            f'stroke-opacity=".6"><title>{name}</title></polyline>'
        )
    for p in (0.0, 0.5, 1.0):
        x, y = place(p, 0.0)
        lines.append(
            f'<text x="{x}" y="{y + 16}" text-anchor="middle" font-size="12">{p:.0%}'
            "</text>"
        )
        x, y = place(0.0, p)
        lines.append(
            f'<text x="{x - 6}" y="{y + 4}" text-anchor="end" font-size="12">{p:.0%}'
            "</text>"
        )
    said = "".join(f"<th>said</th><th>is {k + 1}/{PARTS}</th>" for k in range(PARTS))
    body = "".join(
        f"<tr><td class=l>{escape(str(row['set']))}</td>"
        + "".join(
            f"<td>{show(row[f'said {k + 1}'], '.2f')}</td>"
            f"<td>{show(row[f'is {k + 1}'], '.2f')}</td>"
            for k in range(PARTS)
        )
        + "</tr>"
        for row in spread
    )
    return (
        "<p>Probability that the stated deviation gives an interval (across) and share "
        "of the area that lies within it (up), a line a set; on the diagonal the "
        "deviation is true.</p>"
        f'<svg width="{side + 2 * pad}" height="{side + pad + 10}">{"".join(lines)}'
        "</svg><p>Stated deviation and RMS distance, % of the eye distance, in fifths "
        "of the area from the best known to the least.</p>"
        f"<table><tr><th class=l>set</th>{said}</tr>{body}</table>"
    )


def _settings(settings: Settings) -> str:
    lines = [f"{k} = {v}" for k, v in settings.to_dict().items()]
    lines.append(
        f"Python {platform.python_version()}, NumPy {np.__version__}, "
        f"SciPy {scipy.__version__}, OpenCV {cv2.__version__}"
    )
    return "\n".join(lines)
