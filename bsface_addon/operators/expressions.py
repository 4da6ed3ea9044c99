"""Expressions as shape keys: the basis is the neutral face."""

from __future__ import annotations

import bpy
from bpy.props import EnumProperty, StringProperty

from ...core.errors import ReconstructionError
from .. import (
    face_file,
    face_photos,
    made_keys,
    messages,
    photo_expression,
    photo_list,
    request,
    scene,
    selection,
    surface_object,
)
from .photos import ready
from .running import LongOperator
from .surface import ChangingOperator, check_net

# Blender cuts longer names of shape keys, within a letter too.
NAME_BYTES = 63


class BSFACE_OT_expression_assign(bpy.types.Operator):
    """Say which expression photos show; photos without a word make the neutral face"""

    bl_idname = "bsface.expression_assign"
    bl_label = "Set Expression"
    bl_options = {"REGISTER", "UNDO"}

    expression: StringProperty(
        name="Expression", description="Such as Smile; empty: neutral"
    )
    which: EnumProperty(
        name="Photos",
        items=(
            ("ACTIVE", "Active Photo", "The active row"),
            ("USED", "Ticked Photos", "All rows whose box is ticked"),
            ("NAMED", "Named", "The photos of the names"),
        ),
    )
    photos: StringProperty(
        name="Names", description="Names separated by |, for the choice Named"
    )

    @classmethod
    def poll(cls, context):
        return ready(cls, context)

    def invoke(self, context, event):
        return context.window_manager.invoke_props_dialog(self)

    def execute(self, context):
        state = context.scene.bsface
        rows = list(state.photos)
        if self.which == "ACTIVE":
            rows = rows[state.active_photo : state.active_photo + 1]
        elif self.which == "USED":
            rows = [row for row in rows if row.use]
        else:
            wanted = set(self.photos.split("|"))
            missing = wanted - {row.name for row in rows}
            if missing:
                text = messages.NO_SUCH_PHOTO.format(name=sorted(missing)[0])
                self.report({"ERROR"}, text)
                return {"CANCELLED"}
            rows = [row for row in rows if row.name in wanted]
        for row in rows:
            row.expression = self.expression.strip()
        return {"FINISHED"}


class BSFACE_OT_expression_key(ChangingOperator, LongOperator, bpy.types.Operator):
    """Fit the face to the photos of one expression and keep it as a shape key"""

    bl_idname = "bsface.expression_key"
    bl_label = "Make Shape Key"
    bl_options = {"UNDO"}

    expression: StringProperty(
        name="Expression", description="Photos with this word; also the key's name"
    )

    def prepare(self, context):
        state = context.scene.bsface
        rows = [r for r in state.photos if r.expression == self.expression and r.use]
        if not self.expression or not rows:
            raise ReconstructionError(
                messages.NO_EXPRESSION.format(name=self.expression)
            )
        if len(self.expression.encode()) > NAME_BYTES:
            raise ReconstructionError(messages.LONG_WORD.format(name=self.expression))
        face = scene.active_face(context)
        made_keys.check_word(face, self.expression)
        check_net(face)
        face_file.check_place(face)
        owner = face_photos.owner(context, face, map(photo_list.absolute, rows))
        if owner != face:
            text = messages.OF_ANOTHER.format(owner=owner.name, name=face.name)
            raise ReconstructionError(text)
        known = photo_list.known_landmarks(state)
        return request.from_panel(
            state,
            tuple(photo_list.absolute(row) for row in rows),
            self.expression,
            {
                "control_points": surface_object.shape(face),
                # All photos of the group show the expression: it is the shape itself,
                # and who it is is known.
                "expressions": False,
                "modes": 0.0,
                "expression_modes": 1.0,
            },
            start=face_file.surface(face),
            landmarks={r.name: known[r.name] for r in rows if r.name in known},
            masks={r.name: photo_list.mask(r) for r in rows if r.mask is not None},
        )

    def deliver(self, context, request, outcome):
        face = self.kept(context)
        from ...core.solve.expression import expression_of
        from ...core.surface.template import load_template

        moved = expression_of(outcome.result.surface, request.start, load_template())
        with scene.all_or_nothing(context):
            selection.leave_edit_mode(context)
            photo_expression.hide(face)
            made_keys.check_word(face, self.expression)
            # On the basis as it is now: the net may have been edited meanwhile.
            points = surface_object.read(face) + moved
            made = surface_object.add_shape_key(face, self.expression, points)
            # In place of one that was made and shown before; the user's sliders stay.
            for key in made_keys.of_kind(face, made_keys.EXPRESSION):
                if key.value == 1.0:
                    key.value = 0.0
            made.value = 1.0
            made_keys.remember(face, self.expression, made_keys.EXPRESSION)
        photo_list.take_reports(context.scene.bsface, outcome.result.reports)
        self.report({"INFO"}, messages.KEY.format(name=self.expression))


CLASSES = (BSFACE_OT_expression_assign, BSFACE_OT_expression_key)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
