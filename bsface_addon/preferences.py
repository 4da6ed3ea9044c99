"""The add-on's preferences."""

from __future__ import annotations

import os

import bpy
from bpy.props import StringProperty

# The extension's own name, such as bl_ext.user_default.bsface.
from .. import __package__ as base_package
from . import manual

# Where the core looks first for the model files (core/landmarks/face_models.py).
VARIABLE = "BSFACE_MODELS"


def tell_core(preferences, context=None):
    """Hand the chosen folder to the core."""
    if preferences.models:
        os.environ[VARIABLE] = bpy.path.abspath(preferences.models)
    else:
        os.environ.pop(VARIABLE, None)


class BSFACE_AP_preferences(bpy.types.AddonPreferences):
    bl_idname = base_package

    models: StringProperty(
        name="Model Files",
        description="Folder with the face models; empty: those that came with the "
        "extension",
        subtype="DIR_PATH",
        update=tell_core,
    )

    def draw(self, context):
        self.layout.prop(self, "models")
        manual.draw(self.layout)


CLASSES = (BSFACE_AP_preferences,)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    # Absent when run as a script instead of as an installed extension.
    addon = bpy.context.preferences.addons.get(base_package)
    if addon is not None and addon.preferences and addon.preferences.models:
        tell_core(addon.preferences)


def unregister():
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
