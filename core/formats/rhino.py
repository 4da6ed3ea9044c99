"""Rhino ``.3dm`` in millimetres, by the optional package ``rhino3dm`` (extra ``cad``).

The file holds the clamped NURBS surface and, on a layer of its own, the outline as
NURBS curves. ``rhino3dm`` cannot make a trimmed face; in Rhino ``Trim`` with them
does it in one step. v of the file is 1 - v of the core, see :mod:`.exchange`.
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
from .exchange import exchange_surface


def write_3dm(
    path: str | os.PathLike,
    surface: BSplineSurface,
    outline_uv: npt.ArrayLike | None = None,
    name: str = "face",
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
    model.Objects.AddSurface(patch, _attributes(rhino3dm, name, 0))

    if face.edges:
        layer = rhino3dm.Layer()
        layer.Name = "outline"
        index = model.Layers.Add(layer)
        attributes = _attributes(rhino3dm, f"{name} outline", index)
        for edge in face.edges:
            curve = rhino3dm.NurbsCurve(3, False, 4, len(edge.control_points))
            for k, knot in enumerate(edge.knots[1:-1]):
                curve.Knots[k] = float(knot)
            for k, (x, y, z) in enumerate(edge.control_points.tolist()):
                curve.Points[k] = rhino3dm.Point4d(x, y, z, 1.0)
            model.Objects.AddCurve(curve, attributes)

    path = Path(path)
    with replacing(path) as temporary:
        if not model.Write(str(temporary), 8):
            raise ReconstructionError(
                f"{path}: rhino3dm could not write the file; choose another folder."
            )
    return path


def _attributes(rhino3dm: Any, name: str, layer: int) -> Any:
    attributes = rhino3dm.ObjectAttributes()
    attributes.Name = name
    attributes.LayerIndex = layer
    return attributes
