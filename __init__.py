"""Blender extension bsface: photos in, the face as a native NURBS surface out.

The imports are lazy so that whatever imports this folder without Blender (the
test runner, documentation tools) does not need `bpy`.
"""


def register():
    """Register the add-on's classes; called by Blender."""
    from . import bsface_addon

    bsface_addon.register()


def unregister():
    """Undo `register`; called by Blender."""
    from . import bsface_addon

    bsface_addon.unregister()
