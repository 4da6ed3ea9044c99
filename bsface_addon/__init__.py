"""The Blender side of bsface: everything that needs `bpy`."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from . import (
    headless,
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
    views,
    expressions,
    export,
    support,
    photo_panels,
    panels,
    headless,
)


@persistent
def stop_job(*_):
    """A job belongs to the file it was started in."""
    running.end(bpy.context)


def register():
    for module in MODULES:
        module.register()
    bpy.app.handlers.load_pre.append(stop_job)


def unregister():
    running.end(bpy.context)
    bpy.app.handlers.load_pre.remove(stop_job)
    for module in reversed(MODULES):
        module.unregister()
