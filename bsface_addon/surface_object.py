"""Control points <-> Blender SURFACE object.

The only file that knows how Blender stores a NURBS surface: spline points in the
order ``points[v * U + u]`` (u fastest), float32, homogeneous.  With order 4 and
*Endpoint* off, Blender's surface is the uniform bicubic B-spline of the paper
(section 2.1) without any knot conversion.  The points are in the object's own
coordinates (`coordinates`).
"""

from __future__ import annotations

import bpy
import numpy as np

from ..core._types import Array, Mask
from . import coordinates, selection

ORDER = 4
RESOLUTION = 4
#: Two coordinates that differ by less are equal but for float32, mm.
ROUNDING_MM = 1e-4


def is_surface(obj: bpy.types.Object | None) -> bool:
    """Whether ``obj`` is one bicubic NURBS surface patch that `read` can read."""
    if obj is None or obj.type != "SURFACE" or len(obj.data.splines) != 1:
        return False
    unit = obj.get(coordinates.UNIT_KEY, 1.0)
    # The user may write anything into a custom property.
    if not isinstance(unit, float | int) or not 1e-12 < unit < 1e12:
        return False
    spline = obj.data.splines[0]
    return (
        spline.point_count_u >= ORDER
        and spline.point_count_v >= ORDER
        and spline.order_u == spline.order_v == ORDER
    )


def create(
    context: bpy.types.Context, name: str, control_points: Array, scale: float = 1.0
) -> bpy.types.Object:
    """Make a SURFACE object; it is linked to the scene's root collection.

    Parameters
    ----------
    control_points : (M, N, 3) array
        Millimetres, core axes; first index u (to the picture's right), second v
        (down).
    scale : float
        Size in the scene; 1 is life size (eyes 0.062 m apart).

    Returns
    -------
    bpy.types.Object
        With the identity matrix, shaded smooth, not selected.
    """
    points = _checked(control_points)
    with selection.object_mode(context):
        curve = _grid(context, name, points.shape[0], points.shape[1])
    obj = bpy.data.objects.new(name, curve)
    obj[coordinates.UNIT_KEY] = coordinates.units_per_mm(context, scale)
    context.scene.collection.objects.link(obj)
    _store(obj, points)
    return obj


def create_like(
    context: bpy.types.Context,
    other: bpy.types.Object,
    name: str,
    control_points: Array,
) -> bpy.types.Object:
    """As `create`, with place and size of another surface."""
    obj = create(context, name, control_points)
    if coordinates.UNIT_KEY in other:
        obj[coordinates.UNIT_KEY] = other[coordinates.UNIT_KEY]
    else:
        del obj[coordinates.UNIT_KEY]
    _store(obj, _checked(control_points))
    obj.matrix_world = other.matrix_world
    return obj


def write(
    context: bpy.types.Context, obj: bpy.types.Object, control_points: Array
) -> None:
    """Give ``obj`` new control points.

    Modifiers, materials and animation stay. With the same numbers of control points
    shape keys move along, otherwise they go; `shape_keys.write` keeps them.

    Parameters
    ----------
    control_points : (M, N, 3) array
        As in `create`.
    """
    points = _checked(control_points)
    if not is_surface(obj):
        raise ValueError(f"{obj.name} is not a bicubic NURBS surface")
    if shape(obj) != points.shape[:2]:
        if obj.data.shape_keys is not None:
            obj.shape_key_clear()
        resize(context, obj, points.shape[:2])
    _store(obj, points)


def resize(
    context: bpy.types.Context, obj: bpy.types.Object, count: tuple[int, int]
) -> None:
    """Give the net of ``obj`` other numbers of control points, in its own data.

    What else there is of the data stays: shape keys with their animation, other
    objects and drivers that use it.  Where the points lie is not said; who calls this
    writes all of them, those of the keys too.

    Parameters
    ----------
    count : (int, int)
        M and N.
    """
    curve = obj.data
    if curve.is_editmode:
        raise ValueError(f"leave edit mode of {obj.name} first")
    steps = curve.resolution_u, curve.resolution_v
    with selection.object_mode(context):
        # Where Blender cannot make the patch, the face keeps the one it has.
        bpy.data.curves.remove(_grid(context, curve.name, *count))
        _make_patch(context, curve, *count)
    curve.resolution_u, curve.resolution_v = steps


def read(obj: bpy.types.Object, key: str | None = None) -> Array:
    """Control points of ``obj`` as the artist left them.

    Parameters
    ----------
    key : str, optional
        Name of a shape key; by default the basis key, or the surface itself
        where it has no keys.

    Returns
    -------
    (M, N, 3) float64 array
        Millimetres, core axes; what was written, but for float32.
    """
    if not is_surface(obj):
        raise ValueError(f"{obj.name} is not a bicubic NURBS surface")
    obj.update_from_editmode()
    m, n = shape(obj)
    keys = obj.data.shape_keys
    if keys is not None:
        block = keys.key_blocks[key] if key else keys.reference_key
        flat = np.empty(m * n * 3, np.float32)
        block.data.foreach_get("co", flat)
        stored = flat.reshape(n, m, 3)
    else:
        flat = np.empty(m * n * 4, np.float32)
        obj.data.splines[0].points.foreach_get("co", flat)
        stored = flat.reshape(n, m, 4)[..., :3]
    local = np.ascontiguousarray(stored.transpose(1, 0, 2), dtype=np.float64)
    return coordinates.from_local(obj, local)


def shape(obj: bpy.types.Object) -> tuple[int, int]:
    """Numbers of control points (M, N)."""
    spline = obj.data.splines[0]
    return spline.point_count_u, spline.point_count_v


def selected(obj: bpy.types.Object) -> Mask:
    """Which control points are selected in edit mode, (M, N) bool array."""
    obj.update_from_editmode()
    m, n = shape(obj)
    flat = np.empty(m * n, bool)
    obj.data.splines[0].points.foreach_get("select", flat)
    return flat.reshape(n, m).T.copy()


def add_shape_key(
    obj: bpy.types.Object, name: str, control_points: Array
) -> bpy.types.ShapeKey:
    """Add or overwrite a shape key; makes the basis key first where there is none.

    Parameters
    ----------
    control_points : (M, N, 3) array
        The shape at value 1, as in `create`.
    """
    points = _checked(control_points)
    if shape(obj) != points.shape[:2]:
        raise ValueError("a shape key needs as many control points as its object")
    if obj.data.shape_keys is None:
        obj.shape_key_add(name="Neutral", from_mix=False)
    block = obj.data.shape_keys.key_blocks.get(name)
    if block is None:
        block = obj.shape_key_add(name=name, from_mix=False)
        block.value = 0.0  # since Blender 5 a new key is on
    block.data.foreach_set("co", _in_blenders_order(obj, points).ravel())
    obj.data.update_tag()
    return block


def remove_shape_keys(obj: bpy.types.Object) -> None:
    """Take all shape keys off; the basis is the surface's shape then."""
    points = read(obj)
    obj.shape_key_clear()
    _store(obj, _checked(points))


def set_resolution(obj: bpy.types.Object, steps: int) -> None:
    """Evaluated quads per control point, both ways."""
    obj.data.resolution_u = obj.data.resolution_v = steps
    obj.data.render_resolution_u = obj.data.render_resolution_v = 0


def _in_blenders_order(obj: bpy.types.Object, points: Array) -> Array:
    """Control points (M, N, 3) in mm as spline points, (N, M, 3) float32."""
    local = coordinates.to_local(obj, points).transpose(1, 0, 2)
    return np.ascontiguousarray(local, np.float32)


def _checked(control_points: Array) -> Array:
    points = np.asarray(control_points, np.float64)
    if points.ndim != 3 or points.shape[2] != 3 or min(points.shape[:2]) < ORDER:
        raise ValueError(
            f"control points must be an (M, N, 3) array with M and N of at least "
            f"{ORDER}, got shape {points.shape}"
        )
    if not np.isfinite(points).all():
        raise ValueError("control points must be finite numbers")
    return points


def _grid(
    context: bpy.types.Context, name: str, count_u: int, count_v: int
) -> bpy.types.Curve:
    """SURFACE curve data with ``count_u`` x ``count_v`` points.

    Must run in object mode with nothing selected.
    """
    curve = bpy.data.curves.new(name, "SURFACE")
    try:
        _make_patch(context, curve, count_u, count_v)
    except BaseException:
        bpy.data.curves.remove(curve)
        raise
    curve.resolution_u = curve.resolution_v = RESOLUTION
    return curve


def _make_patch(
    context: bpy.types.Context, curve: bpy.types.Curve, count_u: int, count_v: int
) -> None:
    """Put one patch of ``count_u`` x ``count_v`` points in place of all splines.

    Blender has no call for this.  ``make_segment`` joins selected rows into a
    patch; it orders them by geometry, hence rows on a regular dummy grid.  In edit
    mode, so that shape keys get as many points too.
    Must run in object mode with nothing selected.
    """
    maker = bpy.data.objects.new(curve.name, curve)
    context.scene.collection.objects.link(maker)
    try:
        # A view that does not show surfaces would keep the operators from them.
        with bpy.context.temp_override(area=None, region=None):
            context.view_layer.objects.active = maker
            maker.select_set(True)
            bpy.ops.object.mode_set(mode="EDIT")
            if len(curve.splines):
                # By Blender's own operator, which forgets the points for the keys too.
                bpy.ops.curve.reveal(select=True)
                bpy.ops.curve.select_all(action="SELECT")
                bpy.ops.curve.delete(type="VERT")
                curve.splines.clear()
            for row in range(count_u):
                spline = curve.splines.new("NURBS")
                spline.points.add(count_v - 1)
                line = np.ones((count_v, 4), np.float32)
                line[:, 0], line[:, 1], line[:, 2] = row, np.arange(count_v), 0.0
                spline.points.foreach_set("co", line.ravel())
            bpy.ops.curve.select_all(action="SELECT")
            bpy.ops.curve.make_segment()
            bpy.ops.object.mode_set(mode="OBJECT")
        spline = curve.splines[0]
        made = (len(curve.splines), spline.point_count_u, spline.point_count_v)
        if made != (1, count_u, count_v):
            raise RuntimeError(
                f"Blender made {made} instead of one {count_u} x {count_v} patch"
            )
    finally:
        bpy.data.objects.remove(maker)
    spline.order_u = spline.order_v = ORDER
    for flag in ("endpoint", "cyclic", "bezier"):
        setattr(spline, f"use_{flag}_u", False)
        setattr(spline, f"use_{flag}_v", False)
    spline.use_smooth = True
    # Making the patch left its points selected, and Refit asks what the artist chose.
    spline.points.foreach_set("select", np.zeros(count_u * count_v, bool))


def _store(obj: bpy.types.Object, points: Array) -> None:
    """Write points in Blender's order; shape keys hold them if present."""
    stored = _in_blenders_order(obj, points)
    curve = obj.data
    in_edit_mode = obj.mode == "EDIT"
    if in_edit_mode:
        raise ValueError(f"leave edit mode of {obj.name} first")
    homogeneous = np.ones((*stored.shape[:2], 4), np.float32)
    homogeneous[..., :3] = stored
    curve.splines[0].points.foreach_set("co", homogeneous.ravel())
    if curve.shape_keys is not None:
        _move_keys(curve.shape_keys, stored)
    curve.update_tag()


def _move_keys(keys, stored):
    """Give the basis key new points; the others keep their difference from it."""
    before, block = np.empty((2, stored.size), np.float32)
    keys.reference_key.data.foreach_get("co", before)
    for key in keys.key_blocks:
        if key != keys.reference_key:
            key.data.foreach_get("co", block)
            key.data.foreach_set("co", block + (stored.ravel() - before))
    keys.reference_key.data.foreach_set("co", stored.ravel())
