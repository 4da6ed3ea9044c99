"""Rhino ``.3dm`` in millimetres, by the optional package ``rhino3dm`` (extra ``cad``).

The file holds the clamped NURBS surface, the outline and other curves as NURBS curves,
each kind on a layer of its own. ``rhino3dm`` cannot make a trimmed face; in Rhino
``Trim`` with the outline does it in one step. v of the file is 1 - v of the core, see
:mod:`.exchange`.
"""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import Any

import numpy.typing as npt

from ..errors import ReconstructionError
from ..files import replacing
from ..surface.bspline import BSplineSurface
from .exchange import ExchangeCurve, NamedCurves, exchange_surface


def write_3dm(
    path: str | os.PathLike,
    surface: BSplineSurface,
    outline_uv: npt.ArrayLike | None = None,
    name: str = "face",
    *,
    curves: NamedCurves = (),
) -> Path:
    """Write a Rhino file.

    Parameters
    ----------
    path : path-like
    surface : BSplineSurface
    outline_uv : (k, 2) array, optional
        Outline in the core's (u, v); no outline curve without it.
    name : str
        Name of the object.
    curves : tuple of (name, ExchangeCurve)
        More curves in space, on the layer "curves".

    Raises
    ------
    ReconstructionError
        When ``rhino3dm`` is not installed or the file cannot be written.
    """
    try:
        rhino3dm: Any = importlib.import_module("rhino3dm")
    except ImportError:
        raise ReconstructionError(
            f"{path}: .3dm files need the package rhino3dm; "
            "pip install 'bsface[cad]', or choose .step."
        ) from None
    face = exchange_surface(surface, outline_uv)
    model = rhino3dm.File3dm()
    model.Settings.ModelUnitSystem = rhino3dm.UnitSystem.Millimeters
    model.Settings.ModelAbsoluteTolerance = 0.001

    m, n = face.control_points.shape[:2]
    patch = rhino3dm.NurbsSurface.Create(3, False, 4, 4, m, n)
    # Rhino leaves out the first and the last knot: they have no influence.
    for index, knot in enumerate(face.knots_u[1:-1]):
        patch.KnotsU[index] = float(knot)
    for index, knot in enumerate(face.knots_v[1:-1]):
        patch.KnotsV[index] = float(knot)
    for i in range(m):
        for j in range(n):
            x, y, z = face.control_points[i, j].tolist()
            patch.Points[i, j] = rhino3dm.Point4d(x, y, z, 1.0)
    layer = _layer(rhino3dm, model, "surface")
    model.Objects.AddSurface(patch, _attributes(rhino3dm, name, layer))
    outline = tuple((f"{name} outline", edge) for edge in face.edges)
    for kind, drawn in (("outline", outline), ("curves", curves)):
        if drawn:
            layer = _layer(rhino3dm, model, kind)
            for label, curve in drawn:
                attributes = _attributes(rhino3dm, label, layer)
                model.Objects.AddCurve(_curve(rhino3dm, curve), attributes)

    path = Path(path)
    with replacing(path) as temporary:
        if not model.Write(str(temporary), 8):
            raise ReconstructionError(
                f"{path}: rhino3dm could not write the file; choose another folder."
            )
    return path


def _layer(rhino3dm: Any, model: Any, name: str) -> int:
    """Index of a new layer. A file without layers puts everything on the first one."""
    layer = rhino3dm.Layer()
    layer.Name = name
    return model.Layers.Add(layer)


def _curve(rhino3dm: Any, curve: ExchangeCurve) -> Any:
    made = rhino3dm.NurbsCurve(3, False, 4, len(curve.control_points))
    for k, knot in enumerate(curve.knots[1:-1]):
        made.Knots[k] = float(knot)
    for k, (x, y, z) in enumerate(curve.control_points.tolist()):
        made.Points[k] = rhino3dm.Point4d(x, y, z, 1.0)
    return made


def _attributes(rhino3dm: Any, name: str, layer: int) -> Any:
    attributes = rhino3dm.ObjectAttributes()
    attributes.Name = name
    attributes.LayerIndex = layer
    return attributes
