"""The mask of one photo as paint over it, in Blender's own Texture Paint mode.

The photo stands on a stage of its own (`photo_stage`) as a plane, tinted where it is
not skin of the face: as measured, and as painted.  Paint is white for skin and black
for what is not; erased paint leaves what was measured.
"""

from __future__ import annotations

import contextlib
import json

import bpy
import numpy as np

from . import photo_stage, view_areas
from .packed_image import packed_image, pixels_of
from .skin_pictures import OPACITY, TINT, Canvas, to_mask

PHOTO = "bsface_mask_of"
# On the plane: what of the scene comes back when the editor closes.  JSON.
SETTINGS = "bsface_paint_before"
# On the window manager: the shading of the views, which is not part of undo.  JSON.
SHADING = "bsface_shading_before"
# Kind -> name, colour and blending of its brush.
BRUSHES = {
    "OTHER": ("Not Skin", 0.0, "MIX"),
    "SKIN": ("Skin", 1.0, "MIX"),
    "MEASURED": ("As Measured", 0.0, "ERASE_ALPHA"),
}
KIND = "bsface_kind"
BRUSH_PX = 40
VIEW_SETTINGS = ("view_transform", "look", "exposure", "gamma")


def editor() -> bpy.types.Object | None:
    """The plane that is being painted, or None."""
    return photo_stage.mesh_with(PHOTO)


def open_editor(context: bpy.types.Context, canvas: Canvas) -> bpy.types.Object:
    """Show a photo with its mask, ready to be painted."""
    obj = _plane(canvas)
    obj[PHOTO] = canvas.name
    strokes = _strokes(canvas)
    obj.data.materials.append(_material(canvas, strokes))
    obj[SETTINGS] = json.dumps(_settings(context))
    photo_stage.open_stage(context, obj, canvas.size)
    context.scene.view_settings.view_transform = "Standard"
    for name, value in (("look", "None"), ("exposure", 0.0), ("gamma", 1.0)):
        setattr(context.scene.view_settings, name, value)
    context.window_manager[SHADING] = json.dumps(
        [space.shading.type for space in _spaces(context)]
    )
    for space in _spaces(context):
        space.shading.type = "MATERIAL"
    bpy.ops.object.mode_set(mode="TEXTURE_PAINT")
    paint = context.tool_settings.image_paint
    paint.mode, paint.canvas = "IMAGE", strokes
    before = paint.brush_asset_reference
    obj["bsface_brush_before"] = json.dumps(
        {
            "asset_library_type": before.asset_library_type,
            "asset_library_identifier": before.asset_library_identifier,
            "relative_asset_identifier": before.relative_asset_identifier,
        }
    )
    _make_brushes()
    choose(context, "OTHER")
    unified(context).size = BRUSH_PX
    return obj


def choose(context: bpy.types.Context, kind: str) -> None:
    """Paint with the brush of a kind, a key of `BRUSHES`; Ctrl paints the opposite."""
    found = {brush.get(KIND): brush for brush in bpy.data.brushes}
    if kind not in found:  # undo took them away
        _make_brushes()
        found = {brush.get(KIND): brush for brush in bpy.data.brushes}
    brush = found[kind]
    bpy.ops.brush.asset_activate(
        asset_library_type="LOCAL",
        asset_library_identifier="",
        relative_asset_identifier=f"Brush/{brush.name}",
    )
    level = BRUSHES[kind][1]
    common = unified(context)
    common.color, common.secondary_color = (level,) * 3, (1 - level,) * 3


def chosen(context: bpy.types.Context) -> str:
    """Kind of the brush in use; empty for another brush."""
    brush = context.tool_settings.image_paint.brush
    return "" if brush is None else brush.get(KIND, "")


def unified(context: bpy.types.Context) -> bpy.types.UnifiedPaintSettings:
    """Size and colour that all brushes share."""
    tools = context.tool_settings
    # Since Blender 5.0 each mode has its own.
    return getattr(tools.image_paint, "unified_paint_settings", None) or (
        tools.unified_paint_settings
    )


def painted(obj: bpy.types.Object) -> bytes:
    """What was painted, as the content of a mask file; empty where nothing was."""
    return to_mask(pixels_of(_nodes(obj)["Strokes"].image))


def close_editor(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Remove the editor's objects, pictures and brushes; all is as before."""
    material = obj.data.materials[0]
    images = [n.image for n in _nodes(obj) if n.type == "TEX_IMAGE"]
    then = json.loads(obj[SETTINGS])
    brush = json.loads(obj["bsface_brush_before"])
    # Blender crashes where the scene does not paint; the asset may be gone too.
    if context.mode == "PAINT_TEXTURE":
        with contextlib.suppress(RuntimeError):
            bpy.ops.brush.asset_activate(**brush)
    photo_stage.close_stage(context, obj)
    bpy.data.batch_remove([b for b in bpy.data.brushes if KIND in b])
    for name in VIEW_SETTINGS:
        setattr(context.scene.view_settings, name, then["view"][name])
    paint, common = context.tool_settings.image_paint, unified(context)
    paint.mode = then["mode"]
    paint.canvas = bpy.data.images.get(then["canvas"])
    for name, value in then["unified"].items():
        setattr(common, name, value)
    bpy.data.batch_remove([material])
    bpy.data.batch_remove(images)
    restore_shading(context)


def restore_shading(context: bpy.types.Context) -> None:
    """Shading of the views as before the editor, unless it is open."""
    before = context.window_manager.get(SHADING)
    if before is None or editor() is not None:
        return
    for space, kind in zip(_spaces(context), json.loads(before), strict=False):
        space.shading.type = kind
    del context.window_manager[SHADING]


def _settings(context: bpy.types.Context) -> dict:
    paint, common = context.tool_settings.image_paint, unified(context)
    view = context.scene.view_settings
    return {
        "mode": paint.mode,
        "canvas": paint.canvas.name if paint.canvas else "",
        "view": {name: getattr(view, name) for name in VIEW_SETTINGS},
        "unified": {
            "size": common.size,
            "color": list(common.color),
            "secondary_color": list(common.secondary_color),
        },
    }


def _plane(canvas: Canvas) -> bpy.types.Object:
    """The photo as a rectangle about the origin; its longer side is 1."""
    x, y = (side / max(canvas.size) / 2 for side in canvas.size)
    mesh = bpy.data.meshes.new(f"Mask {canvas.name}")
    corners = [(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    mesh.uv_layers.new(name="UVMap").data.foreach_set("uv", uv.ravel())
    return bpy.data.objects.new(mesh.name, mesh)


def _strokes(canvas: Canvas) -> bpy.types.Image:
    height, width = canvas.strokes.shape[:2]
    image = bpy.data.images.new(f"Mask {canvas.name}", width, height, alpha=True)
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(np.ascontiguousarray(canvas.strokes[::-1]).ravel())
    image.update()
    return image


def _material(canvas: Canvas, strokes: bpy.types.Image) -> bpy.types.Material:
    """The photo, tinted by what was measured with the paint over it."""
    material = bpy.data.materials.new(f"Mask {canvas.name}")
    if material.node_tree is None:
        material.use_nodes = True  # before Blender 5.0; deprecated since
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    pictures = {
        "Photo": packed_image(f"Photo {canvas.name}", canvas.picture),
        "Tint": packed_image(f"Tint {canvas.name}", canvas.tint),
        "Strokes": strokes,
    }
    for number, (name, image) in enumerate(pictures.items()):
        node = nodes.new("ShaderNodeTexImage")
        node.name, node.image = name, image
        node.extension, node.location = "EXTEND", (-700, -300 * number)
    out = nodes.new("ShaderNodeOutputMaterial")
    light = nodes.new("ShaderNodeEmission")
    links.new(light.outputs[0], out.inputs["Surface"])
    # The tint's strength where black paint lies in place of what was measured.
    full = nodes.new("ShaderNodeMath")
    full.operation, full.inputs[0].default_value = "SUBTRACT", 1.0
    links.new(nodes["Strokes"].outputs["Color"], full.inputs[1])
    other = nodes.new("ShaderNodeMath")
    other.operation, other.inputs[1].default_value = "MULTIPLY", OPACITY
    links.new(full.outputs[0], other.inputs[0])
    strength = _mix(nodes, "FLOAT")
    links.new(nodes["Strokes"].outputs["Alpha"], strength.inputs[0])
    links.new(nodes["Tint"].outputs["Alpha"], strength.inputs[2])
    links.new(other.outputs[0], strength.inputs[3])
    colour = _mix(nodes, "RGBA")
    links.new(strength.outputs[0], colour.inputs[0])
    links.new(nodes["Photo"].outputs["Color"], colour.inputs[6])
    linear = [(level / 255) ** 2.2 for level in TINT]
    colour.inputs[7].default_value = (*linear, 1.0)
    links.new(colour.outputs[2], light.inputs["Color"])
    nodes.active = nodes["Strokes"]
    return material


def _mix(nodes: bpy.types.Nodes, kind: str) -> bpy.types.Node:
    """Sockets 0 factor, 2 and 3 numbers, 6 and 7 colours; the outputs 0 and 2."""
    node = nodes.new("ShaderNodeMix")
    node.data_type = kind
    return node


def _nodes(obj: bpy.types.Object) -> bpy.types.Nodes:
    return obj.data.materials[0].node_tree.nodes


def _make_brushes() -> None:
    for kind, (name, level, blend) in BRUSHES.items():
        brush = bpy.data.brushes.new(f"BSface {name}", mode="TEXTURE_PAINT")
        # Only an asset can be made the active brush.
        brush.asset_mark()
        brush[KIND] = kind
        brush.blend, brush.strength = blend, 1.0
        brush.color, brush.secondary_color = (level,) * 3, (1 - level,) * 3


def _spaces(context: bpy.types.Context) -> list[bpy.types.SpaceView3D]:
    """Of the 3D views of all windows."""
    return [area.spaces.active for area in view_areas.in_all_windows(context)]
