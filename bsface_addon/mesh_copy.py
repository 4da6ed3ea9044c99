"""A mesh of the face: the core's quads with eyes, mouth and keys, as an object."""

from __future__ import annotations

import bpy
import numpy as np

from ..core.drawing.pictures import encode_png
from ..core.rig.eyes import iris_picture
from ..core.rig.mesh import PARTS, QuadMesh
from . import material as face_material
from . import surface_object
from .packed_image import packed_image

# Inside of the mouth, linear.
MOUTH = (0.12, 0.02, 0.02, 1.0)


def add(
    face: bpy.types.Object,
    made: QuadMesh,
    kind: str = "mesh",
    skin: bpy.types.Material | None = None,
) -> bpy.types.Object:
    """Make a mesh object at the face's place, with its material.

    Parameters
    ----------
    face : bpy.types.Object
    made : QuadMesh
    kind : str
        What the object is called besides the name of the face.
    skin : bpy.types.Material, optional
        By default the face's own.

    Returns
    -------
    bpy.types.Object
        With vertex groups of the regions, and the keys as shape keys.
    """
    mesh = bpy.data.meshes.new(f"{face.name} {kind}")
    local = surface_object.to_local(face, made.points)
    _fill(mesh, local, made.quads)
    layer = mesh.uv_layers.new(name="UVMap")
    # As on the surface itself: v of the picture runs down from its bottom row.
    layer.data.foreach_set("uv", made.uv[made.quads.ravel()].ravel())
    used = sorted(set(made.part.tolist()))
    if skin is None:
        skin = next(iter(face.data.materials), None)
    for part in used:
        behind = PARTS[part] != "skin"
        mesh.materials.append(_material(PARTS[part]) if behind else skin)
    slot = np.searchsorted(used, made.part).astype(np.int32)
    mesh.polygons.foreach_set("material_index", slot)
    obj = bpy.data.objects.new(mesh.name, mesh)
    for collection in face.users_collection:
        collection.objects.link(obj)
    obj.matrix_world = face.matrix_world
    for name, vertices in made.groups.items():
        obj.vertex_groups.new(name=name).add(vertices.tolist(), 1.0, "REPLACE")
    if made.keys:
        obj.shape_key_add(name="Neutral", from_mix=False)
    for name, moved in made.keys.items():
        block = obj.shape_key_add(name=name, from_mix=False)
        block.value = 0.0  # since Blender 5 a new key is on
        there = local + surface_object.movement_to_local(face, moved)
        block.data.foreach_set("co", there.astype(np.float32).ravel())
    return obj


def _fill(mesh: bpy.types.Mesh, points: np.ndarray, quads: np.ndarray) -> None:
    count = len(quads)
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", points.astype(np.float32).ravel())
    mesh.loops.add(4 * count)
    mesh.loops.foreach_set("vertex_index", quads.astype(np.int32).ravel())
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 4 * count, 4, dtype=np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(count, bool))
    mesh.update(calc_edges=True)
    mesh.validate()


def head_skin(face: bpy.types.Object, png: bytes) -> bpy.types.Material:
    """The material of the face's head.

    Parameters
    ----------
    face : bpy.types.Object
    png : bytes
        The head's picture, its last row the top; empty for the colour of a face
        without a map.
    """
    material = _plain(f"{face.name} head")
    if png:
        _paint(material, png)
    else:
        colour = face_material.PLAIN
        _shader(material).inputs["Base Color"].default_value = colour
        material.diffuse_color = colour
    return material


def _material(part: str) -> bpy.types.Material:
    """The material of all eyes, or of all mouths."""
    name = f"BSface {part}"
    found = bpy.data.materials.get(name)
    if found is not None:
        return found
    material = _plain(name)
    shader = _shader(material)
    if part == "mouth":
        material.diffuse_color = shader.inputs["Base Color"].default_value = MOUTH
        return material
    shader.inputs["Roughness"].default_value = 0.1
    _paint(material, encode_png(iris_picture()))
    return material


def _plain(name: str) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True  # before Blender 5.0; deprecated since
    return material


def _shader(material: bpy.types.Material) -> bpy.types.Node:
    nodes = material.node_tree.nodes
    return next(node for node in nodes if node.type == "BSDF_PRINCIPLED")


def _paint(material: bpy.types.Material, png: bytes) -> None:
    """Give a material a picture, packed into the file."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    picture = nodes.new("ShaderNodeTexImage")
    picture.image = packed_image(material.name, png)
    links.new(picture.outputs["Color"], _shader(material).inputs["Base Color"])
    nodes.active = picture
