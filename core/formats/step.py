"""STEP (ISO 10303-21, AP214): the face as a trimmed B-spline surface, millimetres.

One ``OPEN_SHELL`` with one ``ADVANCED_FACE`` on a ``B_SPLINE_SURFACE_WITH_KNOTS``; each
edge of its outline has a curve in space and its twin in (u, v). Without an
outline the four borders of the surface bound the face. v of the file is 1 - v of the
core, see :mod:`.exchange`. Equal faces give equal bytes: the time stamp is fixed unless
it is given. More curves in space follow as a ``GEOMETRIC_CURVE_SET``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .._types import Array
from ..files import write_bytes
from ..surface.bspline import BSplineSurface
from .exchange import ExchangeSurface, NamedCurves, exchange_surface
from .options import ANONYMOUS, Stamp


def write_step(
    path: str | os.PathLike,
    surface: BSplineSurface,
    outline_uv: npt.ArrayLike | None = None,
    name: str = "face",
    *,
    stamp: Stamp = ANONYMOUS,
    curves: NamedCurves = (),
) -> Path:
    """Write a STEP file.

    Parameters
    ----------
    path : path-like
    surface : BSplineSurface
    outline_uv : (k, 2) array, optional
        Outline in the core's (u, v); the whole surface without it.
    name : str
        Name of the product.
    stamp : Stamp
        Author and date.
    curves : tuple of (name, ExchangeCurve)
        More curves in space.

    Raises
    ------
    ReconstructionError
        When the file cannot be written.
    """
    text = step_text(
        exchange_surface(surface, outline_uv), name, stamp=stamp, curves=curves
    )
    return write_bytes(path, text.encode("ascii"))


def step_text(
    face: ExchangeSurface,
    name: str = "face",
    *,
    stamp: Stamp = ANONYMOUS,
    curves: NamedCurves = (),
) -> str:
    """The text of the file."""
    model = _Model()
    label = _string(name)
    context = _product(model, label)
    shape = _spline_surface(model, face)
    loop = _trim_loop(model, face, shape) if face.outline else _border_loop(model, face)
    bound = model.add(f"FACE_OUTER_BOUND('',{loop},.T.)")
    advanced = model.add(f"ADVANCED_FACE({label},({bound}),{shape},.T.)")
    shell = model.add(f"OPEN_SHELL('',({advanced}))")
    shells = model.add(f"SHELL_BASED_SURFACE_MODEL({label},({shell}))")
    geometry, definition = context
    representation = model.add(
        f"MANIFOLD_SURFACE_SHAPE_REPRESENTATION({label},({shells}),{geometry})"
    )
    model.add(f"SHAPE_DEFINITION_REPRESENTATION({definition},{representation})")
    if curves:
        _curve_set(model, curves, context)
    return "\n".join(
        [
            "ISO-10303-21;",
            "HEADER;",
            "FILE_DESCRIPTION(('B-spline face surface'),'2;1');",
            f"FILE_NAME({label},{_string(stamp.date)},({_string(stamp.author)}),(''),"
            "'bsface','bsface','');",
            "FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));",
            "ENDSEC;",
            "DATA;",
            *model.lines,
            "ENDSEC;",
            "END-ISO-10303-21;",
            "",
        ]
    )


class _Model:
    """The data section: numbered instances."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def add(self, text: str) -> str:
        number = len(self.lines) + 1
        self.lines.append(f"#{number} = {text};")
        return f"#{number}"

    def point(self, coordinates: Sequence[float] | Array) -> str:
        values = ",".join(real(value) for value in coordinates)
        return self.add(f"CARTESIAN_POINT('',({values}))")


def real(value: float) -> str:
    """A number to the last bit, with the decimal point that the standard demands."""
    text = repr(float(value)).upper()
    mantissa, mark, exponent = text.partition("E")
    if "." not in mantissa:
        mantissa += "."
    return mantissa + mark + exponent


def _string(text: str) -> str:
    """A text as ISO 10303-21, 6.4.3 writes it: other letters than ASCII by number."""
    text = text.encode("utf-8", "replace").decode("utf-8")
    plain = text.replace("\\", "\\\\").replace("'", "''")
    plain = re.sub(r"[\x00-\x1f\x7f-\uffff]+", lambda found: _coded(found[0], 2), plain)
    plain = re.sub(
        r"[\U00010000-\U0010ffff]+", lambda found: _coded(found[0], 4), plain
    )
    return f"'{plain}'"


def _coded(letters: str, size: int) -> str:
    """Letters in hexadecimal, of ``size`` bytes each."""
    digits = "".join(f"{ord(letter):0{2 * size}X}" for letter in letters)
    return rf"\X{size}\{digits}\X0" + "\\"


def _knots(knots: Array) -> tuple[str, str]:
    """Multiplicities and distinct values as two lists."""
    distinct, counts = np.unique(knots, return_counts=True)
    return (
        "(" + ",".join(str(count) for count in counts) + ")",
        "(" + ",".join(real(value) for value in distinct) + ")",
    )


def _spline_surface(model: _Model, face: ExchangeSurface) -> str:
    rows = [
        "(" + ",".join(model.point(point) for point in row) + ")"
        for row in face.control_points
    ]
    times_u, knots_u = _knots(face.knots_u)
    times_v, knots_v = _knots(face.knots_v)
    return model.add(
        f"B_SPLINE_SURFACE_WITH_KNOTS('',3,3,({','.join(rows)}),.UNSPECIFIED.,"
        f".F.,.F.,.F.,{times_u},{times_v},{knots_u},{knots_v},.UNSPECIFIED.)"
    )


def _spline_curve(
    model: _Model, points: Array, knots: Array, closed: bool = False
) -> str:
    listed = ",".join(model.point(point) for point in points)
    times, values = _knots(knots)
    flag = ".T." if closed else ".F."
    return model.add(
        f"B_SPLINE_CURVE_WITH_KNOTS('',3,({listed}),.UNSPECIFIED.,{flag},.F.,"
        f"{times},{values},.UNSPECIFIED.)"
    )


def _curve_set(model: _Model, curves: NamedCurves, context: tuple[str, str]) -> None:
    """The curves as a representation of the same product."""
    geometry, definition = context
    drawn = []
    for name, curve in curves:
        closed = bool((curve.control_points[0] == curve.control_points[-1]).all())
        spline = _spline_curve(model, curve.control_points, curve.knots, closed)
        # The name of an entity is its first value.
        number = int(spline[1:]) - 1
        model.lines[number] = model.lines[number].replace("('',", f"({_string(name)},")
        drawn.append(spline)
    gathered = model.add(f"GEOMETRIC_CURVE_SET('curves',({','.join(drawn)}))")
    representation = model.add(
        "GEOMETRICALLY_BOUNDED_WIREFRAME_SHAPE_REPRESENTATION("
        f"'curves',({gathered}),{geometry})"
    )
    model.add(f"SHAPE_DEFINITION_REPRESENTATION({definition},{representation})")


def _vertex(model: _Model, point: Array) -> str:
    return model.add(f"VERTEX_POINT('',{model.point(point)})")


def _trim_loop(model: _Model, face: ExchangeSurface, surface: str) -> str:
    plane = model.add(
        "( GEOMETRIC_REPRESENTATION_CONTEXT(2) "
        "PARAMETRIC_REPRESENTATION_CONTEXT() REPRESENTATION_CONTEXT('2D SPACE','') )"
    )
    count = len(face.edges)
    vertices = [_vertex(model, edge.control_points[0]) for edge in face.edges]
    oriented = []
    for index, (flat, edge) in enumerate(zip(face.outline, face.edges, strict=True)):
        space = _spline_curve(model, edge.control_points, edge.knots, count == 1)
        drawn = _spline_curve(model, flat.control_points, flat.knots, count == 1)
        definition = model.add(f"DEFINITIONAL_REPRESENTATION('',({drawn}),{plane})")
        pcurve = model.add(f"PCURVE('',{surface},{definition})")
        curve = model.add(f"SURFACE_CURVE('',{space},({pcurve}),.PCURVE_S1.)")
        start, end = vertices[index], vertices[(index + 1) % count]
        oriented.append(_oriented_edge(model, start, end, curve))
    return model.add(f"EDGE_LOOP('',({','.join(oriented)}))")


def _border_loop(model: _Model, face: ExchangeSurface) -> str:
    """The four borders of the (u, v) square, counter-clockwise."""
    net = face.control_points
    sides = (
        (net[:, 0], face.knots_u, True),
        (net[-1], face.knots_v, True),
        (net[:, -1], face.knots_u, False),
        (net[0], face.knots_v, False),
    )
    corners = [
        _vertex(model, net[i, j]) for i, j in ((0, 0), (-1, 0), (-1, -1), (0, -1))
    ]
    edges = []
    for index, (points, knots, forward) in enumerate(sides):
        curve = _spline_curve(model, points, knots)
        ends = corners[index], corners[(index + 1) % 4]
        start, end = ends if forward else ends[::-1]
        edges.append(_oriented_edge(model, start, end, curve, forward))
    return model.add(f"EDGE_LOOP('',({','.join(edges)}))")


def _oriented_edge(
    model: _Model, start: str, end: str, curve: str, forward: bool = True
) -> str:
    edge = model.add(f"EDGE_CURVE('',{start},{end},{curve},.T.)")
    return model.add(f"ORIENTED_EDGE('',*,*,{edge},{'.T.' if forward else '.F.'})")


def _product(model: _Model, label: str) -> tuple[str, str]:
    """The obligatory frame of AP214: product, units, context."""
    application = model.add(
        "APPLICATION_CONTEXT('core data for automotive mechanical design processes')"
    )
    model.add(
        "APPLICATION_PROTOCOL_DEFINITION('international standard',"
        f"'automotive_design',2000,{application})"
    )
    mechanical = model.add(f"PRODUCT_CONTEXT('',{application},'mechanical')")
    product = model.add(f"PRODUCT({label},{label},'',({mechanical}))")
    formation = model.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
    design = model.add(f"PRODUCT_DEFINITION_CONTEXT('',{application},'design')")
    definition = model.add(f"PRODUCT_DEFINITION('design','',{formation},{design})")
    shape = model.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
    length = model.add("( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.) )")
    angle = model.add("( NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.) )")
    solid = model.add("( NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT() )")
    accuracy = model.add(
        f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-4),{length},"
        "'distance_accuracy_value','confusion accuracy')"
    )
    geometry = model.add(
        "( GEOMETRIC_REPRESENTATION_CONTEXT(3) "
        f"GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({accuracy})) "
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid})) "
        "REPRESENTATION_CONTEXT('','') )"
    )
    return geometry, shape
