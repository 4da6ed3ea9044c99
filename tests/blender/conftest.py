"""Fixtures that the tests of the add-on share."""

import pytest

bpy = pytest.importorskip("bpy", reason="needs Blender's module bpy")


@pytest.fixture
def empty_scene():
    """A file with nothing in it."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return bpy.context.scene
