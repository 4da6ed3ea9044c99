"""What all panels of the tab "BSface" share."""

from __future__ import annotations

import textwrap

from . import landmark_editor, scene


class BSFacePanel:
    """Hidden while landmarks are edited: then only their panel shows."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "BSface"

    @classmethod
    def poll(cls, context):
        return landmark_editor.editor() is None


class FacePanel(BSFacePanel):
    """Hidden until there is a face."""

    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return super().poll(context) and scene.active_face(context) is not None


def paragraph(context, layout, text, icon="NONE"):
    """Text wrapped to the sidebar's width."""
    scale = context.preferences.system.ui_scale or 1.0  # 0 without a window
    width = context.region.width if context.region else 300
    lines = textwrap.wrap(text, max(20, int((width / scale - 60) / 6.2)))
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(lines):
        sign = icon if number == 0 else ("NONE" if icon == "NONE" else "BLANK1")
        column.label(text=line, icon=sign, translate=False)
