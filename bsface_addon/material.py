"""The face's material and the maps that can be shown on the surface.

A NURBS surface has no attributes or colours per point, but Blender gives it UVs:
``(u, v)`` of the core.  So every map is a picture over (u, v), see `maps`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Container, Iterable
from pathlib import Path

import bpy
import numpy as np

from ..core.drawing.pictures import encode_png
from ..core.errors import ReconstructionError
from . import material_nodes, messages
from .maps import Map
from .material_nodes import DETAIL, PLAIN, bend_normals
from .packed_image import packed_image, pixels_of

# kind -> the name of its image and whether the light of the scene falls on it
MAPS = {
    "SKIN": ("Skin", True),
    "PHOTO": ("Photo Texture", False),
    "NORMALS": ("Normals", False),
    "RESIDUAL": ("Residual", False),
    "DEVIATION": ("Deviation", False),
}
KIND_KEY = "bsface_map"
# The picture that was last on the lit shader, and what the artist had put between: the
# second with the kind of picture after it.
LIT_KEY = "bsface_lit"
LINK_KEY = "bsface_link_"
LEGEND_KEY = "bsface_legend"
WHOLE_KEY = "bsface_whole"
# Hash of the picture as it was made, before anybody painted on it.
MADE_KEY = "bsface_made"
# Names of kinds in files of version 0.1.
OLD_KINDS = {"CONFIDENCE": "DEVIATION"}


def of_face(face: bpy.types.Object) -> bpy.types.Material:
    """The face's own material; made where it has none yet."""
    found = existing(face)
    if found is not None:
        if any(name not in found.node_tree.nodes for name in material_nodes.NAMES):
            material_nodes.make(found)  # the user deleted some
        return found
    material = bpy.data.materials.new(f"BSface {face.name}")
    material["bsface"] = True
    if material.node_tree is None:
        material.use_nodes = True  # before Blender 5.0; deprecated since
    material.node_tree.nodes.clear()
    material.diffuse_color = PLAIN
    material.roughness = 0.5
    material_nodes.make(material)
    face.data.materials.append(material)
    return material


def existing(face: bpy.types.Object) -> bpy.types.Material | None:
    """The face's own material, or None; nothing is made."""
    for material in face.data.materials:
        if material is not None and material.get("bsface") and material.node_tree:
            return material
    return None


def store_map(face: bpy.types.Object, kind: str, found: Map) -> bpy.types.Image:
    """Keep a map with the face, packed into the file.

    Parameters
    ----------
    kind : str
        A key of `MAPS`, "PLAIN" or `DETAIL`.
    found : Map
    """
    name = kind.title() if kind in ("PLAIN", DETAIL) else MAPS[kind][0]
    node = _node(face, kind)
    old = node.image
    image = packed_image(f"{face.name} {name}", found.png)
    image[KIND_KEY], image[LEGEND_KEY] = kind, found.legend
    image[MADE_KEY] = _hash(found.png)
    if kind == DETAIL:
        image.colorspace_settings.name = "Non-Color"
    else:
        _cut(image, is_trimmed(face))
    node.image = image
    if old is not None and old.users == 0:
        title = old.name
        _let_go(old)
        image.name = title
    return image


def own(face: bpy.types.Object, others: Iterable[bpy.types.Object]) -> None:
    """Give a copy of a face a material of its own, before its maps are replaced.

    Parameters
    ----------
    others : objects
        The other faces.
    """
    found = existing(face)
    sharing = (other for other in others if other.data != face.data)
    if any(found in other.data.materials[:] for other in sharing if found):
        face.data.materials[face.data.materials.find(found.name)] = found.copy()


def _let_go(image: bpy.types.Image) -> None:
    """Remove a map that a newer one replaces; what was painted on it is kept."""
    packed = image.packed_file
    made = image.get(MADE_KEY)
    if image.is_dirty or (packed and made and _hash(packed.data) != made):
        image.name = f"{image.name} Painted"
        image.use_fake_user = True
    else:
        bpy.data.images.remove(image)


def _hash(png: bytes) -> str:
    return hashlib.sha256(png).hexdigest()


def drop_others(face: bpy.types.Object, kinds: Container[str]) -> None:
    """Remove maps of an earlier run that the newest one could not make."""
    nodes = of_face(face).node_tree.nodes
    for kind in (*stored_kinds(face), DETAIL):
        if kind not in kinds and kind in nodes:
            if shown(face) == kind:
                show(face, "PLAIN")
            image = nodes[kind].image
            nodes.remove(nodes[kind])
            if image is not None and image.users == 0:
                _let_go(image)


def stored_map(face: bpy.types.Object, kind: str) -> bpy.types.Image | None:
    """The image of a map, or None."""
    material = existing(face)
    node = material.node_tree.nodes.get(kind) if material else None
    return None if node is None else node.image


def packed_map(face: bpy.types.Object, kind: str) -> bytes:
    """The file of a map, with what was painted on it; empty for none.

    Raises
    ------
    ReconstructionError
        The user has unpacked it, and the file is gone.
    """
    image = stored_map(face, kind)
    if image is None:
        return b""
    if image.is_dirty and not image.is_float:
        rows = np.round(255 * pixels_of(image)).astype(np.uint8)
        return encode_png(np.ascontiguousarray(rows))
    if image.packed_file is not None:
        return image.packed_file.data
    path = Path(bpy.path.abspath(image.filepath))
    try:
        return path.read_bytes()
    except OSError:
        text = messages.NO_PICTURE.format(name=image.name, path=path)
        raise ReconstructionError(text) from None


def stored_kinds(face: bpy.types.Object) -> list[str]:
    """Kinds of map that this face has."""
    return [kind for kind in MAPS if stored_map(face, kind) is not None]


def images(face: bpy.types.Object) -> list[bpy.types.Image]:
    """The images of all maps."""
    found = (stored_map(face, kind) for kind in (*MAPS, DETAIL, "Plain"))
    return [image for image in found if image is not None]


def shown(face: bpy.types.Object) -> str:
    """Kind of the map on the surface now, "PLAIN" for none."""
    material = existing(face)
    return "PLAIN" if material is None else material.get(KIND_KEY, "PLAIN")


def is_lit(kind: str) -> bool:
    """Whether light falls on the map; measured values are shown as they are."""
    return kind == "PLAIN" or MAPS[kind][1]


def legend(face: bpy.types.Object) -> str:
    """What the colours of the shown map mean; empty for skin and photos."""
    image = stored_map(face, shown(face))
    return "" if image is None else image.get(LEGEND_KEY, "")


def show(face: bpy.types.Object, kind: str) -> None:
    """Put a stored map, or "PLAIN" for none, on the surface.

    Raises
    ------
    KeyError
        The face has no such map.
    """
    if kind != "PLAIN" and stored_map(face, kind) is None:
        raise KeyError(kind)
    material = of_face(face)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    skin, flat, cut = nodes["Skin"], nodes["Flat"], material_nodes.cutter(material)
    shader = skin if is_lit(kind) else flat
    colour = skin.inputs["Base Color"] if is_lit(kind) else flat.inputs["Color"]
    source = None
    if is_lit(kind):
        _keep_link(material, colour)
        for link in list(colour.links):
            links.remove(link)
        source = _kept_link(material, kind)
        material[LIT_KEY] = kind
    picture = nodes["Plain"] if kind == "PLAIN" else nodes[kind]
    if source is not None:
        links.new(source, colour)
    elif picture.image is not None:
        links.new(picture.outputs["Color"], colour)
    if picture.image is not None:
        links.new(picture.outputs["Alpha"], cut.inputs["Fac"])
    else:
        for link in list(cut.inputs["Fac"].links):
            links.remove(link)
        cut.inputs["Fac"].default_value = 1.0
    links.new(shader.outputs[0], cut.inputs[2])
    # Solid view with the colour "Texture" shows the active image node.
    nodes.active = picture
    material[KIND_KEY] = kind


def _keep_link(material: bpy.types.Material, colour: bpy.types.NodeSocket) -> None:
    """Remember what the artist has put between the shown picture and the shader."""
    key = LINK_KEY + material.get(LIT_KEY, "SKIN")
    material.pop(key, None)
    for link in colour.links:
        if link.from_node.name not in (*MAPS, "Plain"):
            material[key] = [link.from_node.name, link.from_socket.identifier]


def _kept_link(material: bpy.types.Material, kind: str) -> bpy.types.NodeSocket | None:
    """What `_keep_link` remembers, or None."""
    name, identifier = material.get(LINK_KEY + kind, ("", ""))
    node = material.node_tree.nodes.get(name)
    outputs = [] if node is None else node.outputs
    return next((out for out in outputs if out.identifier == identifier), None)


def is_trimmed(face: bpy.types.Object) -> bool:
    """Whether the maps hide what lies outside of the face's outline."""
    material = existing(face)
    return material is None or not material.get(WHOLE_KEY, False)


def trim(face: bpy.types.Object, on: bool) -> None:
    """Hide what lies outside of the face's outline, or show the whole patch."""
    of_face(face)[WHOLE_KEY] = not on
    for image in images(face):
        _cut(image, on)


def upgrade() -> None:
    """Give the materials of a file of version 0.1 the names of now."""
    for material in bpy.data.materials:
        if not material.get("bsface") or material.node_tree is None:
            continue
        for old, new in OLD_KINDS.items():
            node = material.node_tree.nodes.get(old)
            if node is not None:
                node.name = new
            if material.get(KIND_KEY) == old:
                material[KIND_KEY] = new


def _cut(image: bpy.types.Image, on: bool) -> None:
    image.alpha_mode = "STRAIGHT" if on else "NONE"


def _node(face: bpy.types.Object, kind: str) -> bpy.types.Node:
    nodes = of_face(face).node_tree.nodes
    if kind == "PLAIN":
        return nodes["Plain"]
    node = nodes.get(kind)
    if node is None:
        node = nodes.new("ShaderNodeTexImage")
        kinds = [*MAPS, DETAIL]
        node.name = kind
        node.label = kind.title() if kind == DETAIL else MAPS[kind][0]
        node.location = (-340, -300 * kinds.index(kind))
        # The surface ends at its own border; repeating would bleed the other side in.
        node.extension = "EXTEND"
        if kind == DETAIL:
            bend_normals(nodes["Skin"], node)
    return node
