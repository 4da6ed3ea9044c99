"""Editing control points: those of the face, or of a coarse net over it."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty

from ...core.errors import ReconstructionError
from .. import (
    coarse_editor,
    coordinates,
    messages,
    photo_expression,
    scene,
    selection,
)
from .refusals import refusals_reported
from .surface import ChangingOperator, FaceOperator

# Reach of proportional editing: about a nose; more than the second is the whole face.
REACH_MM, WHOLE_FACE_MM = 20.0, 120.0


class BSFACE_OT_surface_net(FaceOperator, bpy.types.Operator):
    """Show the control net and edit its points with Blender's own tools, or stop"""

    bl_idname = "bsface.surface_net"
    bl_label = "Control Net"
    bl_options = {"REGISTER", "UNDO"}

    @refusals_reported
    def execute(self, context):
        if coarse_editor.editor() is not None:
            raise ReconstructionError(messages.COARSE_OPEN)
        face = scene.active_face(context)
        editing = face.mode == "EDIT"
        selection.leave_edit_mode(context)
        if not editing:
            _in_sight(context)
            bpy.ops.object.mode_set(mode="EDIT")
            _fit_proportional_size(context, face)
        return {"FINISHED"}


class BSFACE_OT_coarse_edit(ChangingOperator, bpy.types.Operator):
    """Edit the face by a net of few points; detail stays, and goes along"""

    bl_idname = "bsface.coarse_edit"
    bl_label = "Edit a Coarse Net"
    bl_options = {"REGISTER", "UNDO"}

    @refusals_reported
    def execute(self, context):
        before = selection.current(context)
        face = _in_sight(context)
        photo_expression.hide(face)
        try:
            net = coarse_editor.open_editor(context, face)
        except ValueError as error:
            selection.restore(context, before)
            self.report({"ERROR"}, messages.TOO_FEW_POINTS.format(why=error))
            return {"CANCELLED"}
        # Of before the face was selected to be edited.
        selection.keep(net, before)
        _fit_proportional_size(context, face)
        return {"FINISHED"}


class BSFACE_OT_coarse_done(bpy.types.Operator):
    """Leave the coarse net"""

    bl_idname = "bsface.coarse_done"
    bl_label = "Done"
    bl_options = {"REGISTER", "UNDO"}

    keep: BoolProperty(name="Keep", description="Off: forget the edit", default=True)

    @classmethod
    def poll(cls, context):
        if coarse_editor.editor() is None:
            cls.poll_message_set(messages.NO_COARSE)
            return False
        return True

    def execute(self, context):
        coarse_editor.close_editor(context, self.keep)
        return {"FINISHED"}


def _in_sight(context: bpy.types.Context) -> bpy.types.Object:
    """The face that the buttons mean, selected and ready to be edited."""
    face, before = scene.active_face(context), selection.current(context)
    selection.leave_edit_mode(context)
    selection.select_only(context, face)
    context.view_layer.update()
    if not face.visible_get():
        selection.restore(context, before)
        raise ReconstructionError(messages.OUT_OF_SIGHT.format(name=face.name))
    return face


def _fit_proportional_size(context: bpy.types.Context, face: bpy.types.Object) -> None:
    """Proportional editing reaches a feature of the face where it reached all of it."""
    unit = coordinates.world_frame(face).to_scale().x
    tool = context.tool_settings
    if tool.proportional_size > WHOLE_FACE_MM * unit:
        tool.proportional_size = REACH_MM * unit


CLASSES = (BSFACE_OT_surface_net, BSFACE_OT_coarse_edit, BSFACE_OT_coarse_done)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
