"""The photo list: add, remove, use or ignore, replace, turn."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    IntProperty,
    StringProperty,
)

from ...core.errors import ReconstructionError
from ...core.images.folder import READABLE_ENDINGS
from .. import messages, photo_list, photo_stage, session, turned
from ..properties import RELATIVE
from .refusals import refusals_reported
from .running import LongOperator

ENDINGS = ";".join(f"*{ending}" for ending in sorted(READABLE_ENDINGS))


def ready(cls, context, needs_photos=True):
    """Shared poll: no job runs and, if asked, there are photos."""
    if session.running() is not None:
        cls.poll_message_set(messages.RUNNING)
        return False
    if needs_photos and not context.scene.bsface.photos:
        cls.poll_message_set(messages.NO_PHOTOS)
        return False
    return True


class RowOperator:
    """An operator on one row of the list: the one of ``photo``, or the active one."""

    photo: StringProperty(
        name="Photo", description="Name of the photo; empty: the active row"
    )

    @classmethod
    def poll(cls, context):
        return ready(cls, context)

    def wanted(self, context):
        """The row.

        Raises
        ------
        ReconstructionError
            There is no such photo.
        """
        state = context.scene.bsface
        if not self.photo:
            if not 0 <= state.active_photo < len(state.photos):
                raise ReconstructionError(messages.NO_ROW)
            return state.photos[state.active_photo]
        return photo_list.find(state, self.photo)

    def row(self, context):
        """The row, or None after reporting that there is no such photo."""
        try:
            return self.wanted(context)
        except ReconstructionError as error:
            self.report({"ERROR"}, str(error))
            return None


class BSFACE_OT_photos_add(bpy.types.Operator):
    """Add photos of one person: choose some, or go into a folder and choose none"""

    bl_idname = "bsface.photos_add"
    bl_label = "Add Photos"
    bl_options = {"REGISTER", "UNDO"}

    directory: StringProperty(
        subtype="DIR_PATH", options={"SKIP_SAVE", "HIDDEN", *RELATIVE}
    )
    files: CollectionProperty(
        type=bpy.types.OperatorFileListElement, options={"SKIP_SAVE", "HIDDEN"}
    )
    filter_glob: StringProperty(default=ENDINGS, options={"HIDDEN"})
    filter_image: BoolProperty(default=True, options={"HIDDEN"})
    filter_folder: BoolProperty(default=True, options={"HIDDEN"})
    # Blender's file browser starts with what an operator has under this name.
    display_type: EnumProperty(
        items=(("THUMBNAIL", "Thumbnails", "", 0, 3),), options={"HIDDEN"}
    )

    def draw(self, context):
        column = self.layout.column()
        for line in messages.CHOOSING:
            column.label(text=line)

    @classmethod
    def poll(cls, context):
        return ready(cls, context, needs_photos=False)

    def invoke(self, context, event):
        if self.directory and any(item.name for item in self.files):
            return self.execute(context)  # dropped into the view
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    @refusals_reported
    def execute(self, context):
        from ...core.images.folder import list_photos

        if not self.directory:
            raise ReconstructionError(messages.NO_FOLDER)
        folder = Path(bpy.path.abspath(self.directory))
        chosen = [folder / item.name for item in self.files if item.name] or [folder]
        paths = [
            path
            for item in chosen
            for path in (list_photos(item) if item.is_dir() else [item])
        ]
        for path in paths:
            if not path.is_file():
                raise ReconstructionError(messages.NO_FILE.format(name=path))
        added = photo_list.add(context.scene.bsface, paths)
        self.report({"INFO"}, messages.added(added, len(paths)))
        return {"FINISHED"}


class BSFACE_OT_photos_remove(RowOperator, bpy.types.Operator):
    """Take this photo off the list; the file stays"""

    bl_idname = "bsface.photos_remove"
    bl_label = "Remove Photo"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        row = self.row(context)
        if row is None:
            return {"CANCELLED"}
        state = context.scene.bsface
        photo_list.remove(state, list(state.photos).index(row))
        return {"FINISHED"}


class BSFACE_OT_photos_clear(bpy.types.Operator):
    """Empty the list; files and faces stay"""

    bl_idname = "bsface.photos_clear"
    bl_label = "Reset Photos"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return ready(cls, context)

    def execute(self, context):
        photo_list.clear(context.scene.bsface)
        return {"FINISHED"}


class BSFACE_OT_photos_use(bpy.types.Operator):
    """Tick or untick several photos at once"""

    bl_idname = "bsface.photos_use"
    bl_label = "Use Photos"
    bl_options = {"REGISTER", "UNDO"}

    which: EnumProperty(
        name="Which",
        items=(
            ("ALL", "All", "Use all photos"),
            ("NONE", "None", "Use no photo"),
            ("INVERT", "Invert", "Use the others"),
            ("GOOD", "Without Faults", "Leave out the photos that were of no use"),
        ),
    )

    @classmethod
    def poll(cls, context):
        return ready(cls, context)

    def execute(self, context):
        for row in context.scene.bsface.photos:
            row.use = {
                "ALL": True,
                "NONE": False,
                "INVERT": not row.use,
                "GOOD": row.status in messages.FINE,
            }[self.which]
        return {"FINISHED"}


class BSFACE_OT_photos_replace(RowOperator, bpy.types.Operator):
    """Put another file in this photo's place"""

    bl_idname = "bsface.photos_replace"
    bl_label = "Replace Photo"
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE", *RELATIVE})
    filter_glob: StringProperty(default=ENDINGS, options={"HIDDEN"})

    def invoke(self, context, event):
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        row = self.row(context)
        path = Path(bpy.path.abspath(self.filepath))
        if row is None:
            return {"CANCELLED"}
        if not path.is_file():
            self.report({"ERROR"}, messages.NO_FILE.format(name=path))
            return {"CANCELLED"}
        photo_list.set_path(context.scene.bsface, row, path)
        return {"FINISHED"}


class BSFACE_OT_photos_turn(RowOperator, LongOperator, bpy.types.Operator):
    """Turn the picture, for a photo that lies on its side; the file stays as it is"""

    bl_idname = "bsface.photos_turn"
    bl_label = "Turn Photo"
    bl_options = {"UNDO"}

    quarters: IntProperty(
        name="Quarter Turns", description="Clockwise", default=1, min=-3, max=3
    )

    @classmethod
    def poll(cls, context):
        if photo_stage.is_open():  # what is done there is of the photo as it stands
            cls.poll_message_set(messages.STAGE_OPEN)
            return False
        return super().poll(context)

    def prepare(self, context):
        row = self.wanted(context)
        known = photo_list.landmarks(row)
        if known is not None and known.source == "detected":
            known = None  # they are looked for again in the turned photo
        return turned.PhotoToTurn(
            row.name,
            photo_list.original(row),
            row.quarters,
            (row.quarters + self.quarters) % 4,
            turned.folder(),
            known,
            photo_list.mask(row),
        )

    @staticmethod
    def work(solver, request, progress):
        return turned.turn(request)

    def deliver(self, context, request, outcome):
        state = context.scene.bsface
        row = photo_list.find(state, request.name)
        if row.quarters == request.quarters:
            return
        photo_list.set_path(state, row, outcome.path)
        if request.quarters:
            row.original, row.quarters = str(request.original), request.quarters
        photo_list.keep_mask(row, outcome.mask)
        if outcome.landmarks is not None:
            photo_list.keep_landmarks(row, outcome.landmarks)
            row.status = "found"


class BSFACE_FH_photos(bpy.types.FileHandler):
    """Images dropped into the 3D view become rows of the list"""

    bl_idname = "BSFACE_FH_photos"
    bl_label = "Add to BSface photos"
    bl_import_operator = "bsface.photos_add"
    bl_file_extensions = ENDINGS.replace("*", "")

    @classmethod
    def poll_drop(cls, context):
        return context.area is not None and context.area.type == "VIEW_3D"


CLASSES = (
    BSFACE_OT_photos_add,
    BSFACE_OT_photos_remove,
    BSFACE_OT_photos_clear,
    BSFACE_OT_photos_use,
    BSFACE_OT_photos_replace,
    BSFACE_OT_photos_turn,
    BSFACE_FH_photos,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
