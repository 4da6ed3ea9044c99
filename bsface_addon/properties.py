"""The add-on's state in the file: one group on the scene, nothing else global.

What belongs to a face (settings of its run, report, landmarks) is stored on the
face object as custom properties, see `scene`.
"""

from __future__ import annotations

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from . import cameras, photo_stage, scene, showing
from .settings_group import BSFACE_PG_settings

# A script may write paths that begin with //, the folder of the .blend.
RELATIVE = {"PATH_SUPPORTS_BLEND_RELATIVE"}


class BSFACE_PG_photo(bpy.types.PropertyGroup):
    """One row of the photo list."""

    name: StringProperty(name="Name", description="Name of the photo in the report")
    path: StringProperty(name="File", subtype="FILE_PATH", options=RELATIVE)
    original: StringProperty(
        name="Original",
        description="The file before it was turned",
        subtype="FILE_PATH",
        options=RELATIVE,
    )
    quarters: IntProperty(name="Quarter Turns", description="Clockwise")
    use: BoolProperty(
        name="Use", description="Use this photo in the next run", default=True
    )
    status: StringProperty(name="Status", default="waiting")
    reason: StringProperty(name="Reason")
    yaw: FloatProperty(name="Turned", description="Degrees to the picture's right")
    landmarks: StringProperty(name="Landmarks", description="As JSON; empty: none yet")
    expression: StringProperty(
        name="Expression",
        description="Photos with the same word make one shape key; empty: neutral",
    )
    faces: IntProperty(name="Faces", description="Faces seen in this photo")
    mask: PointerProperty(
        name="Mask",
        description="What of the photo is skin, painted: white is, black is not",
        type=bpy.types.Image,
    )


def _row_chosen(state, context):
    """A click on a row goes to that photo's camera, where there is one."""
    face = scene.active_face(context)
    inside = 0 <= state.active_photo < len(state.photos)
    if not state.follow or face is None or not inside:
        return
    if photo_stage.is_open():
        return
    name = state.photos[state.active_photo].name
    for view in cameras.of_face(face):
        if view[cameras.PHOTO_KEY] == name:
            showing.photo(context, face, view)


def _opacity_set(state, context):
    face = scene.active_face(context)
    if face is not None and cameras.in_front(face):
        for view in cameras.of_face(face):
            cameras.put_photo(view, True, state.photo_opacity)


class BSFACE_PG_scene(bpy.types.PropertyGroup):
    """Everything of the scene."""

    photos: CollectionProperty(type=BSFACE_PG_photo)
    active_photo: IntProperty(name="Photo", options={"SKIP_SAVE"}, update=_row_chosen)
    follow: BoolProperty(
        description="Whether a newly active row changes the view",
        default=True,
        options={"SKIP_SAVE", "HIDDEN"},
    )
    mirror: BoolProperty(
        name="Mirror",
        description="What moves on one half of the coarse net moves on the other too",
        default=True,
    )
    show_skin: BoolProperty(
        name="Skin Mask",
        description="Whether the photo that one looks through is tinted",
        options={"SKIP_SAVE"},
    )
    photo_opacity: FloatProperty(
        name="Opacity",
        description="Of the photo in front of the surface",
        default=0.5,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        update=_opacity_set,
    )
    settings: PointerProperty(type=BSFACE_PG_settings)
    face: PointerProperty(
        name="Face",
        description="The face that the next run updates",
        type=bpy.types.Object,
    )
    size: FloatProperty(
        name="Size",
        description="1 is life size in the scene's units: the eyes are 62 mm apart",
        default=1.0,
        min=0.001,
        soft_max=10.0,
        max=1000.0,
    )
    texture_size: EnumProperty(
        name="Texture Size",
        description="Pixels along each side of the skin texture",
        items=(
            ("AUTO", "Texture: Automatic", "As many as the sharpest photos are worth"),
            ("512", "Texture: 512", "For a quick look"),
            ("1024", "Texture: 1024", ""),
            ("2048", "Texture: 2048", ""),
            ("4096", "Texture: 4096", ""),
        ),
    )
    separate: BoolProperty(
        name="Make Another Face",
        description="Make a new object instead of updating the face that is there",
    )
    softness: FloatProperty(
        name="Softness (mm)",
        description="How far held points may give way in Refit; 0 = not at all",
        default=0.3,
        min=0.0,
        soft_max=5.0,
        max=20.0,
    )
    hints: StringProperty(
        name="Hints", description="What photos are missing, one sentence a line"
    )
    last_error: StringProperty(name="Last Error", options={"SKIP_SAVE"})


CLASSES = (BSFACE_PG_photo, BSFACE_PG_settings, BSFACE_PG_scene)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.bsface = PointerProperty(type=BSFACE_PG_scene)


def unregister():
    del bpy.types.Scene.bsface
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
