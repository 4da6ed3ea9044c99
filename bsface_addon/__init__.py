"""The Blender side of bsface: everything that needs `bpy`."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from . import (
    camera_views,
    coarse_editor,
    headless,
    manual,
    mask_editor,
    material,
    panels,
    photo_panels,
    preferences,
    properties,
    session,
    thumbnails,
)
from .operators import (
    export,
    expressions,
    landmarks,
    masks,
    mesh,
    nets,
    photos,
    reconstruct,
    running,
    support,
    surface,
    views,
)

# Registered in this order, unregistered backwards: properties before what uses them.
MODULES = (
    session,
    properties,
    preferences,
    thumbnails,
    photos,
    landmarks,
    reconstruct,
    surface,
    nets,
    views,
    masks,
    expressions,
    mesh,
    export,
    support,
    photo_panels,
    panels,
    manual,
    headless,
)


@persistent
def stop_job(*_):
    """A job belongs to the file it was started in, and so do the kept photos."""
    running.end(bpy.context)
    session.current().solver.forget()


@persistent
def upgrade(*_):
    """Files of earlier versions get the names of now."""
    material.upgrade()


@persistent
def follow_undo(*_):
    """Views are not part of undo."""
    camera_views.follow_undo(bpy.context)
    mask_editor.restore_shading(bpy.context)


HANDLERS = (
    (bpy.app.handlers.load_pre, stop_job),
    (bpy.app.handlers.load_post, upgrade),
    (bpy.app.handlers.undo_post, follow_undo),
    (bpy.app.handlers.redo_post, follow_undo),
)


def register():
    for module in MODULES:
        module.register()
    for handlers, function in HANDLERS:
        handlers.append(function)


def unregister():
    running.end(bpy.context)
    coarse_editor.stop_following()
    for handlers, function in HANDLERS:
        handlers.remove(function)
    for module in reversed(MODULES):
        module.unregister()
