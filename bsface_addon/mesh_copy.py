"""A mesh of the face: the core's quads with eyes, mouth and keys, as an object."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ..core.drawing.pictures import encode_png
from ..core.rig.eyes import iris_picture
from ..core.rig.mesh import PARTS, QuadMesh
from . import coordinates
from . import material as face_material
from .packed_image import packed_image

# On every object that the add-on makes.
MARK = "bsface"
# Inside of the mouth, linear.
MOUTH = (0.12, 0.02, 0.02, 1.0)


def local_mesh(made: QuadMesh, unit: float | None) -> QuadMesh:
    """A mesh in the coordinates of an object, ready for Blender; any thread may do it.

    Parameters
    ----------
    unit : float or None
        The object's units per millimetre, `coordinates.UNIT_KEY`.
    """
    points = coordinates.in_units(unit, made.points)
    keys = {
        name: (points + coordinates.in_units(unit, moved)).astype(np.float32)
        for name, moved in made.keys.items()
    }
    return replace(made, points=points.astype(np.float32), keys=keys)


def add(
    face: bpy.types.Object,
    local: QuadMesh,
    kind: str = "mesh",
    skin: bpy.types.Material | None = None,
) -> bpy.types.Object:
    """Make a mesh object at the face's place, with its material.

    Parameters
    ----------
    face : bpy.types.Object
    local : QuadMesh
        See `local_mesh`; its keys are places, not movements.
    kind : str
        What the object is called besides the name of the face.
    skin : bpy.types.Material, optional
        By default the face's own.

    Returns
    -------
    bpy.types.Object
        With vertex groups of the regions, and the keys as shape keys.
    """
    # As on the surface itself: v of the picture runs down from its bottom row.
    obj = _object(f"{face.name} {kind}", local)
    obj[MARK] = kind
    if skin is None:
        skin = next(iter(face.data.materials), None)
    for part in _parts(local):
        obj.data.materials.append(skin if part == "skin" else _material(part))
    for collection in _open_homes(face) or [bpy.context.scene.collection]:
        collection.objects.link(obj)
    obj.matrix_world = face.matrix_world
    return obj


def _open_homes(face: bpy.types.Object) -> list[bpy.types.Collection]:
    """Collections of a face that take another object: none of another file."""
    homes = face.users_collection
    return [c for c in homes if c.library is None and c.override_library is None]


def stand_alone(
    name: str, made: QuadMesh, texture: Path | None, normals: Path | None
) -> bpy.types.Object:
    """Make a mesh object without a face, upright and in metres.

    Parameters
    ----------
    texture, normals : Path or None
        Picture of the skin and its normal map, green up; their top row is v = 0.

    Returns
    -------
    bpy.types.Object
        As of `add`, but in no collection yet, and with v upwards.
    """
    local = local_mesh(made, coordinates.METRES_PER_MM)
    uv = np.stack([made.uv[:, 0], 1 - made.uv[:, 1]], 1)
    local = replace(local, uv=uv)
    obj = _object(name, local)
    for part in _parts(made):
        if part == "skin":
            material = _plain(f"{name} skin")
            # From their files: exporters find no others.
            if texture is not None:
                _paint(material, bpy.data.images.load(str(texture)))
            if normals is not None:
                _bend(material, bpy.data.images.load(str(normals)))
        else:
            material = _material(part)
        obj.data.materials.append(material)
    return obj


def _parts(made: QuadMesh) -> list[str]:
    """The parts that a mesh has, in the order of its material slots."""
    return [PARTS[part] for part in sorted(set(made.part.tolist()))]


def _object(name: str, local: QuadMesh) -> bpy.types.Object:
    """An object of a mesh in its own coordinates, with groups and keys."""
    mesh = bpy.data.meshes.new(name)
    _fill(mesh, local.points, local.quads)
    layer = mesh.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", local.uv[local.quads.ravel()].ravel())
    used = sorted(set(local.part.tolist()))
    slot = np.searchsorted(used, local.part).astype(np.int32)
    mesh.polygons.foreach_set("material_index", slot)
    obj = bpy.data.objects.new(name, mesh)
    for region, vertices in local.groups.items():
        obj.vertex_groups.new(name=region).add(vertices.tolist(), 1.0, "REPLACE")
    if local.keys:
        obj.shape_key_add(name="Neutral", from_mix=False)
    for key, there in local.keys.items():
        block = obj.shape_key_add(name=key, from_mix=False)
        block.value = 0.0  # since Blender 5 a new key is on
        # `points` is the same as `data`, but is written at once.
        block.points.foreach_set("co", there.ravel())
    return obj


def _fill(mesh: bpy.types.Mesh, points: np.ndarray, quads: np.ndarray) -> None:
    count = len(quads)
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", points.ravel())
    mesh.loops.add(4 * count)
    mesh.loops.foreach_set("vertex_index", quads.astype(np.int32).ravel())
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 4 * count, 4, dtype=np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(count, bool))
    mesh.update(calc_edges=True)
    mesh.validate()


def head_skin(
    face: bpy.types.Object, png: bytes, detail: bytes = b""
) -> bpy.types.Material:
    """The material of the face's head.

    Parameters
    ----------
    face : bpy.types.Object
    png : bytes
        The head's picture, its last row the top; empty for the colour of a face
        without a map.
    detail : bytes
        The head's normal map, as `maps.head` makes it; empty for none.
    """
    material = _plain(f"{face.name} head")
    if detail:
        _bend(material, packed_image(f"{material.name} Detail", detail))
    if png:
        _paint(material, packed_image(material.name, png))
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
    _paint(material, packed_image(name, encode_png(iris_picture())))
    return material


def _plain(name: str) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True  # before Blender 5.0; deprecated since
    return material


def _shader(material: bpy.types.Material) -> bpy.types.Node:
    nodes = material.node_tree.nodes
    return next(node for node in nodes if node.type == "BSDF_PRINCIPLED")


def _paint(material: bpy.types.Material, image: bpy.types.Image) -> None:
    """Give a material the colours of a picture."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    picture = nodes.new("ShaderNodeTexImage")
    picture.image = image
    links.new(picture.outputs["Color"], _shader(material).inputs["Base Color"])
    nodes.active = picture


def _bend(material: bpy.types.Material, image: bpy.types.Image) -> None:
    """Give a material a normal map."""
    image.colorspace_settings.name = "Non-Color"
    picture = material.node_tree.nodes.new("ShaderNodeTexImage")
    picture.image, picture.location = image, (-400, -300)
    face_material.bend_normals(_shader(material), picture)
