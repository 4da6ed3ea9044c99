"""The tab "BSface" from Reconstruct on, in the order of the work.

Photos and landmarks come before, see `photo_panels`.
"""

from __future__ import annotations

import bpy

from . import (
    cameras,
    coarse_editor,
    lights,
    manual,
    material,
    messages,
    removal,
    scene,
    session,
    settings_group,
    showing,
    stored_facts,
    surface_object,
)
from .operators import export
from .panel_base import BSFacePanel, FacePanel, is_narrow, paragraph, shortened


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
            row = layout.row()
            row.label(text=messages.time_left(running), translate=False)
            row.operator("bsface.job_cancel", icon="X")
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
        if removal.leftovers(context):
            box = layout.box()
            paragraph(context, box, messages.LEFTOVERS, icon="INFO")
            box.operator("bsface.leftovers_remove", icon="TRASH")
        around = showing.surrounding(context, face) if face else []
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

    def draw(self, context):
        layout = self.layout
        state = context.scene.bsface
        layout.enabled = session.running() is None
        row = layout.row(align=True)
        row.menu("BSFACE_MT_presets", text="Presets")
        row.operator("bsface.preset_add", text="", icon="ADD")
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
        paragraph(context, layout, text, icon="OUTLINER_OB_SURFACE")
        facts = messages.quality(scene.stored(face, stored_facts.QUALITY, {}))
        if facts:
            paragraph(context, layout, facts)
        editing = face.mode == "EDIT"
        layout.operator(
            "bsface.surface_net",
            text="Leave the Control Net" if editing else "Edit the Control Net",
            icon="EDITMODE_HLT",
            depress=editing,
        )
        if coarse_editor.editor() is None:
            layout.operator("bsface.coarse_edit", icon="MESH_GRID")
        else:
            row = layout.row(align=True)
            row.operator("bsface.coarse_done", icon="CHECKMARK").keep = True
            stop = row.operator("bsface.coarse_done", text="Cancel", icon="X")
            stop.keep = False
            layout.prop(context.scene.bsface, "mirror")
        column = layout.column(align=True)
        soft = context.scene.bsface.softness
        refit = column.operator("bsface.surface_refit", icon="FILE_REFRESH")
        refit.softness = soft
        for hold, text in (
            ("SELECTED", "Refit, Holding Selected"),
            ("NONE", "Refit, Holding None"),
        ):
            refit = column.operator("bsface.surface_refit", text=text)
            refit.hold, refit.softness = hold, soft
        column.prop(context.scene.bsface, "softness")
        column = layout.column(align=True)
        column.prop(face.data, "resolution_u")
        column.prop(face.data, "resolution_v")
        column = layout.column(align=True)
        column.operator("bsface.surface_symmetrise", icon="MOD_MIRROR")
        column.operator("bsface.surface_resample", icon="MESH_GRID")
        column.operator("bsface.surface_to_mesh", icon="MESH_DATA")
        column.operator("bsface.full_head", icon="USER")
        layout.operator("bsface.face_remove", icon="TRASH")


class BSFACE_PT_texture(FacePanel, bpy.types.Panel):
    bl_label = "Texture"

    def draw(self, context):
        layout = self.layout
        face = scene.active_face(context)
        shown, stored = material.shown(face), material.stored_kinds(face)
        column = layout.column(align=True)
        labels = {"PLAIN": "Plain"}
        labels.update({kind: name for kind, (name, _) in MAPS})
        for kind, label in labels.items():
            row = column.row(align=True)
            row.enabled = kind in ("PLAIN", "NORMALS") or kind in stored
            row.operator(
                "bsface.surface_map", text=label, depress=kind == shown
            ).kind = kind
        legend = material.legend(face)
        if legend:
            paragraph(context, layout, legend, icon="INFO")
        trimmed = material.is_trimmed(face)
        layout.operator(
            "bsface.surface_trim", icon="CLIPUV_HLT", depress=trimmed
        ).trim = not trimmed
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
            text = direction.capitalize() + ("" if is_narrow(context) else " Photo")
            row.operator(
                "bsface.view_photo", text=text, icon=sign
            ).direction = direction
        now = context.scene.camera
        through = now in views
        name = messages.NO_PHOTO_VIEW
        if through:
            name = shortened(context, now[cameras.PHOTO_KEY], 100)
        # Always a row, so that the buttons below stay where they are.
        layout.label(text=name, icon="CAMERA_DATA", translate=False)
        layout.operator("bsface.view_leave", icon="VIEW3D")
        in_front = cameras.in_front(face)
        row = layout.row(align=True)
        for front, text in ((True, "Photo in Front"), (False, "Behind")):
            row.operator(
                "bsface.view_front", text=text, depress=front == in_front
            ).front = front
        row = layout.row()
        row.enabled = in_front
        row.prop(context.scene.bsface, "photo_opacity", slider=True)
        are_shown = cameras.are_shown(context, face)
        layout.operator(
            "bsface.view_show", text="Show Cameras", depress=are_shown
        ).show = not are_shown
        if suns:
            lit = any(not sun.hide_viewport for sun in suns)
            layout.operator(
                "bsface.light_show", icon="LIGHT_SUN", depress=lit
            ).show = not lit
            if lit and showing.hides_lights(context):
                paragraph(context, layout, messages.LIGHT_UNSEEN, icon="INFO")


class BSFACE_UL_keys(bpy.types.UIList):
    """One shape key a row: name and value."""

    def draw_item(
        self, context, layout, data, item, icon, active_data, active_property, index
    ):
        row = layout.split(factor=0.6)
        row.prop(item, "name", text="", emboss=False, icon="SHAPEKEY_DATA")
        if item != data.reference_key:
            row.prop(item, "value", text="", slider=True, emboss=False)


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
                text=messages.MAKE_KEY.format(
                    name=word, photos=messages.plural(count, "photo")
                ),
                translate=False,
            ).expression = word
        keys = scene.active_face(context).data.shape_keys
        if keys is not None:
            face = scene.active_face(context)
            # Blender's own list is not in every version; all lists have its search.
            layout.template_list(
                "BSFACE_UL_keys",
                "bsface",
                keys,
                "key_blocks",
                face,
                "active_shape_key_index",
                rows=5,
            )
        layout.operator("bsface.arkit_keys", icon="SHAPEKEY_DATA")


class BSFACE_PT_export(FacePanel, bpy.types.Panel):
    bl_label = "Export"

    def draw(self, context):
        columns = 1 if is_narrow(context) else 2
        grid = self.layout.grid_flow(columns=columns, even_columns=True, align=True)
        for kind, label in export.available():
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
        manual.draw(layout)
        layout.operator("bsface.copy_information", icon="COPYDOWN")


CLASSES = (
    BSFACE_UL_keys,
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
