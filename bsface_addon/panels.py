"""The tab "BSface" in the sidebar of the 3D view, in the order of the work."""

from __future__ import annotations

import textwrap

import bpy

from . import (
    cameras,
    job,
    landmark_editor,
    lights,
    material,
    messages,
    photo_list,
    scene,
    settings_group,
    surface_object,
    thumbnails,
)


class BSFACE_UL_photos(bpy.types.UIList):
    """One photo a row: box, thumbnail, name, what became of it."""

    def draw_item(
        self, context, layout, data, item, icon, active_data, active_property, index
    ):
        word, sign, _ = messages.photo_status(item.status)
        row = layout.row(align=True)
        row.prop(item, "use", text="")
        name = row.row(align=True)
        name.active = item.use
        picture = thumbnails.icon(photo_list.absolute(item))
        name.label(text=item.name, icon_value=picture, translate=False)
        state = row.row()
        state.alignment = "RIGHT"
        if item.expression:
            state.label(text=item.expression, translate=False)
        state.alert = item.use and sign == "ERROR"
        state.label(text="" if word == "waiting" else word, icon=sign)


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
        layout.operator("bsface.photos_clear", icon="LOOP_BACK")


class BSFacePanel:
    """Hidden while landmarks are edited: then only their panel shows."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "BSface"

    @classmethod
    def poll(cls, context):
        return landmark_editor.editor() is None


class FacePanel(BSFacePanel):
    """Hidden until there is a face."""

    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return super().poll(context) and scene.active_face(context) is not None


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
        layout.label(text=messages.counts(numbers), translate=False)
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
        for hint in state.hints.splitlines():
            paragraph(context, layout, hint, icon="INFO")


def _about(context, layout, row):
    """Why the active photo is what it is, and what to do about it."""
    word, sign, advice = messages.photo_status(row.status)
    if row.status in photo_list.FINE:
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
        column = layout.column(align=True)
        column.enabled = bool(row.landmarks)
        column.operator("bsface.landmarks_edit", icon="EDITMODE_HLT")
        if row.faces > 1 or row.status == "other_person":
            layout.operator("bsface.face_next", icon="USER")
        pair = layout.row(align=True)
        pair.operator("bsface.landmarks_import", text="Import", icon="IMPORT")
        pair.operator("bsface.landmarks_export", text="Export", icon="EXPORT")
        layout.operator("bsface.landmarks_clear", icon="LOOP_BACK")


class BSFACE_PT_reconstruct(BSFacePanel, bpy.types.Panel):
    bl_label = "Reconstruct"

    def draw_header_preset(self, context):
        self.layout.operator(
            "bsface.reset", text="", icon="LOOP_BACK", emboss=False
        ).group = "SETTINGS"

    def draw(self, context):
        layout = self.layout
        running = job.current()
        if running is not None:
            text = messages.progress_line(running)
            layout.progress(factor=running.fraction, type="BAR", text=text)
            layout.label(text="Esc over the 3D view stops it")
            return
        face = scene.active_face(context)
        column = layout.column()
        column.scale_y = 1.0 if face else 2.0
        column.operator(
            "bsface.reconstruct", text="Reconstruct Again" if face else "Reconstruct"
        )
        if not context.scene.bsface.photos:
            layout.label(text=messages.NO_PHOTOS, icon="INFO")


class BSFACE_PT_settings(BSFacePanel, bpy.types.Panel):
    bl_label = "Settings"
    bl_parent_id = "BSFACE_PT_reconstruct"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header_preset(self, context):
        row = self.layout.row(align=True)
        row.menu("BSFACE_MT_presets", text="", icon="PRESET")
        row.operator("bsface.preset_add", text="", icon="ADD", emboss=False)

    def draw(self, context):
        layout = self.layout
        state = context.scene.bsface
        layout.enabled = job.current() is None
        _settings(layout.column(align=True), state.settings, settings_group.MAIN)
        column = layout.column(align=True)
        column.prop(state, "texture_size", text="")
        column.prop(state, "size")
        column.prop(state, "separate")


class BSFACE_PT_advanced(BSFacePanel, bpy.types.Panel):
    bl_label = "Advanced"
    bl_parent_id = "BSFACE_PT_settings"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        layout.enabled = job.current() is None
        rest = [n for n in settings_group.NAMES if n not in settings_group.MAIN]
        _settings(layout.column(align=True), context.scene.bsface.settings, rest)


def _settings(column, group, names):
    """Properties with the name inside the field: the sidebar is narrow."""
    for name in names:
        if name in settings_group.CHOICES:
            column.label(text=group.bl_rna.properties[name].name)
            column.prop(group, name, text="")
        else:
            column.prop(group, name)


class BSFACE_PT_surface(FacePanel, bpy.types.Panel):
    bl_label = "Surface"
    bl_options = set()

    def draw(self, context):
        layout = self.layout
        face = scene.active_face(context)
        across, down = surface_object.shape(face)
        text = f"{face.name}: {across} x {down} control points"
        layout.label(text=text, icon="OUTLINER_OB_SURFACE", translate=False)
        editing = face.mode == "EDIT"
        layout.operator(
            "bsface.surface_net",
            text="Leave the Control Net" if editing else "Edit the Control Net",
            icon="EDITMODE_HLT",
            depress=editing,
        )
        column = layout.column(align=True)
        column.operator("bsface.surface_refit", icon="FILE_REFRESH")
        row = column.row(align=True)
        for hold, text in (("SELECTED", "Hold Selected"), ("NONE", "Hold None")):
            row.operator("bsface.surface_refit", text=text).hold = hold
        row = layout.row(align=True)
        row.prop(face.data, "resolution_u", text="Resolution")
        row.prop(face.data, "resolution_v", text="")
        column = layout.column(align=True)
        column.operator("bsface.surface_symmetrise", icon="MOD_MIRROR")
        column.operator("bsface.surface_resample", icon="MESH_GRID")
        column.operator("bsface.surface_to_mesh", icon="MESH_DATA")
        layout.operator("bsface.face_remove", icon="TRASH")


class BSFACE_PT_texture(FacePanel, bpy.types.Panel):
    bl_label = "Texture"

    def draw(self, context):
        layout = self.layout
        face = scene.active_face(context)
        shown, stored = material.shown(face), material.stored_kinds(face)
        column = layout.column(align=True)
        labels = {"PLAIN": "Plain"}
        labels.update({kind: name.capitalize() for kind, (name, _) in MAPS})
        for kind, label in labels.items():
            row = column.row(align=True)
            row.enabled = kind in ("PLAIN", "NORMALS") or kind in stored
            row.operator(
                "bsface.surface_map", text=label, depress=kind == shown
            ).kind = kind
        legend = material.legend(face)
        if legend:
            paragraph(context, layout, legend, icon="INFO")
        layout.operator("bsface.texture_save", icon="IMAGE_DATA")


MAPS = tuple(material.MAPS.items())


class BSFACE_PT_views(FacePanel, bpy.types.Panel):
    bl_label = "Cameras and Light"

    def draw(self, context):
        layout = self.layout
        face = scene.active_face(context)
        views, suns = cameras.of_face(face), lights.of_face(face)
        row = layout.row(align=True)
        for direction, sign in (("PREVIOUS", "TRIA_LEFT"), ("NEXT", "TRIA_RIGHT")):
            row.operator(
                "bsface.view_photo", text=f"{direction.capitalize()} Photo", icon=sign
            ).direction = direction
        now = context.scene.camera
        if now in views:
            name = now[cameras.PHOTO_KEY]
            layout.label(text=name, icon="CAMERA_DATA", translate=False)
        layout.operator("bsface.view_leave", icon="VIEW3D")
        row = layout.row(align=True)
        front = row.operator("bsface.view_front", text="Photo in Front")
        front.front = True
        behind = row.operator("bsface.view_front", text="Behind")
        behind.front = False
        hidden = bool(views) and views[0].hide_viewport
        layout.operator(
            "bsface.view_show", text="Show Cameras" if hidden else "Hide Cameras"
        ).show = hidden
        if suns:
            lit = any(not sun.hide_viewport for sun in suns)
            layout.operator(
                "bsface.light_show",
                text="Light of Photo Off" if lit else "Light of Photo On",
                icon="LIGHT_SUN",
            ).show = not lit


class BSFACE_PT_expressions(FacePanel, bpy.types.Panel):
    bl_label = "Expressions"

    def draw(self, context):
        layout = self.layout
        state = context.scene.bsface
        words = sorted({row.expression for row in state.photos if row.expression})
        if 0 <= state.active_photo < len(state.photos):
            row = state.photos[state.active_photo]
            layout.label(text=row.name, icon="IMAGE_DATA", translate=False)
            layout.prop(row, "expression", text="", placeholder="Neutral")
        if not words:
            paragraph(context, layout, messages.EXPRESSIONS)
        for word in words:
            count = sum(row.expression == word for row in state.photos)
            layout.operator(
                "bsface.expression_key",
                text=messages.MAKE_KEY.format(name=word, count=count),
                translate=False,
            ).expression = word
        keys = scene.active_face(context).data.shape_keys
        if keys is not None:
            for block in keys.key_blocks[1:]:
                layout.prop(block, "value", text=block.name, slider=True)


class BSFACE_PT_export(FacePanel, bpy.types.Panel):
    bl_label = "Export"

    def draw(self, context):
        from .operators.export import FORMATS

        grid = self.layout.grid_flow(columns=2, even_columns=True, align=True)
        for kind, label, _ in FORMATS:
            grid.operator("bsface.export", text=label).kind = kind


class BSFACE_PT_support(BSFacePanel, bpy.types.Panel):
    bl_label = "Help"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        error = context.scene.bsface.last_error
        if error:
            box = layout.box()
            paragraph(context, box, error.strip().splitlines()[-1], icon="ERROR")
            box.operator("bsface.reset", text="Clear", icon="X").group = "ERROR"
        layout.operator("bsface.copy_information", icon="COPYDOWN")


def paragraph(context, layout, text, icon="NONE"):
    """Text wrapped to the sidebar's width."""
    scale = context.preferences.system.ui_scale or 1.0  # 0 without a window
    width = context.region.width if context.region else 300
    lines = textwrap.wrap(text, max(20, int((width / scale - 60) / 6.2)))
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(lines):
        sign = icon if number == 0 else ("NONE" if icon == "NONE" else "BLANK1")
        column.label(text=line, icon=sign, translate=False)


CLASSES = (
    BSFACE_UL_photos,
    BSFACE_MT_photos,
    BSFACE_PT_editing,
    BSFACE_PT_photos,
    BSFACE_PT_landmarks,
    BSFACE_PT_reconstruct,
    BSFACE_PT_settings,
    BSFACE_PT_advanced,
    BSFACE_PT_surface,
    BSFACE_PT_texture,
    BSFACE_PT_views,
    BSFACE_PT_expressions,
    BSFACE_PT_export,
    BSFACE_PT_support,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
