"""Landmarks: find them all, show and move those of a photo, files, several faces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import bpy
from bpy.props import EnumProperty, StringProperty

from ...core.errors import PhotoFailure, ReconstructionError
from ...core.images.read import read_photo
from ...core.landmarks.landmarks import Landmarks
from .. import (
    landmark_editor,
    mask_editor,
    messages,
    photo_list,
    photo_stage,
    request,
)
from ..properties import RELATIVE
from ..solving import next_face
from .masks import on_this_stage
from .photos import RowOperator, ready
from .running import LongOperator


class BSFACE_OT_landmarks_detect(LongOperator, bpy.types.Operator):
    """Find the face and its landmarks in every ticked photo"""

    bl_idname = "bsface.landmarks_detect"
    bl_label = "Detect All"
    bl_options = {"UNDO"}

    @staticmethod
    def work(solver, request, progress):
        return solver.detect(request, progress)

    @classmethod
    def poll(cls, context):
        return ready(cls, context)

    def prepare(self, context):
        state = context.scene.bsface
        known = photo_list.known_landmarks(state)
        # What a person did stays; the rest is looked for anew.
        given = {n: item for n, item in known.items() if item.source != "detected"}
        return request.from_panel(state, landmarks=given)

    def deliver(self, context, request, outcome):
        state = context.scene.bsface
        landmarks = outcome.collection.landmarks
        photo_list.take_landmarks(state, landmarks, outcome.texts)
        photo_list.take_failures(state, outcome.collection.failures)
        photo_list.take_found(state, landmarks)
        state.hints = "\n".join(outcome.hints)
        found, total = len(landmarks), len(state.photos)
        self.report(
            {"INFO"},
            messages.FOUND.format(found=found, photos=messages.plural(total, "photo")),
        )


def with_landmarks(cls, context):
    """Poll of what needs landmarks: those of some photo are there."""
    if not ready(cls, context):
        return False
    if not any(row.landmarks for row in context.scene.bsface.photos):
        cls.poll_message_set(messages.NOTHING_DETECTED)
        return False
    return True


@dataclass(frozen=True)
class PhotoToEdit:
    """A photo whose landmarks are to be moved."""

    path: Path
    name: str
    landmarks: Landmarks


class BSFACE_OT_landmarks_edit(RowOperator, LongOperator, bpy.types.Operator):
    """Show the landmarks over the photo; move wrong ones with G, then press Done"""

    bl_idname = "bsface.landmarks_edit"
    bl_label = "Edit Landmarks"
    bl_options = {"UNDO"}
    opens_editor = True

    @classmethod
    def poll(cls, context):
        if mask_editor.editor() is not None:
            cls.poll_message_set(messages.STAGE_OPEN)
            return False
        if not on_this_stage(cls, context, landmark_editor.editor()):
            return False
        return with_landmarks(cls, context)

    def prepare(self, context):
        row = self.wanted(context)
        found = photo_list.landmarks(row)
        if found is None:
            raise ReconstructionError(messages.NO_LANDMARKS.format(name=row.name))
        return PhotoToEdit(photo_list.absolute(row), row.name, found)

    @staticmethod
    def work(solver, request, progress):
        photo = read_photo(request.path, request.name)
        if isinstance(photo, PhotoFailure):
            raise ReconstructionError(photo.reason)
        return photo

    def deliver(self, context, request, outcome):
        if landmark_editor.editor() is not None:
            bpy.ops.bsface.landmarks_done()
        landmark_editor.open_editor(context, outcome, request.landmarks)


class BSFACE_OT_landmarks_done(bpy.types.Operator):
    """Keep the landmarks as they are now and go back to the scene"""

    bl_idname = "bsface.landmarks_done"
    bl_label = "Done"
    bl_options = {"REGISTER", "UNDO"}

    keep: bpy.props.BoolProperty(
        name="Keep", description="Off: forget the changes", default=True
    )

    @classmethod
    def poll(cls, context):
        obj = landmark_editor.editor()
        if obj is None:
            cls.poll_message_set(messages.NO_EDITOR)
            return False
        return on_this_stage(cls, context, obj)

    def execute(self, context):
        obj = landmark_editor.editor()
        state = context.scene.bsface
        rows = {row.name: row for row in state.photos}
        row = rows.get(obj[landmark_editor.PHOTO])
        if self.keep and row is not None:
            try:
                points, weight, moved = landmark_editor.edited(obj)
            except ValueError as error:
                self.report({"ERROR"}, messages.BAD_EDIT.format(why=error))
                return {"CANCELLED"}
            if moved.any():
                found = photo_list.landmarks(row)
                found = replace(found, points=points, weight=weight, source="hand")
                photo_list.keep_landmarks(row, found)
                row.status, row.reason = "found", ""
            self.report({"INFO"}, messages.MOVED.format(count=int(moved.sum())))
        photo_stage.close_stage(context, obj)
        return {"FINISHED"}


@dataclass(frozen=True)
class PhotoToLookAt:
    """One photo in which all faces are wanted."""

    path: Path
    name: str
    scheme: str


class BSFACE_OT_face_next(RowOperator, LongOperator, bpy.types.Operator):
    """Take the next face of this photo, where it shows several people"""

    bl_idname = "bsface.face_next"
    bl_label = "Next Face"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context):
        stays = on_this_stage(cls, context, landmark_editor.editor())
        return stays and super().poll(context)

    def prepare(self, context):
        row = self.wanted(context)
        editor = landmark_editor.editor()
        if editor is not None:  # edits of this photo are of the face that goes
            same = editor[landmark_editor.PHOTO] == row.name
            bpy.ops.bsface.landmarks_done(keep=not same)
        scheme = context.scene.bsface.settings.landmarks
        return PhotoToLookAt(photo_list.absolute(row), row.name, scheme)

    @staticmethod
    def work(solver, request, progress):
        return solver.faces_in(request.path, request.name, request.scheme)

    def deliver(self, context, request, outcome):
        row = photo_list.find(context.scene.bsface, request.name)
        found = next_face(outcome, photo_list.landmarks(row))
        # Chosen by a person: detection must not undo it.
        photo_list.keep_landmarks(row, replace(found, source="hand"))
        row.status, row.reason = "found", ""
        self.report({"INFO"}, messages.FACES.format(count=found.faces))


class LandmarkFile(RowOperator):
    filepath: StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE", *RELATIVE})
    filter_glob: StringProperty(default="*.pts;*.json", options={"HIDDEN"})


class BSFACE_OT_landmarks_import(LandmarkFile, bpy.types.Operator):
    """Read this photo's landmarks from a .pts (68 points) or .json file"""

    bl_idname = "bsface.landmarks_import"
    bl_label = "Import Landmarks"
    bl_options = {"REGISTER", "UNDO"}

    def invoke(self, context, event):
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        from ...core.landmarks.landmarks import LandmarkFileError, read_landmarks

        row = self.row(context)
        if row is None:
            return {"CANCELLED"}
        path = bpy.path.abspath(self.filepath)
        if not path or Path(path).is_dir():
            self.report({"ERROR"}, messages.NO_LANDMARK_FILE)
            return {"CANCELLED"}
        try:
            photo_list.keep_landmarks(row, read_landmarks(path, row.name))
        except LandmarkFileError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        row.status, row.reason = "found", ""
        return {"FINISHED"}


class BSFACE_OT_landmarks_export(LandmarkFile, bpy.types.Operator):
    """Write this photo's landmarks to a .json file, or to .pts where they are 68"""

    bl_idname = "bsface.landmarks_export"
    bl_label = "Export Landmarks"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context):
        return with_landmarks(cls, context)

    def invoke(self, context, event):
        row = self.row(context)
        if row is not None:
            self.filepath = str(photo_list.absolute(row).with_suffix(".json"))
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        row = self.row(context)
        found = None if row is None else photo_list.landmarks(row)
        if found is None:
            if row is not None:
                self.report({"ERROR"}, messages.NO_LANDMARKS.format(name=row.name))
            return {"CANCELLED"}
        path = Path(bpy.path.abspath(self.filepath))
        if not self.filepath or path.is_dir():
            self.report({"ERROR"}, messages.NO_FILE_NAME.format(path=str(path)))
            return {"CANCELLED"}
        try:
            landmark_editor.write(path, found)
        except (ReconstructionError, ValueError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class BSFACE_OT_landmarks_clear(bpy.types.Operator):
    """Forget landmarks, so that they are looked for again"""

    bl_idname = "bsface.landmarks_clear"
    bl_label = "Reset Landmarks"
    bl_options = {"REGISTER", "UNDO"}

    which: EnumProperty(
        name="Which",
        items=(
            ("ACTIVE", "Active Photo", "Those of the active photo"),
            ("ALL", "All Photos", "Those of all photos"),
        ),
    )

    @classmethod
    def poll(cls, context):
        return ready(cls, context)

    def execute(self, context):
        state = context.scene.bsface
        rows = list(state.photos)
        if self.which == "ACTIVE":
            rows = rows[state.active_photo : state.active_photo + 1]
        for row in rows:
            photo_list.forget(row)
        return {"FINISHED"}


CLASSES = (
    BSFACE_OT_landmarks_detect,
    BSFACE_OT_landmarks_edit,
    BSFACE_OT_landmarks_done,
    BSFACE_OT_face_next,
    BSFACE_OT_landmarks_import,
    BSFACE_OT_landmarks_export,
    BSFACE_OT_landmarks_clear,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
