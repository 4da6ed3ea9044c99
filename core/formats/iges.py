"""IGES 5.3: entity 128 (B-spline surface), trimmed by 144, 142, 102, 126; millimetres.

v of the file is 1 - v of the core, see :mod:`.exchange`. Equal faces give equal bytes.
Reference: U.S. Product Data Association, Initial Graphics Exchange Specification 5.3,
1996, sections 2.2 (fixed format), 4.23, 4.26, 4.33 and 4.34.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..files import write_bytes
from ..surface.bspline import BSplineSurface
from .exchange import ExchangeCurve, ExchangeSurface, NamedCurves, exchange_surface
from .options import ANONYMOUS, Stamp
from .step import real

# Directory status: blank, subordinate, use, hierarchy (two digits each).
_INDEPENDENT = "00000000"
_DEPENDENT = "00010000"
_DEPENDENT_IN_PARAMETERS = "00010500"


def write_iges(
    path: str | os.PathLike,
    surface: BSplineSurface,
    outline_uv: npt.ArrayLike | None = None,
    name: str = "face",
    *,
    stamp: Stamp = ANONYMOUS,
    curves: NamedCurves = (),
) -> Path:
    """Write an IGES file.

    Parameters
    ----------
    path : path-like
    surface : BSplineSurface
    outline_uv : (k, 2) array, optional
        Outline in the core's (u, v); the whole surface without it.
    name : str
        Name of the product; entities keep 8 letters of it, the file 60. What is not
        ASCII becomes "?".
    stamp : Stamp
        Author and date.
    curves : tuple of (name, ExchangeCurve)
        More curves in space, labelled by their names and numbers.

    Raises
    ------
    ReconstructionError
        When the file cannot be written.
    """
    face = exchange_surface(surface, outline_uv)
    text = iges_text(face, name, stamp=stamp, curves=curves)
    return write_bytes(path, text.encode("ascii"))


def iges_text(
    face: ExchangeSurface,
    name: str = "face",
    *,
    stamp: Stamp = ANONYMOUS,
    curves: NamedCurves = (),
) -> str:
    """The text of the file: 80 columns, sections S, G, D, P, T."""
    name = _ascii(name)
    directory: list[str] = []
    parameters: list[str] = []

    def add(
        entity: int,
        values: Sequence[float | int],
        status: str,
        label: str = name,
        number: int = 0,
    ) -> int:
        """One entity; returns its pointer, the number of its first directory line."""
        pointer = len(directory) + 1
        first = len(parameters) + 1
        for text in _wrapped([str(entity), *(_number(value) for value in values)], 64):
            line = len(parameters) + 1
            parameters.append(f"{text:<64}{pointer:>8d}P{line:>7d}")
        count = len(parameters) - first + 1
        fields = [entity, first, 0, 0, 0, 0, 0, 0]
        directory.append(
            "".join(f"{field:>8d}" for field in fields) + f"{status}D{pointer:>7d}"
        )
        fields = [entity, 0, 0, count, 0]
        directory.append(
            "".join(f"{field:>8d}" for field in fields)
            + f"{'':>16}{label[:8]:>8}{number:>8d}D{pointer + 1:>7d}"
        )
        return pointer

    def chain(curves: tuple[ExchangeCurve, ...], planar: bool, status: str) -> int:
        """The curves of a loop, joined by a composite curve where there are several."""
        closed = len(curves) == 1
        pointers = [add(126, _curve(c, planar, closed), status) for c in curves]
        return pointers[0] if closed else add(102, [len(curves), *pointers], status)

    if not face.outline:
        add(128, _surface(face), _INDEPENDENT)
    else:
        surface = add(128, _surface(face), _DEPENDENT)
        flat = chain(face.outline, True, _DEPENDENT_IN_PARAMETERS)
        space = chain(face.edges, False, _DEPENDENT)
        # Made by no projection in particular; the curve in (u, v) is the master.
        on_surface = add(142, [0, surface, flat, space, 1], _DEPENDENT)
        add(144, [surface, 1, 0, on_surface], _INDEPENDENT)
    for number, (title, curve) in enumerate(curves, 1):
        closed = bool((curve.control_points[0] == curve.control_points[-1]).all())
        values = _curve(curve, False, closed)
        add(126, values, _INDEPENDENT, _ascii(title), number)

    start = [f"{'B-spline face surface, millimetres':<72}S{1:>7d}"]
    largest = float(np.abs(face.control_points).max())
    header = [
        f"{text:<72}G{number:>7d}"
        for number, text in enumerate(_wrapped(_global(name, largest, stamp), 72), 1)
    ]
    counts = (len(start), len(header), len(directory), len(parameters))
    sizes = "".join(f"{s}{c:>7d}" for s, c in zip("SGDP", counts, strict=True))
    end = f"{sizes:<72}T{1:>7d}"
    return "\n".join([*start, *header, *directory, *parameters, end, ""])


def _ascii(text: str) -> str:
    """The text as the format can hold it; shorter than a line."""
    printable = (c if " " <= c <= "~" else "?" for c in text)
    return "".join(printable)[:60]


def _number(value: float | int) -> str:
    return str(value) if isinstance(value, int) else real(value)


def _wrapped(values: list[str], width: int) -> list[str]:
    """Values joined by commas, closed by a semicolon, no value cut by a line's end."""
    lines, line = [], ""
    for index, value in enumerate(values):
        piece = value + ("," if index < len(values) - 1 else ";")
        if len(line) + len(piece) > width:
            lines.append(line)
            line = ""
        line += piece
    return [*lines, line]


def _global(name: str, largest: float, stamp: Stamp) -> list[str]:
    def text(value: str) -> str:
        return f"{len(value)}H{value}"

    date = text(datetime.fromisoformat(stamp.date).strftime("%Y%m%d.%H%M%S"))
    author = text(_ascii(stamp.author))
    return [
        *(text(","), text(";"), text(name), text(f"{name}.igs")),
        *(text("bsface"), text("bsface"), "32", "38", "6", "308", "15"),
        # Scale 1, unit 2 = millimetres, line weights.
        *(text(name), "1.", "2", text("MM"), "1", "0.1", date),
        *("1.E-6", real(largest), author, text(""), "11", "0", date),
    ]


def _surface(face: ExchangeSurface) -> list[float | int]:
    m, n = face.control_points.shape[:2]
    # u runs fastest in weights and points.
    points = face.control_points.transpose(1, 0, 2).ravel()
    return [
        *(m - 1, n - 1, 3, 3, 0, 0, 1, 0, 0),
        *face.knots_u.tolist(),
        *face.knots_v.tolist(),
        *np.ones(m * n).tolist(),
        *points.tolist(),
        *(0.0, 1.0, 0.0, 1.0),
    ]


def _curve(curve: ExchangeCurve, planar: bool, closed: bool) -> list[float | int]:
    points = curve.control_points
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    return [
        *(len(points) - 1, 3, int(planar), int(closed), 1, 0),
        *curve.knots.tolist(),
        *np.ones(len(points)).tolist(),
        *points.ravel().tolist(),
        *(0.0, 1.0),
        *(0.0, 0.0, 1.0 if planar else 0.0),
    ]
