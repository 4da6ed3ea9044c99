"""What the user hung on control points, when a net gets other numbers of them.

Objects with a point, or three, as their parent, and hooks: Blender knows the points by
their numbers.  They go to the points that are nearest in (u, v), and the objects stay
at their places.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import bpy
import numpy as np
from mathutils import Matrix
from scipy.spatial import KDTree

from ..core._types import Array
from . import surface_object

PARENTS = {"VERTEX": 1, "VERTEX_3": 3}


@contextlib.contextmanager
def carried(context: bpy.types.Context, obj: bpy.types.Object) -> Iterator[None]:
    """Inside, the net of an object may get another size; what hangs on it goes along.

    Parameters
    ----------
    obj : bpy.types.Object
        Others may use its data too.
    """
    users = [other for other in bpy.data.objects if other.data == obj.data]
    before = surface_object.shape(obj)
    children = [
        (child, list(child.parent_vertices), _frame(context, child))
        for child in bpy.data.objects
        if child.parent in users and child.parent_type in PARENTS and child.is_editable
    ]
    hooks = [
        (hook, [p for p in hook.vertex_indices if p < before[0] * before[1]])
        for user in users
        for hook in user.modifiers
        if hook.type == "HOOK" and len(hook.vertex_indices)
    ]
    yield
    places, now = _uv(before), _uv(surface_object.shape(obj))
    new, old = KDTree(now), KDTree(places).query(now)[1]
    for child, points, frame in children:
        _move(context, child, _nearest(child, points, places, new), frame)
    for hook, points in hooks:
        # All that stand for the hooked points; of a coarser net at least one each.
        found = set(np.flatnonzero(np.isin(old, list(points))).tolist())
        found |= {int(new.query(places[p])[1]) for p in points}
        hook.vertex_indices_set(sorted(found))


def _move(
    context: bpy.types.Context, child: bpy.types.Object, points: list[int], then: Matrix
) -> None:
    """Give a child other points as its parent; it stays at its place."""
    child.parent_vertices = points
    # By the inverse, not by the child's own place, which may be animated.
    inverse = _frame(context, child).inverted_safe() @ then
    child.matrix_parent_inverse = inverse @ child.matrix_parent_inverse


def _frame(context: bpy.types.Context, child: bpy.types.Object) -> Matrix:
    """The place in the scene that the points of a child's parent give to it."""
    probe = bpy.data.objects.new("probe", None)
    context.scene.collection.objects.link(probe)
    try:
        probe.parent, probe.parent_type = child.parent, child.parent_type
        probe.parent_vertices = child.parent_vertices
        context.view_layer.update()
        return probe.matrix_world.copy()
    finally:
        bpy.data.objects.remove(probe)


def _nearest(
    child: bpy.types.Object, points: list[int], places: Array, new: KDTree
) -> list[int]:
    """Numbers of the new points for the old ones; three of them stay three."""
    found = [0, 0, 0]
    for i in range(PARENTS[child.parent_type]):
        if points[i] < len(places):  # the user may have set any number
            closest = new.query(places[points[i]], k=3)[1]
            found[i] = next(int(p) for p in closest if p not in found[:i])
    return found


def _uv(count: tuple[int, int]) -> Array:
    """Where the points of a net of this size act most, in Blender's order, (k, 2)."""
    u, v = ((np.arange(k) - 1) / (k - 3) for k in count)
    return np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
