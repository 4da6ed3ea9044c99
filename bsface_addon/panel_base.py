"""What all panels of the tab "BSface" share."""

from __future__ import annotations

import blf
import bpy

from . import photo_stage, scene

# Of the interface's text; and what borders, an icon and the scroll bar take.
POINTS = 11
MARGIN = 70
# Two buttons with words in a row need this width of the sidebar, in points.
ROOMY = 280


class BSFacePanel:
    """Hidden while landmarks or a mask are edited: then only their panel shows."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "BSface"

    @classmethod
    def poll(cls, context):
        return not photo_stage.is_open()


class FacePanel(BSFacePanel):
    """Hidden until there is a face."""

    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return super().poll(context) and scene.active_face(context) is not None


def paragraph(
    context: bpy.types.Context, layout: bpy.types.UILayout, text: str, icon="NONE"
) -> None:
    """Text wrapped to the sidebar's width."""
    room = width(context) - MARGIN - (0 if icon == "NONE" else 35)
    lines, line = [], ""
    for word in text.split():
        longer = f"{line} {word}".lstrip()
        if line and measured(longer) > room:
            lines.append(line)
            longer = word
        line = longer
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, part in enumerate([*lines, line]):
        sign = icon if number == 0 else ("NONE" if icon == "NONE" else "BLANK1")
        column.label(text=part, icon=sign, translate=False)


def shortened(context: bpy.types.Context, text: str, taken: float) -> str:
    """The end of a name, which tells photos apart, where all of it has no room.

    Parameters
    ----------
    taken : float
        Width of what else stands in the row, in points.
    """
    room = width(context) - taken
    if measured(text) <= room:
        return text
    for start in range(1, len(text) - 4):
        if measured(f"\N{HORIZONTAL ELLIPSIS}{text[start:]}") <= room:
            break
    return f"\N{HORIZONTAL ELLIPSIS}{text[start:]}"


def is_narrow(context: bpy.types.Context) -> bool:
    """Whether two buttons with words stand below each other."""
    return width(context) < ROOMY


def width(context: bpy.types.Context) -> float:
    """Of the sidebar, in points."""
    scale = context.preferences.system.ui_scale or 1.0  # 0 without a window
    return (context.region.width if context.region else 300) / scale


def measured(text: str) -> float:
    """Width of a text in Blender's font, in points."""
    blf.size(0, POINTS)
    return blf.dimensions(0, text)[0]
