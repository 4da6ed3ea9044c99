"""The surface after the first run: refit, resample, symmetrise, maps, removal."""

from __future__ import annotations

import math

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty

from ...core._types import Mask
from ...core.errors import ReconstructionError
from ...core.problem import Constraint
from ...core.settings import NET_LIMITS
from ...core.surface.bspline import resampled_net
from .. import (
    face_file,
    face_photos,
    maps,
    material,
    messages,
    photo_expression,
    photo_list,
    removal,
    request,
    scene,
    selection,
    shape_keys,
    showing,
    surface_object,
)
from ..apply_result import apply_result
from .refusals import refusals_reported
from .running import LongOperator, free_to_change


class FaceOperator:
    """An operator on the face that the buttons mean."""

    # Off: it leaves the face as it is.
    edits = True

    @classmethod
    def poll(cls, context):
        face = scene.active_face(context)
        if face is None:
            cls.poll_message_set(messages.NO_FACE_OBJECT)
            return False
        if cls.edits and not scene.is_own(face):
            cls.poll_message_set(messages.LINKED.format(name=face.name))
            return False
        return True


class ChangingOperator(FaceOperator):
    """One that a running job, or the coarse net, would undo."""

    @classmethod
    def poll(cls, context):
        return free_to_change(cls) and super().poll(context)


def check_net(face: bpy.types.Object) -> None:
    """Refuse a net that no run can have."""
    across, down = surface_object.shape(face)
    least, most = NET_LIMITS
    if not least <= min(across, down) <= max(across, down) <= most:
        raise ReconstructionError(
            messages.NET_SIZE.format(
                name=face.name, across=across, down=down, least=least, most=most
            )
        )


def _constraint(held: Mask, softness: float) -> Constraint:
    try:
        return Constraint(held, softness)
    except ValueError as error:
        raise ReconstructionError(str(error)) from None


class BSFACE_OT_surface_refit(ChangingOperator, LongOperator, bpy.types.Operator):
    """Fit again, starting from the control points as you edited them"""

    bl_idname = "bsface.surface_refit"
    bl_label = "Refit"
    bl_options = {"UNDO"}

    hold: EnumProperty(
        name="Hold",
        description="Which control points stay where you put them",
        items=(
            ("MOVED", "Moved Points", "Those that were moved since the last run"),
            ("SELECTED", "Selected Points", "Those that are selected in edit mode"),
            ("NONE", "None", "All may move again"),
        ),
    )
    softness: FloatProperty(
        name="Softness",
        description="How far held points may give way, in millimetres; 0 = not at all",
        default=0.3,
        min=0.0,
        max=20.0,
    )

    def prepare(self, context):
        face = scene.active_face(context)
        state = context.scene.bsface
        listed = photo_list.paths(state)
        own = bool(listed) and face_photos.owner(context, face, listed) == face
        check_net(face)
        held = None
        if self.hold == "MOVED":
            face_file.check_place(face)
            held = face_file.moved(face)
        elif self.hold == "SELECTED":
            held = surface_object.selected(face)
            if not held.any():
                text = messages.NOTHING_SELECTED.format(name=face.name)
                raise ReconstructionError(text)
        constraint = None if held is None else _constraint(held, self.softness)
        return request.from_panel(
            state,
            None if own else face_photos.files(face),
            face.name,
            {"control_points": surface_object.shape(face)},
            start=face_file.surface(face),
            constraint=constraint,
        )

    def deliver(self, context, request, outcome):
        face = self.kept(context)
        apply_result(context, request, outcome, face=face, select=self.undisturbed)
        self.report({"INFO"}, messages.done(face, outcome.result.reports))


class BSFACE_OT_surface_resample(ChangingOperator, bpy.types.Operator):
    """Change the numbers of control points; the shape stays as near as it can"""

    bl_idname = "bsface.surface_resample"
    bl_label = "Resample"
    bl_options = {"REGISTER", "UNDO"}

    control_points_u: IntProperty(
        name="Control Points Across", default=40, min=4, max=200
    )
    control_points_v: IntProperty(
        name="Control Points Down", default=40, min=4, max=200
    )

    def invoke(self, context, event):
        face = scene.active_face(context)
        self.control_points_u, self.control_points_v = surface_object.shape(face)
        return context.window_manager.invoke_props_dialog(self)

    def execute(self, context):
        face = scene.active_face(context)
        count = (self.control_points_u, self.control_points_v)
        with selection.object_mode(context):
            return self.resample(context, face, count)

    def resample(self, context, face, count):
        photo_expression.hide(face)
        keys = face.data.shape_keys
        names = [None] if keys is None else keys.key_blocks.keys()
        nets = [surface_object.read(face, name) for name in names]
        if not np.isfinite(nets).all():
            self.report({"ERROR"}, messages.NO_NUMBERS.format(name=face.name))
            return {"CANCELLED"}
        points = resampled_net(surface_object.read(face), count)
        with scene.all_or_nothing(context):
            shape_keys.write(context, face, points)
        return {"FINISHED"}


class BSFACE_OT_surface_symmetrise(ChangingOperator, bpy.types.Operator):
    """Make the two halves of the face mirror images of each other"""

    bl_idname = "bsface.surface_symmetrise"
    bl_label = "Symmetrise"
    bl_options = {"REGISTER", "UNDO"}

    side: EnumProperty(
        name="From",
        items=(
            ("BOTH", "Both Halves", "The mean of the two halves"),
            ("LEFT", "Left of Picture", "The half at the left of the picture (x < 0)"),
            ("RIGHT", "Right of Picture", "The half at the right of the picture"),
        ),
    )
    amount: FloatProperty(
        name="Amount", default=1.0, min=0.0, max=1.0, subtype="FACTOR"
    )

    @refusals_reported
    def execute(self, context):
        from ...core.surface.symmetry import symmetrised

        face = scene.active_face(context)
        if not math.isfinite(self.amount):
            raise ReconstructionError(messages.NO_AMOUNT)
        face_file.check_place(face)
        surface = face_file.surface(face)
        points = symmetrised(surface, self.side.lower(), self.amount).control_points
        with scene.all_or_nothing(context), selection.object_mode(context):
            surface_object.write(context, face, points)
        return {"FINISHED"}


class BSFACE_OT_surface_map(FaceOperator, bpy.types.Operator):
    """Choose what is painted on the surface"""

    bl_idname = "bsface.surface_map"
    bl_label = "Show on Surface"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(
        name="Map",
        items=(
            ("PLAIN", "Plain", "One colour, to judge the shape"),
            (
                "SKIN",
                "Skin",
                "The skin's own colour, the light of the photos taken out",
            ),
            ("PHOTO", "Photo Texture", "The mean of the photos, their light included"),
            ("NORMALS", "Normals", "Direction of the surface as a colour"),
            ("RESIDUAL", "Residual", "Where the photos contradict the surface"),
            ("DEVIATION", "Deviation", "How well the photos fix the surface, in mm"),
        ),
    )

    @refusals_reported
    def execute(self, context):
        face = scene.active_face(context)
        if self.kind == "NORMALS":
            # Of the surface as it is now; those of the run are there already.
            known = material.stored_map(face, "NORMALS") is not None
            if face_file.moved(face).any() or not known:
                surface = face_file.surface(face)
                made = maps.normals(surface, face_file.outline(face))
                material.store_map(face, "NORMALS", made)
        try:
            material.show(face, self.kind)
        except KeyError:
            label = material.MAPS[self.kind][0].lower()
            self.report({"ERROR"}, messages.NO_MAP.format(name=face.name, map=label))
            return {"CANCELLED"}
        showing.light_views(context, self.kind)
        return {"FINISHED"}


class BSFACE_OT_surface_trim(FaceOperator, bpy.types.Operator):
    """Show the face inside its outline only, or the whole patch with its rim"""

    bl_idname = "bsface.surface_trim"
    bl_label = "Trim the View"
    bl_options = {"REGISTER", "UNDO"}

    trim: BoolProperty(name="Trim", default=True)

    def execute(self, context):
        material.trim(scene.active_face(context), self.trim)
        return {"FINISHED"}


class BSFACE_OT_face_remove(ChangingOperator, bpy.types.Operator):
    """Delete the face with its cameras, lights and photos; the files stay"""

    bl_idname = "bsface.face_remove"
    bl_label = "Remove Face"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        selection.leave_edit_mode(context)
        removal.remove_face(context, scene.active_face(context))
        return {"FINISHED"}


class BSFACE_OT_leftovers_remove(bpy.types.Operator):
    """Delete cameras, suns and pictures of faces that were deleted"""

    bl_idname = "bsface.leftovers_remove"
    bl_label = "Remove Leftovers"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        if not removal.leftovers(context):
            cls.poll_message_set(messages.NO_LEFTOVERS)
            return False
        return True

    def execute(self, context):
        selection.leave_edit_mode(context)
        count = removal.remove_leftovers(context)
        self.report({"INFO"}, messages.REMOVED.format(count=count))
        return {"FINISHED"}


CLASSES = (
    BSFACE_OT_surface_refit,
    BSFACE_OT_surface_resample,
    BSFACE_OT_surface_symmetrise,
    BSFACE_OT_surface_map,
    BSFACE_OT_surface_trim,
    BSFACE_OT_face_remove,
    BSFACE_OT_leftovers_remove,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
