"""The nodes of a face's material: shaders for lit and for measured maps, and the cut.

What is on them, `material` decides.
"""

from __future__ import annotations

import bpy

# A tangent-space normal map: never shown as colours, always on the lit skin.
DETAIL = "DETAIL"
PLAIN = (0.62, 0.42, 0.33, 1.0)
NAMES = ("Output", "Skin", "Flat", "Plain")


def make(material: bpy.types.Material) -> None:
    """Make the nodes that are not there; those of the user stay."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    fresh = "Skin" not in nodes
    for name, kind, place in (
        ("Output", "ShaderNodeOutputMaterial", (500, 0)),
        ("Skin", "ShaderNodeBsdfPrincipled", (0, 0)),
        ("Flat", "ShaderNodeEmission", (0, -420)),
        ("Plain", "ShaderNodeTexImage", (-340, 300)),
    ):
        if name not in nodes:
            node = nodes.new(kind)
            node.name, node.location = name, place
    cut = cutter(material)
    if not nodes["Output"].inputs["Surface"].is_linked:
        links.new(cut.outputs[0], nodes["Output"].inputs["Surface"])
    if fresh:
        skin = nodes["Skin"]
        skin.inputs["Base Color"].default_value = PLAIN
        skin.inputs["Roughness"].default_value = 0.5
        if not cut.inputs[2].is_linked:
            links.new(skin.outputs[0], cut.inputs[2])
        if DETAIL in nodes:
            bend_normals(skin, nodes[DETAIL])


def cutter(material: bpy.types.Material) -> bpy.types.Node:
    """The node that lets through what a map's transparency takes away."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    cut = nodes.get("Cut")
    if cut is None:
        cut = nodes.new("ShaderNodeMixShader")
        clear = nodes.new("ShaderNodeBsdfTransparent")
        cut.name, cut.location = "Cut", (300, 0)
        clear.name, clear.location = "Clear", (100, 160)
        links.new(clear.outputs[0], cut.inputs[1])
        links.new(cut.outputs[0], nodes["Output"].inputs["Surface"])
        cut.inputs["Fac"].default_value = 1.0
        links.new(nodes["Skin"].outputs[0], cut.inputs[2])
    return cut


def bend_normals(shader: bpy.types.Node, picture: bpy.types.Node) -> None:
    """Let a tangent-space normal map turn the normals that a shader sees."""
    tree = shader.id_data
    bend = tree.nodes.get("Normal Map") or tree.nodes.new("ShaderNodeNormalMap")
    bend.name, bend.location = "Normal Map", (-120, picture.location.y)
    tree.links.new(picture.outputs["Color"], bend.inputs["Color"])
    tree.links.new(bend.outputs["Normal"], shader.inputs["Normal"])
