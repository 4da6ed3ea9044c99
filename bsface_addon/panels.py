"""The tab "BSface" in the sidebar of the 3D view, in the order of the work."""

from __future__ import annotations

import bpy

from . import job, messages, scene


class BSFacePanel:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "BSface"


class BSFACE_PT_reconstruct(BSFacePanel, bpy.types.Panel):
    bl_label = "Reconstruct"

    def draw(self, context):
        layout = self.layout
        running = job.current()
        if running is not None:
            layout.progress(
                factor=running.fraction,
                type="BAR",
                text=messages.progress_line(running),
            )
            layout.label(text="Esc stops it")
            return
        column = layout.column()
        column.scale_y = 1.0 if scene.active_face(context) else 2.0
        column.operator("bsface.reconstruct", icon="USER")


CLASSES = (BSFACE_PT_reconstruct,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
