"""The add-on's preferences."""

from __future__ import annotations

import bpy
from bpy.props import StringProperty

# The extension's own name, such as bl_ext.user_default.bsface.
from .. import __package__ as base_package


class BSFACE_AP_preferences(bpy.types.AddonPreferences):
    bl_idname = base_package

    models: StringProperty(
        name="Model Files",
        description="Folder with the face detector's .tflite files; empty: the ones "
        "that came with the extension",
        subtype="DIR_PATH",
    )

    def draw(self, context):
        self.layout.prop(self, "models")


def models_folder(context):
    """The folder set in the preferences, or None (also when run as a script)."""
    addon = context.preferences.addons.get(base_package)
    folder = addon.preferences.models if addon and addon.preferences else ""
    return bpy.path.abspath(folder) if folder else None


CLASSES = (BSFACE_AP_preferences,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
