"""Settings put back, presets, and what a report of a fault needs."""

import bpy
from blender.checkout import load


def test_reset_and_presets(addon):
    state = bpy.context.scene.bsface
    state.settings.method, state.settings.control_points_u = "motion", 20
    bpy.ops.bsface.preset_add(name="quick")
    bpy.ops.bsface.reset()
    settings_group = load("bsface_addon.settings_group")
    assert settings_group.to_core(state.settings) == load("core.settings").Settings()
    path = next(
        f"{folder}/quick.py" for folder in bpy.utils.preset_paths("bsface/settings")
    )
    bpy.ops.script.execute_preset(filepath=path, menu_idname="BSFACE_MT_presets")
    assert state.settings.method == "motion" and state.settings.control_points_u == 20


def test_system_information_names_the_versions(addon):
    messages = load("bsface_addon.messages")
    text = messages.system_information()
    assert bpy.app.version_string in text and "scipy" in text
    assert bpy.ops.bsface.copy_information() == {"FINISHED"}
