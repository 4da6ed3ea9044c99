"""Free-form Wavefront OBJ: the face as a cubic B-spline ``surf`` with a ``trim`` loop.

v of the file is 1 - v of the core, see :mod:`.exchange`; millimetres. Few programs read
the free-form part of the format (Blender and most viewers take polygons only): for a
mesh see :mod:`.mesh`. Reference: Wavefront Advanced Visualizer manual, appendix B1.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy.typing as npt

from ..files import write_text
from ..surface.bspline import BSplineSurface
from .exchange import ExchangeSurface, exchange_surface


def write_freeform_obj(
    path: str | os.PathLike,
    surface: BSplineSurface,
    outline_uv: npt.ArrayLike | None = None,
    name: str = "face",
) -> Path:
    """Write a free-form OBJ file.

    Parameters
    ----------
    path : path-like
    surface : BSplineSurface
    outline_uv : (k, 2) array, optional
        Outline in the core's (u, v); the whole surface without it.
    name : str
        Name of the object.

    Raises
    ------
    ReconstructionError
        When the file cannot be written.
    """
    return write_text(path, obj_text(exchange_surface(surface, outline_uv), name))


def obj_text(face: ExchangeSurface, name: str = "face") -> str:
    """The text of the file."""
    m, n = face.control_points.shape[:2]
    lines = ["# B-spline face surface, millimetres", f"o {'_'.join(name.split())}"]
    # The first index of a surf statement is u and runs fastest.
    points = face.control_points.transpose(1, 0, 2).reshape(-1, 3)
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    first = 1
    for curve in face.outline:
        count = len(curve.control_points)
        lines += [f"vp {u!r} {v!r}" for u, v in curve.control_points.tolist()]
        lines += [
            "cstype bspline",
            "deg 3",
            _joined("curv2", range(first, first + count)),
            _joined("parm u", curve.knots.tolist()),
            "end",
        ]
        first += count
    lines += [
        "cstype bspline",
        "deg 3 3",
        _joined("surf 0.0 1.0 0.0 1.0", range(1, m * n + 1)),
        _joined("parm u", face.knots_u.tolist()),
        _joined("parm v", face.knots_v.tolist()),
    ]
    if face.outline:
        curves = (f"0.0 1.0 {k}" for k in range(1, len(face.outline) + 1))
        lines.append(f"trim {' '.join(curves)}")
    return "\n".join([*lines, "end", ""])


def _joined(head: str, values: range | list[float], width: int = 78) -> str:
    """A statement broken over lines by the format's backslash."""
    lines, line = [], head
    for value in values:
        piece = " " + (repr(value) if isinstance(value, float) else str(int(value)))
        if len(line) + len(piece) > width:
            lines.append(line + " \\")
            line = ""
        line += piece
    return "\n".join([*lines, line])
