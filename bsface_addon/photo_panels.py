"""The first panels of the tab "BSface": the photos and their landmarks."""

from __future__ import annotations

import bpy

from . import landmark_editor, mask_editor, messages, photo_list, thumbnails
from .panel_base import BSFacePanel, measured, paragraph, shortened, width

# Of a row of the list beside the words: box, thumbnail, tick, buttons; in points.
ROW_TAKEN = 194
# Of a row: the least for the name, between two words, and for the icon of a mask.
LEAST_NAME, GAP, MASK_ICON = 36, 8, 20


class BSFACE_UL_photos(bpy.types.UIList):
    """One photo a row: box, thumbnail, name, what became of it."""

    def draw_item(
        self, context, layout, data, item, icon, active_data, active_property, index
    ):
        _, sign, _ = messages.photo_status(item.status)
        row = layout.row(align=True)
        row.prop(item, "use", text="")
        name = row.row(align=True)
        name.active = item.use
        picture = thumbnails.icon(photo_list.absolute(item))
        word, said, taken = words_with_room(context, item)
        text = shortened(context, item.name, taken)
        name.label(text=text, icon_value=picture, translate=False)
        state = row.row()
        state.alignment = "RIGHT"
        if item.mask is not None:
            state.label(text="", icon="MOD_MASK")
        if said:
            state.label(text=said, translate=False)
        state.alert = item.use and sign == "ERROR"
        state.label(text=word, icon=sign)


def words_with_room(context: bpy.types.Context, item) -> tuple[str, str, float]:
    """What a row of the list says besides the name.

    Returns
    -------
    word, said : str
        Of the photo's fault and of its expression; empty where the sidebar has no room
        for it beside the name.  The fault's icon and, for the chosen row, the sentence
        below the list stay.
    taken : float
        Width of all besides the name, in points.
    """
    taken = ROW_TAKEN + (0 if item.mask is None else MASK_ICON)
    kept = []
    for text in (messages.photo_status(item.status)[0], item.expression):
        wide = measured(text) + GAP if text else 0
        fits = width(context) - taken - wide >= LEAST_NAME
        kept.append(text if fits else "")
        taken += wide if fits else 0
    return kept[0], kept[1], taken


class BSFACE_MT_photos(bpy.types.Menu):
    bl_label = "Photo Options"

    def draw(self, context):
        layout = self.layout
        layout.operator("bsface.photos_replace", icon="FILE_REFRESH")
        turn = layout.operator(
            "bsface.photos_turn", text="Turn Clockwise", icon="LOOP_FORWARDS"
        )
        turn.quarters = 1
        turn = layout.operator(
            "bsface.photos_turn", text="Turn Counterclockwise", icon="LOOP_BACK"
        )
        turn.quarters = -1
        layout.operator("bsface.expression_assign", icon="SHAPEKEY_DATA")
        layout.separator()
        for which, text in (
            ("ALL", "Use All"),
            ("NONE", "Use None"),
            ("INVERT", "Invert"),
            ("GOOD", "Leave Out Photos with Faults"),
        ):
            layout.operator("bsface.photos_use", text=text).which = which
        layout.separator()
        layout.operator("bsface.mask_save", icon="EXPORT")
        layout.operator("bsface.mask_clear")
        layout.separator()
        layout.operator("bsface.photos_clear", icon="LOOP_BACK")


class BSFACE_PT_editing(bpy.types.Panel):
    bl_label = "Edit Landmarks"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "BSface"

    @classmethod
    def poll(cls, context):
        return landmark_editor.editor() is not None

    def draw(self, context):
        layout = self.layout
        paragraph(context, layout, messages.EDITING)
        row = layout.row(align=True)
        row.scale_y = 1.5
        row.operator("bsface.landmarks_done", icon="CHECKMARK").keep = True
        stop = row.operator("bsface.landmarks_done", text="Cancel", icon="X")
        stop.keep = False


class BSFACE_PT_painting(bpy.types.Panel):
    bl_label = "Paint Mask"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "BSface"

    @classmethod
    def poll(cls, context):
        return mask_editor.editor() is not None

    def draw(self, context):
        layout = self.layout
        paragraph(context, layout, messages.PAINTING)
        now = mask_editor.chosen(context)
        column = layout.column(align=True)
        for kind, (name, _, _) in mask_editor.BRUSHES.items():
            column.operator(
                "bsface.mask_brush", text=name, depress=kind == now
            ).kind = kind
        layout.prop(mask_editor.unified(context), "size", slider=True)
        row = layout.row(align=True)
        row.scale_y = 1.5
        row.operator("bsface.mask_done", icon="CHECKMARK").keep = True
        stop = row.operator("bsface.mask_done", text="Cancel", icon="X")
        stop.keep = False


class BSFACE_PT_photos(BSFacePanel, bpy.types.Panel):
    bl_label = "Photos"

    def draw(self, context):
        state = context.scene.bsface
        layout = self.layout
        if not state.photos:
            column = layout.column()
            column.scale_y = 2.0
            column.operator("bsface.photos_add", icon="FILE_FOLDER")
            for line in messages.CAPTURE:
                paragraph(context, layout, line)
            return
        numbers = photo_list.counts(state)
        paragraph(context, layout, messages.counts(numbers))
        row = layout.row()
        row.template_list(
            "BSFACE_UL_photos", "", state, "photos", state, "active_photo", rows=6
        )
        side = row.column(align=True)
        side.operator("bsface.photos_add", icon="ADD", text="")
        side.operator("bsface.photos_remove", icon="REMOVE", text="")
        side.separator()
        side.menu("BSFACE_MT_photos", icon="DOWNARROW_HLT", text="")
        if 0 <= state.active_photo < len(state.photos):
            _about(context, layout, state.photos[state.active_photo])
        row = layout.row(align=True)
        row.operator(
            "bsface.skin_show", icon="MOD_MASK", depress=state.show_skin
        ).show = not state.show_skin
        row.operator("bsface.mask_edit", icon="BRUSH_DATA")
        for hint in state.hints.splitlines():
            paragraph(context, layout, hint, icon="INFO")


def _about(context, layout, row):
    """Why the active photo is what it is, and what to do about it."""
    word, sign, advice = messages.photo_status(row.status)
    if row.status in messages.FINE:
        if row.reason:
            paragraph(context, layout, row.reason, icon="INFO")
        return
    box = layout.box()
    paragraph(context, box, row.reason or f"{row.name}: {word}.", icon=sign)
    if advice:
        paragraph(context, box, advice)


class BSFACE_PT_landmarks(BSFacePanel, bpy.types.Panel):
    bl_label = "Landmarks"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return super().poll(context) and bool(context.scene.bsface.photos)

    def draw(self, context):
        layout = self.layout
        layout.operator("bsface.landmarks_detect", icon="VIEWZOOM")
        state = context.scene.bsface
        if not 0 <= state.active_photo < len(state.photos):
            return
        row = state.photos[state.active_photo]
        known = bool(row.landmarks)
        if not known:
            waiting = row.status in messages.FINE
            text = messages.NO_LANDMARKS if waiting else messages.NONE_FOUND
            paragraph(context, layout, text.format(name=row.name), icon="INFO")
        column = layout.column()
        column.enabled = known
        column.operator("bsface.landmarks_edit", icon="EDITMODE_HLT")
        if row.faces > 1 or row.status == "other_person":
            layout.operator("bsface.face_next", icon="USER")
        pair = layout.row(align=True)
        pair.operator("bsface.landmarks_import", text="Import", icon="IMPORT")
        outward = pair.row(align=True)
        outward.enabled = known
        outward.operator("bsface.landmarks_export", text="Export", icon="EXPORT")
        layout.operator("bsface.landmarks_clear", icon="LOOP_BACK")


CLASSES = (
    BSFACE_UL_photos,
    BSFACE_MT_photos,
    BSFACE_PT_editing,
    BSFACE_PT_painting,
    BSFACE_PT_photos,
    BSFACE_PT_landmarks,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
