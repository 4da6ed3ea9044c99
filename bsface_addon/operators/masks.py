"""What is skin in a photo: show it, paint it, keep it as a file, forget it."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty

from ...core.errors import ReconstructionError
from ...core.files import write_bytes
from ...core.images.mask_file import ENDING
from .. import (
    cameras,
    mask_editor,
    messages,
    photo_list,
    photo_stage,
    scene,
    showing,
    skin_overlay,
    skin_pictures,
)
from ..skin_pictures import PhotoToPaint
from .photos import RowOperator, ready
from .refusals import refusals_reported
from .running import LongOperator
from .views import ViewOperator


def on_this_stage(cls, context, obj):
    """Shared poll: what is being edited is in this scene, or nothing is."""
    elsewhere = photo_stage.elsewhere(context, obj)
    if elsewhere:
        cls.poll_message_set(messages.STAGE_ELSEWHERE.format(name=elsewhere))
    return not elsewhere


class BSFACE_OT_skin_show(ViewOperator, bpy.types.Operator):
    """Tint the photo where it does not count as skin of the face"""

    bl_idname = "bsface.skin_show"
    bl_label = "Skin Mask"
    bl_options = {"REGISTER", "UNDO"}
    edits = True

    show: BoolProperty(name="Show", default=True)

    def execute(self, context):
        state, face = context.scene.bsface, scene.active_face(context)
        state.show_skin = self.show
        views = cameras.of_face(face)
        if self.show and not any(cameras.SKIN_KEY in view for view in views):
            self.report({"WARNING"}, messages.NO_SKIN.format(name=face.name))
        if self.show and context.scene.camera not in views:
            rows = {row.name: i for i, row in enumerate(state.photos)}
            at = [rows.get(view[cameras.PHOTO_KEY]) for view in views]
            chosen = at.index(state.active_photo) if state.active_photo in at else 0
            showing.photo(context, face, views[chosen])
        skin_overlay.refresh(context, face)
        return {"FINISHED"}


class BSFACE_OT_mask_edit(RowOperator, LongOperator, bpy.types.Operator):
    """Paint over the photo what is skin of the face and what is not, then press Done"""

    bl_idname = "bsface.mask_edit"
    bl_label = "Paint Mask"
    bl_options = {"UNDO"}
    opens_editor = True

    @classmethod
    def poll(cls, context):
        if photo_stage.is_open():
            cls.poll_message_set(messages.STAGE_OPEN)
            return False
        return ready(cls, context)

    def prepare(self, context):
        row = self.wanted(context)
        return PhotoToPaint(
            photo_list.absolute(row),
            row.name,
            skin_overlay.measured(scene.active_face(context), row.name),
            photo_list.mask(row),
        )

    @staticmethod
    def work(solver, request, progress):
        return skin_pictures.canvas(request)

    def deliver(self, context, request, outcome):
        if photo_stage.is_open():  # since the photo began to be read
            raise ReconstructionError(messages.STAGE_OPEN)
        with scene.all_or_nothing(context):
            mask_editor.open_editor(context, outcome)


class MaskOperator:
    """An operator of the open editor."""

    @classmethod
    def poll(cls, context):
        obj = mask_editor.editor()
        if obj is None:
            cls.poll_message_set(messages.NO_MASK_EDITOR)
            return False
        return on_this_stage(cls, context, obj)


class BSFACE_OT_mask_brush(MaskOperator, bpy.types.Operator):
    """Paint with this brush"""

    bl_idname = "bsface.mask_brush"
    bl_label = "Mask Brush"
    bl_options = {"INTERNAL"}

    kind: EnumProperty(
        name="Brush",
        items=(
            ("OTHER", "Not Skin", "Paint what is not skin of the face; Ctrl: skin"),
            ("SKIN", "Skin", "Paint what is skin of the face; Ctrl: what is not"),
            ("MEASURED", "As Measured", "Take the paint off: what was measured counts"),
        ),
    )

    @classmethod
    def description(cls, context, properties):
        items = cls.bl_rna.properties["kind"].enum_items
        return items[properties.kind].description

    def execute(self, context):
        mask_editor.choose(context, self.kind)
        return {"FINISHED"}


class BSFACE_OT_mask_done(MaskOperator, bpy.types.Operator):
    """Leave the mask and go back to the scene"""

    bl_idname = "bsface.mask_done"
    bl_label = "Done"
    bl_options = {"REGISTER", "UNDO"}

    keep: BoolProperty(name="Keep", description="Off: forget the paint", default=True)

    def execute(self, context):
        obj = mask_editor.editor()
        rows = {row.name: row for row in context.scene.bsface.photos}
        row = rows.get(obj[mask_editor.PHOTO])
        if self.keep and row is not None:
            photo_list.keep_mask(row, mask_editor.painted(obj))
            self.report({"INFO"}, messages.MASKED.format(name=row.name))
        mask_editor.close_editor(context, obj)
        skin_overlay.refresh(context, scene.active_face(context))
        return {"FINISHED"}


class PaintedOperator:
    """An operator on painted masks."""

    which: EnumProperty(
        name="Which",
        items=(
            ("ACTIVE", "Active Photo", "That of the active photo"),
            ("ALL", "All Photos", "Those of all photos"),
        ),
        default="ALL",
    )

    @classmethod
    def poll(cls, context):
        if not ready(cls, context):
            return False
        if not photo_list.known_masks(context.scene.bsface):
            cls.poll_message_set(messages.NO_MASKS)
            return False
        return True

    def rows(self, context):
        """The rows that are meant and have a painted mask."""
        state = context.scene.bsface
        rows = list(state.photos)
        if self.which == "ACTIVE":
            rows = rows[state.active_photo : state.active_photo + 1]
        return [row for row in rows if row.mask is not None]


class BSFACE_OT_mask_save(PaintedOperator, bpy.types.Operator):
    """Write painted masks beside their photos, where the command line finds them"""

    bl_idname = "bsface.mask_save"
    bl_label = "Save Masks"
    bl_options = {"REGISTER"}

    def invoke(self, context, event):
        if self.others(self.files(context)):
            manager, text = context.window_manager, messages.REPLACE_MASKS
            return manager.invoke_confirm(self, event, message=text)
        return self.execute(context)

    def files(self, context):
        """Path -> content of the files to write."""
        return {
            photo_list.original(row).with_suffix(ENDING): skin_pictures.turned(
                photo_list.mask(row), -row.quarters
            )
            for row in self.rows(context)
        }

    @staticmethod
    def others(files):
        """How many of the files are there with another content."""
        found = [path for path in files if path.is_file()]
        return sum(path.read_bytes() != files[path] for path in found)

    @refusals_reported
    def execute(self, context):
        files = self.files(context)
        replaced = self.others(files)
        for path, content in files.items():
            write_bytes(path, content)
        self.report({"INFO"}, messages.masks_saved(len(files), replaced))
        return {"FINISHED"}


class BSFACE_OT_mask_clear(PaintedOperator, bpy.types.Operator):
    """Forget painted masks; mask files beside the photos stay, and count again"""

    bl_idname = "bsface.mask_clear"
    bl_label = "Reset Masks"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        for row in self.rows(context):
            photo_list.keep_mask(row, b"")
        skin_overlay.refresh(context, scene.active_face(context))
        return {"FINISHED"}


CLASSES = (
    BSFACE_OT_skin_show,
    BSFACE_OT_mask_edit,
    BSFACE_OT_mask_brush,
    BSFACE_OT_mask_done,
    BSFACE_OT_mask_save,
    BSFACE_OT_mask_clear,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
