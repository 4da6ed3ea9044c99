"""Resets, presets, and the block of information that a bug report needs."""

from __future__ import annotations

import bpy
from bl_operators.presets import AddPresetBase
from bpy.props import EnumProperty

from .. import messages, session, settings_group

PRESETS = "bsface/settings"


class BSFACE_OT_copy_information(bpy.types.Operator):
    """Copy versions and the last error, to paste into a report"""

    bl_idname = "bsface.copy_information"
    bl_label = "Copy System Information"
    bl_options = {"REGISTER"}

    def execute(self, context):
        text = messages.system_information()
        error = context.scene.bsface.last_error
        if error:
            text += f"\n\nLast error:\n{error}"
        context.window_manager.clipboard = text
        self.report({"INFO"}, messages.COPIED)
        return {"FINISHED"}


class BSFACE_OT_reset(bpy.types.Operator):
    """Set this group back to its defaults"""

    bl_idname = "bsface.reset"
    bl_label = "Reset"
    bl_options = {"REGISTER", "UNDO"}

    group: EnumProperty(
        name="Group",
        items=(
            ("SETTINGS", "Settings", "The settings of Reconstruct"),
            ("ERROR", "Last Error", "The last error"),
        ),
    )

    @classmethod
    def poll(cls, context):
        if session.running() is not None:
            cls.poll_message_set(messages.RUNNING)
            return False
        return True

    def execute(self, context):
        state = context.scene.bsface
        if self.group == "ERROR":
            state.last_error = ""
            return {"FINISHED"}
        for name in ("size", "separate", "texture_size"):
            state.property_unset(name)
        for prop in state.settings.bl_rna.properties:
            if not prop.is_readonly:
                state.settings.property_unset(prop.identifier)
        return {"FINISHED"}


class BSFACE_MT_presets(bpy.types.Menu):
    bl_label = "Settings Presets"
    preset_subdir = PRESETS
    preset_operator = "script.execute_preset"
    draw = bpy.types.Menu.draw_preset


class BSFACE_OT_preset_add(AddPresetBase, bpy.types.Operator):
    """Keep the settings under a name, or remove the chosen preset"""

    bl_idname = "bsface.preset_add"
    bl_label = "Add Settings Preset"
    preset_menu = "BSFACE_MT_presets"
    preset_subdir = PRESETS
    preset_defines = ["settings = bpy.context.scene.bsface.settings"]
    preset_values = [f"settings.{name}" for name in settings_group.NAMES]


class BSFACE_OT_job_cancel(bpy.types.Operator):
    """Stop the running job; the scene stays as it is"""

    bl_idname = "bsface.job_cancel"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        if session.running() is None:
            cls.poll_message_set(messages.NOTHING_RUNS)
            return False
        return True

    def execute(self, context):
        # The job's own operator ends it at its next timer event.
        session.running().cancel()
        return {"FINISHED"}


CLASSES = (
    BSFACE_OT_job_cancel,
    BSFACE_OT_copy_information,
    BSFACE_OT_reset,
    BSFACE_MT_presets,
    BSFACE_OT_preset_add,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
