"""The face's material and the maps that can be shown on the surface.

A NURBS surface has no attributes or colours per point, but Blender gives it UVs:
``(u, v)`` of the core.  So every map is an image whose row j is v_j; as Blender's rows
start at the bottom and v runs down, arrays go in as they are.
"""

from __future__ import annotations

import bpy
import numpy as np

# kind -> the label of its image and whether the light of the scene falls on it
MAPS = {
    "SKIN": ("skin", True),
    "PHOTO": ("photo texture", False),
    "NORMALS": ("normals", False),
    "RESIDUAL": ("residual", False),
    "CONFIDENCE": ("confidence", False),
}
PLAIN = (0.62, 0.42, 0.33, 1.0)
KIND_KEY = "bsface_map"
LEGEND_KEY = "bsface_legend"


def of_face(face):
    """The face's own material; made where it has none yet."""
    for material in face.data.materials:
        if material is not None and material.get("bsface"):
            return material
    material = bpy.data.materials.new(f"BSface {face.name}")
    material["bsface"] = True
    _nodes(material)
    face.data.materials.append(material)
    return material


def store_map(face, kind, pixels, legend=""):
    """Keep a map with the face, packed into the file.

    Parameters
    ----------
    kind : str
        A key of `MAPS`.
    pixels : (h, w, 3) array
        Row j is v_j (top of the face first), column i is u_i; uint8, or floats in
        [0, 1]; sRGB-encoded colours.
    legend : str
        What the colours mean, for the panel.

    Returns
    -------
    bpy.types.Image
    """
    values = np.asarray(pixels)
    if values.dtype.kind == "u":
        values = values / float(np.iinfo(values.dtype).max)
    height, width = values.shape[:2]
    image = stored_map(face, kind)
    if image is None:
        image = bpy.data.images.new(f"{face.name} {MAPS[kind][0]}", width, height)
        image[KIND_KEY] = kind
    elif tuple(image.size) != (width, height):
        image.scale(width, height)
    image[LEGEND_KEY] = legend
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = np.clip(values[..., :3], 0, 1)
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    image.pack()
    _remember(face, kind, image)
    return image


def stored_map(face, kind):
    """The image of a map, or None."""
    node = of_face(face).node_tree.nodes.get(kind)
    return None if node is None else node.image


def stored_kinds(face):
    """Kinds of map that this face has, without making anything."""
    for material in face.data.materials:
        if material is not None and material.get("bsface") and material.node_tree:
            nodes = material.node_tree.nodes
            return [kind for kind in MAPS if nodes.get(kind) and nodes[kind].image]
    return []


def shown(face):
    """Kind of the map on the surface now, "PLAIN" for none."""
    for material in face.data.materials:
        if material is not None and material.get("bsface"):
            return material.get(KIND_KEY, "PLAIN")
    return "PLAIN"


def is_lit(kind):
    """Whether light falls on the map; measured values are shown as they are."""
    return kind == "PLAIN" or MAPS[kind][1]


def legend(face):
    """What the colours of the shown map mean; empty for skin and photos."""
    kind = shown(face)
    if kind not in stored_kinds(face):
        return ""
    return stored_map(face, kind).get(LEGEND_KEY, "")


def show(face, kind):
    """Put a stored map, or "PLAIN" for none, on the surface."""
    material = of_face(face)
    tree = material.node_tree
    nodes, links = tree.nodes, tree.links
    output, skin, flat = nodes["Output"], nodes["Skin"], nodes["Flat"]
    for socket in (output.inputs["Surface"], skin.inputs["Base Color"]):
        for link in list(socket.links):
            links.remove(link)
    if kind == "PLAIN":
        links.new(skin.outputs["BSDF"], output.inputs["Surface"])
        # Solid view keeps to the last active image; one without a picture ends that.
        nodes.active = nodes["Plain"]
    else:
        texture = nodes.get(kind)
        if texture is None or texture.image is None:
            raise KeyError(kind)
        if MAPS[kind][1]:
            links.new(texture.outputs["Color"], skin.inputs["Base Color"])
            links.new(skin.outputs["BSDF"], output.inputs["Surface"])
        else:
            links.new(texture.outputs["Color"], flat.inputs["Color"])
            links.new(flat.outputs["Emission"], output.inputs["Surface"])
        # Solid view with the colour "Texture" shows the active image node.
        nodes.active = texture
    material[KIND_KEY] = kind


def _nodes(material):
    if material.node_tree is None:
        material.use_nodes = True  # before Blender 5.0; deprecated since
    nodes = material.node_tree.nodes
    nodes.clear()
    for name, kind, place in (
        ("Output", "ShaderNodeOutputMaterial", (300, 0)),
        ("Skin", "ShaderNodeBsdfPrincipled", (0, 0)),
        ("Flat", "ShaderNodeEmission", (0, -420)),
        ("Plain", "ShaderNodeTexImage", (-340, 300)),
    ):
        node = nodes.new(kind)
        node.name, node.location = name, place
    nodes["Skin"].inputs["Base Color"].default_value = PLAIN
    nodes["Skin"].inputs["Roughness"].default_value = 0.5
    material.diffuse_color = PLAIN
    material.roughness = 0.5
    material.node_tree.links.new(
        nodes["Skin"].outputs["BSDF"], nodes["Output"].inputs["Surface"]
    )


def _remember(face, kind, image):
    nodes = of_face(face).node_tree.nodes
    node = nodes.get(kind)
    if node is None:
        node = nodes.new("ShaderNodeTexImage")
        node.name, node.label = kind, MAPS[kind][0]
        node.location = (-340, -300 * list(MAPS).index(kind))
        # The surface ends at its own border; repeating would bleed the other side in.
        node.extension = "EXTEND"
    node.image = image
