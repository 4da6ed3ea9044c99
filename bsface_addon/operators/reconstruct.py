"""The one big button: photos in, surface out."""

from __future__ import annotations

import math

import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty

from ...core.errors import ReconstructionError
from .. import (
    face_photos,
    messages,
    photo_list,
    request,
    scene,
    showing,
)
from ..apply_result import apply_result
from ..properties import RELATIVE
from . import running


class BSFACE_OT_reconstruct(running.LongOperator, bpy.types.Operator):
    """Make the face as an editable NURBS surface from the photos"""

    bl_idname = "bsface.reconstruct"
    bl_label = "Reconstruct"
    bl_options = {"UNDO"}

    directory: StringProperty(
        name="Folder",
        description="Folder with photos of one person; empty: the photos of the list",
        subtype="DIR_PATH",
        options={"SKIP_SAVE", *RELATIVE},
    )
    name: StringProperty(
        name="Name",
        description="Name of a new face; empty: the name of the folder",
        options={"SKIP_SAVE"},
    )
    control_points_u: IntProperty(
        name="Control Points Across",
        description="Columns of control points; 0: as set in the panel",
        min=0,
        max=120,
        options={"SKIP_SAVE"},
    )
    control_points_v: IntProperty(
        name="Control Points Down",
        description="Rows of control points; 0: as set in the panel",
        min=0,
        max=120,
        options={"SKIP_SAVE"},
    )
    settings: StringProperty(
        name="Settings",
        description="JSON object of settings that differ from the panel's",
        options={"SKIP_SAVE"},
    )
    ignore: StringProperty(
        name="Leave Out",
        description="Names of photos to leave out, separated by |",
        options={"SKIP_SAVE"},
    )
    separate: BoolProperty(
        name="Make Another Face",
        description="Make a new object even where a face can be updated",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context):
        return running.free_to_change(cls)

    def prepare(self, context):
        state = context.scene.bsface
        if not math.isfinite(state.size):
            raise ReconstructionError(messages.BAD_SIZE)
        photos = None
        if self.directory:
            from ...core.images.folder import list_sources

            photos = list_sources(bpy.path.abspath(self.directory))
        changes = request.parsed(self.settings)
        if self.control_points_u or self.control_points_v:
            changes["control_points"] = (
                self.control_points_u or state.settings.control_points_u,
                self.control_points_v or state.settings.control_points_v,
            )
        left_out = tuple(name for name in self.ignore.split("|") if name)
        if photos is None:
            left_out += photo_list.ignored(state)
        return request.from_panel(state, photos, self.name, changes, ignore=left_out)

    def chosen(self, context):
        state = context.scene.bsface
        if self.separate or state.separate:
            return None
        face = scene.active_face(context)
        if face is not None and not self.directory:
            face = face_photos.owner(context, face, photo_list.paths(state))
        if face is not None and not scene.is_own(face):
            raise ReconstructionError(messages.LINKED.format(name=face.name))
        return face

    def deliver(self, context, request, outcome):
        state = context.scene.bsface
        face = self.updated(context)
        fresh = face is None
        face = apply_result(
            context,
            request,
            outcome,
            face=face,
            scale=state.size,
            select=self.undisturbed,
        )
        if fresh and self.undisturbed and not bpy.app.background:
            showing.show(context, face)
        for warning in outcome.result.warnings:
            self.report({"WARNING"}, warning)
        self.report({"INFO"}, messages.done(face, outcome.result.reports))


CLASSES = (BSFACE_OT_reconstruct,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
