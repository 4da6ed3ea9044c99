"""A mesh of the face: the core's triangles, trimmed to the face, with its UVs."""

from __future__ import annotations

import bpy
import numpy as np

from . import surface_object


def add(context, face, surface, outline_uv, tolerance):
    """Make a mesh object beside the face.

    Parameters
    ----------
    face : bpy.types.Object
        Gives name, place and materials.
    surface : core BSplineSurface
    outline_uv : (k, 2) array or None
        Where to trim; None for the whole patch.
    tolerance : float
        Largest distance from the surface, mm.

    Returns
    -------
    bpy.types.Object
    """
    from ..core.formats.mesh import tessellate

    made = tessellate(surface, outline_uv, tolerance)
    mesh = bpy.data.meshes.new(f"{face.name} mesh")
    _fill(mesh, surface_object.to_local(face, made.vertices), made.triangles)
    mesh.polygons.foreach_set("use_smooth", np.ones(len(made.triangles), bool))
    layer = mesh.uv_layers.new(name="UVMap")
    # As on the surface itself: v of the picture runs down from its bottom row.
    layer.data.foreach_set("uv", made.uv[made.triangles.ravel()].ravel())
    normals = surface_object.direction_to_local(face, made.normals)
    mesh.normals_split_custom_set_from_vertices(normals)
    for material in face.data.materials:
        mesh.materials.append(material)
    obj = bpy.data.objects.new(mesh.name, mesh)
    for collection in face.users_collection:
        collection.objects.link(obj)
    obj.matrix_world = face.matrix_world
    return obj


def _fill(mesh, vertices, triangles):
    count = len(triangles)
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    mesh.loops.add(3 * count)
    mesh.loops.foreach_set("vertex_index", triangles.astype(np.int32).ravel())
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    mesh.validate()
