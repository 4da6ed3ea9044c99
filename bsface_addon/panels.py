"""The tab "BSface" from Reconstruct on, in the order of the work.

Photos and landmarks come before, see `photo_panels`.
"""

from __future__ import annotations

import bpy

from . import (
    cameras,
    lights,
    material,
    messages,
    scene,
    session,
    settings_group,
    surface_object,
)
from .panel_base import BSFacePanel, FacePanel, paragraph


class BSFACE_PT_reconstruct(BSFacePanel, bpy.types.Panel):
    bl_label = "Reconstruct"

    def draw_header_preset(self, context):
        self.layout.operator(
            "bsface.reset", text="", icon="LOOP_BACK", emboss=False
        ).group = "SETTINGS"

    def draw(self, context):
        layout = self.layout
        running = session.running()
        if running is not None:
            text = messages.progress_line(running)
            layout.progress(factor=running.fraction, type="BAR", text=text)
            layout.label(text="Esc over the 3D view stops it")
            return
        face = scene.active_face(context)
        photos = bool(context.scene.bsface.photos)
        column = layout.column()
        # One button at a time is the big one: before this it is Add Photos.
        column.scale_y = 2.0 if photos and not face else 1.0
        column.enabled = photos
        column.operator(
            "bsface.reconstruct", text="Reconstruct Again" if face else "Reconstruct"
        )
        if not photos:
            layout.label(text=messages.NO_PHOTOS, icon="INFO")
        around = scene.surrounding(context, face) if face else []
        if around:
            names = ", ".join(obj.name for obj in around)
            box = layout.box()
            text = messages.SURROUNDED.format(name=names)
            paragraph(context, box, text, icon="INFO")
            text = messages.HIDE.format(name=names)
            box.operator("bsface.surroundings_hide", text=text, translate=False)


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
        layout.enabled = session.running() is None
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
        layout.enabled = session.running() is None
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
        soft = context.scene.bsface.softness
        refit = column.operator("bsface.surface_refit", icon="FILE_REFRESH")
        refit.softness = soft
        row = column.row(align=True)
        for hold, text in (("SELECTED", "Hold Selected"), ("NONE", "Hold None")):
            refit = row.operator("bsface.surface_refit", text=text)
            refit.hold, refit.softness = hold, soft
        column.prop(context.scene.bsface, "softness")
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


CLASSES = (
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
