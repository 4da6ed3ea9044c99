"""Cameras and light: look through the photos one after the other, switch their suns."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from .. import (
    camera_views,
    cameras,
    face_file,
    lights,
    messages,
    photo_expression,
    photo_list,
    photo_stage,
    scene,
    showing,
    skin_overlay,
)
from .surface import FaceOperator


class ViewOperator(FaceOperator):
    edits = False

    @classmethod
    def poll(cls, context):
        if not super().poll(context):
            return False
        if not cameras.of_face(scene.active_face(context)):
            cls.poll_message_set(messages.NO_CAMERAS)
            return False
        if photo_stage.is_open():  # which brings its own view back
            cls.poll_message_set(messages.STAGE_OPEN)
            return False
        return True


class BSFACE_OT_view_photo(ViewOperator, bpy.types.Operator):
    """Look through the camera of a photo, with the photo behind the surface"""

    bl_idname = "bsface.view_photo"
    bl_label = "View Photo"
    bl_options = {"REGISTER", "UNDO"}

    direction: EnumProperty(
        name="Direction",
        items=(
            ("NEXT", "Next", "The next photo"),
            ("PREVIOUS", "Previous", "The photo before"),
            ("NAMED", "Named", "The photo of the name"),
        ),
    )
    photo: StringProperty(name="Photo", description="For the direction Named")

    def execute(self, context):
        views = cameras.of_face(scene.active_face(context))
        names = [view[cameras.PHOTO_KEY] for view in views]
        if self.direction == "NAMED":
            if self.photo not in names:
                text = messages.NO_CAMERA_OF.format(name=self.photo)
                self.report({"ERROR"}, text)
                return {"CANCELLED"}
            index = names.index(self.photo)
        else:
            step = 1 if self.direction == "NEXT" else -1
            now = context.scene.camera
            start = views.index(now) if now in views else (-1 if step > 0 else 0)
            index = (start + step) % len(views)
        showing.photo(context, scene.active_face(context), views[index])
        photo_list.activate(context.scene.bsface, names[index])
        if face_file.moved_together(scene.active_face(context)):
            name = scene.active_face(context).name
            self.report({"WARNING"}, messages.TOGETHER.format(name=name))
        return {"FINISHED"}


class BSFACE_OT_view_leave(ViewOperator, bpy.types.Operator):
    """Go back to the view, the camera and the frame from before the photos"""

    bl_idname = "bsface.view_leave"
    bl_label = "Leave Camera View"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        camera_views.leave_views(context)
        face = scene.active_face(context)
        photo_expression.hide(face)
        skin_overlay.refresh(context, face)
        return {"FINISHED"}


class BSFACE_OT_view_front(ViewOperator, bpy.types.Operator):
    """Show the photos half transparent in front of the surface, or behind it"""

    bl_idname = "bsface.view_front"
    bl_label = "Photo in Front"
    bl_options = {"REGISTER", "UNDO"}

    front: BoolProperty(name="In Front", default=True)

    def execute(self, context):
        for view in cameras.of_face(scene.active_face(context)):
            opacity = context.scene.bsface.photo_opacity
            cameras.put_photo(view, self.front, opacity)
        return {"FINISHED"}


class BSFACE_OT_view_show(ViewOperator, bpy.types.Operator):
    """Show or hide the cameras of the face in the view"""

    bl_idname = "bsface.view_show"
    bl_label = "Show Cameras"
    bl_options = {"REGISTER", "UNDO"}

    show: BoolProperty(name="Show", default=True)

    def execute(self, context):
        cameras.set_shown(context, scene.active_face(context), self.show)
        return {"FINISHED"}


class BSFACE_OT_surroundings_hide(FaceOperator, bpy.types.Operator):
    """Hide the objects around the face; Alt H shows them again"""

    bl_idname = "bsface.surroundings_hide"
    bl_label = "Hide What Surrounds the Face"
    bl_options = {"REGISTER", "UNDO"}
    edits = False

    def execute(self, context):
        for obj in showing.surrounding(context, scene.active_face(context)):
            obj.hide_set(True)
        return {"FINISHED"}


class BSFACE_OT_light_show(FaceOperator, bpy.types.Operator):
    """Switch on the sun that stands for a photo's light, and the others off"""

    bl_idname = "bsface.light_show"
    bl_label = "Light of Photo"
    bl_options = {"REGISTER", "UNDO"}
    edits = False

    photo: StringProperty(
        name="Photo", description="Name of the photo; empty: that of the scene's camera"
    )
    show: BoolProperty(name="Show", default=True)

    def execute(self, context):
        suns = lights.of_face(scene.active_face(context))
        camera = context.scene.camera
        name = self.photo
        if not name and camera is not None:
            name = camera.get(cameras.PHOTO_KEY, "")
        if self.show and name not in [sun[lights.PHOTO_KEY] for sun in suns]:
            self.report({"ERROR"}, messages.NO_LIGHT)
            return {"CANCELLED"}
        for sun in suns:
            lights.switch(sun, self.show and sun[lights.PHOTO_KEY] == name)
        if self.show and showing.hides_lights(context):
            self.report({"INFO"}, messages.LIGHT_UNSEEN)
        return {"FINISHED"}


CLASSES = (
    BSFACE_OT_view_photo,
    BSFACE_OT_view_leave,
    BSFACE_OT_view_front,
    BSFACE_OT_view_show,
    BSFACE_OT_surroundings_hide,
    BSFACE_OT_light_show,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
