"""The areas of Blender's window that show the scene."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import bpy


def on_screens(screens: Iterable[bpy.types.Screen]) -> Iterator[bpy.types.Area]:
    """The 3D views of some screens."""
    for screen in screens:
        yield from (area for area in screen.areas if area.type == "VIEW_3D")


def in_window(context: bpy.types.Context) -> Iterator[bpy.types.Area]:
    """The 3D views of the window that was clicked in; none in the background."""
    return on_screens([context.window.screen] if context.window else [])


def in_all_windows(context: bpy.types.Context) -> Iterator[bpy.types.Area]:
    """The 3D views of all windows."""
    return on_screens(window.screen for window in context.window_manager.windows)


def redraw(context: bpy.types.Context, kind: str) -> None:
    """Redraw the regions of one kind of all 3D views: "WINDOW", "UI"."""
    for area in in_all_windows(context):
        for region in area.regions:
            if region.type == kind:
                region.tag_redraw()


def spaces(context):
    """All 3D views."""
    for area in in_all_windows(context):
        yield area.spaces.active


def views(context):
    """Region data of all 3D views."""
    for space in spaces(context):
        yield space.region_3d
