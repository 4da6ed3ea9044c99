"""A job's result goes into the face it was begun for, whatever is active at its end."""

import threading
from unittest.mock import MagicMock

import bpy
import numpy as np
import pytest
from blender import faces
from blender.checkout import load
from blender.modal_events import until_end

running = load("bsface_addon.operators.running")
surface = load("bsface_addon.operators.surface")
mesh = load("bsface_addon.operators.mesh")
messages = load("bsface_addon.messages")
surface_object = load("bsface_addon.surface_object")


class Window:
    """The context of this Blender, with a window manager that takes modal jobs."""

    def __init__(self):
        self.window_manager = MagicMock(operators=[], windows=[])

    def __getattr__(self, name):
        return getattr(bpy.context, name)


def begun(operator, **properties):
    """An operator of the add-on as Blender runs it in a window; what lets it end."""
    go = threading.Event()

    class Begun(running.LongOperator):
        prepare, deliver = operator.prepare, operator.deliver
        chosen, opens_editor = operator.chosen, operator.opens_editor
        wanted = getattr(operator, "wanted", None)

        @staticmethod
        def work(solver, request, progress):
            go.wait(20)
            return operator.work(solver, request, progress)

        def report(self, kind, text):
            self.said = text

    one = Begun()
    vars(one).update(properties)
    assert one.start(Window()) == {"RUNNING_MODAL"}
    return one, go


def end(one, go):
    go.set()
    return until_end(one, Window())


@pytest.fixture
def two(face, tmp_path):
    """Two faces; the first one is active, and the other one a little changed."""
    bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"), separate=True)
    other = bpy.context.scene.bsface.face
    assert other != face
    surface_object.write(bpy.context, other, faces.points(other) + [1.0, 0.0, 0.0])
    bpy.context.view_layer.objects.active = face
    yield face, other
    running.end(Window())


def test_refit_leaves_the_face_alone_that_became_active(two):
    face, other = two
    surface_object.write(bpy.context, face, faces.points(face) + [0.0, 2.0, 0.0])
    wanted, kept = faces.points(face) - [0.0, 2.0, 0.0], faces.points(other)
    one, go = begun(surface.BSFACE_OT_surface_refit, hold="NONE", softness=0.3)
    bpy.context.view_layer.objects.active = other
    bpy.context.scene.bsface.face = other
    assert one.updated(bpy.context) == face
    assert end(one, go) == {"FINISHED"}
    np.testing.assert_allclose(faces.points(face), wanted, atol=1e-3)
    np.testing.assert_array_equal(faces.points(other), kept)


def test_keys_go_to_the_face_they_were_made_for(two):
    face, other = two
    one, go = begun(mesh.BSFACE_OT_arkit_keys)
    bpy.context.view_layer.objects.active = other
    assert end(one, go) == {"FINISHED"}
    assert len(face.data.shape_keys.key_blocks) == 53
    assert other.data.shape_keys is None


def test_a_face_that_was_deleted_meanwhile_is_said(two):
    face, other = two
    kept = faces.points(other)
    one, go = begun(surface.BSFACE_OT_surface_refit, hold="NONE", softness=0.3)
    bpy.data.objects.remove(face)
    assert end(one, go) == {"CANCELLED"}
    assert one.said == messages.FACE_GONE
    np.testing.assert_array_equal(faces.points(other), kept)


def test_a_new_face_stays_new_though_another_one_became_active(two):
    reconstruct = load("bsface_addon.operators.reconstruct").BSFACE_OT_reconstruct
    face, other = two
    state = bpy.context.scene.bsface
    bpy.context.view_layer.objects.active, state.face = None, None
    before = {obj.session_uid for obj in bpy.context.scene.objects}
    kept = faces.points(face), faces.points(other)

    texts = dict.fromkeys(("directory", "name", "settings", "ignore"), "")
    net = {"control_points_u": 0, "control_points_v": 0}
    one, go = begun(reconstruct, separate=False, **texts, **net)
    bpy.context.view_layer.objects.active = other
    assert end(one, go) == {"FINISHED"}, one.said
    assert state.face.session_uid not in before
    np.testing.assert_array_equal(faces.points(face), kept[0])
    np.testing.assert_array_equal(faces.points(other), kept[1])


@pytest.fixture
def other_scene():
    """Another scene, with nothing in it."""
    return bpy.data.scenes.new("Other")


def test_the_result_goes_into_the_scene_in_which_it_was_begun(two, other_scene):
    reconstruct = load("bsface_addon.operators.reconstruct").BSFACE_OT_reconstruct
    face, _ = two
    home, count = bpy.context.scene, len(bpy.context.scene.objects)
    surface_object.write(bpy.context, face, faces.points(face) + [0.0, 2.0, 0.0])
    wanted = faces.points(face) - [0.0, 2.0, 0.0]
    texts = dict.fromkeys(("directory", "name", "settings", "ignore"), "")
    net = {"control_points_u": 0, "control_points_v": 0}
    one, go = begun(reconstruct, separate=False, **texts, **net)
    bpy.context.window.scene = other_scene
    assert end(one, go) == {"FINISHED"}
    np.testing.assert_allclose(faces.points(face), wanted, atol=1e-3)
    assert bpy.context.scene == other_scene and not other_scene.objects
    assert len(home.objects) == count and not other_scene.bsface.photos


def test_the_scene_of_a_job_may_be_deleted(two, other_scene):
    one, go = begun(mesh.BSFACE_OT_arkit_keys)
    home = bpy.context.scene
    bpy.context.window.scene = other_scene
    bpy.data.scenes.remove(home)
    assert end(one, go) == {"CANCELLED"} and one.said == messages.SCENE_GONE


def test_no_editor_opens_in_a_scene_that_is_not_looked_at(two, other_scene):
    masks = load("bsface_addon.operators.masks")
    home = bpy.context.scene
    one, go = begun(masks.BSFACE_OT_mask_edit, photo="1.png")
    bpy.context.window.scene = other_scene
    assert end(one, go) == {"CANCELLED"}
    assert one.said == messages.OTHER_SCENE.format(name=home.name)
    assert load("bsface_addon.mask_editor").editor() is None
