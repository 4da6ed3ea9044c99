"""The face as a job has it so far: what is drawn, where, and that nothing is left."""

import threading
import time
from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import numpy as np
import pytest
from blender import modal_events
from blender.checkout import load
from blender.modal_events import ESC, TIMER
from mathutils import Matrix

overlays = load("bsface_addon.estimate_overlay")
expressions = load("bsface_addon.operators.expressions")
reconstruct = load("bsface_addon.operators.reconstruct")
surface_operators = load("bsface_addon.operators.surface")
running = load("bsface_addon.operators.running")
scene = load("bsface_addon.scene")
session = load("bsface_addon.session")
coordinates = load("bsface_addon.coordinates")
surface_object = load("bsface_addon.surface_object")
errors = load("core.errors")
Step = load("core.progress").Step
load_template = load("core.surface.template").load_template


def net(scale=1.0):
    return scale * load_template().surface.control_points


class Operator(running.LongOperator):
    """A long operator whose work the test lets go on."""

    go = threading.Event()
    face = None

    def __init__(self):
        self.delivered, self.said = [], []

    def prepare(self, context):
        return "request"

    def updated(self, context):
        return self.face

    def deliver(self, context, request, outcome):
        self.delivered.append(outcome)

    def report(self, kind, text):
        self.said.append(text)


@pytest.fixture
def view():
    """Region data of a 3D view that looks at a new file."""
    return SimpleNamespace(
        view_perspective="PERSP",
        view_location=[0.0, 0.0, 0.0],
        view_rotation=[1.0, 0.0, 0.0, 0.0],
        view_distance=17.0,
    )


@pytest.fixture
def window(addon, view):
    """A context with the scene of this Blender and a window with one 3D view."""
    region = SimpleNamespace(type="WINDOW", tag_redraw=MagicMock())
    space = SimpleNamespace(region_3d=view, use_local_camera=False, local_view=None)
    area = SimpleNamespace(
        type="VIEW_3D", regions=[region], spaces=SimpleNamespace(active=space)
    )
    context = MagicMock()
    context.scene, context.view_layer = bpy.context.scene, bpy.context.view_layer
    context.window.screen.areas = [area]
    context.window_manager.windows = [context.window]
    context.window_manager.operators = []
    # A timer that this Blender can remove by itself.
    manager, here = bpy.context.window_manager, bpy.context.window
    context.window_manager.event_timer_add = lambda seconds, window: (
        manager.event_timer_add(seconds, window=here)
    )
    context.window_manager.event_timer_remove = manager.event_timer_remove
    context.redrawn = region.tag_redraw
    yield context
    running.end(context)


def begin(window, last=None, face=None):
    """An operator whose job has told two estimates and waits.

    ``last`` is then raised or returned by the job.
    """
    go = threading.Event()

    class Begun(Operator):
        @staticmethod
        def work(solver, request, progress):
            progress(Step("landmarks", 1, 1, 0.1, ""))
            progress(Step("motion", 1, 1, 0.2, "", net(1.1)))
            progress(Step("refine", 1, 2, 0.5, "", net()))
            progress(Step("output", 1, 2, 0.9, ""))
            go.wait(20)
            if isinstance(last, Exception):
                raise last
            return last

    operator = Begun()
    operator.go, operator.face = go, face
    assert operator.start(window) == {"RUNNING_MODAL"}
    for _ in range(400):
        assert operator.modal(window, TIMER) == {"PASS_THROUGH"}
        job = session.running()
        if job.step is not None and job.step.stage == "output":
            return operator
        time.sleep(0.01)
    raise AssertionError("the job said nothing")


def until_end(operator, window):
    operator.go.set()
    return modal_events.until_end(operator, window)


def overlay():
    return session.current().overlay


def assert_empty():
    assert overlay().estimate is None and not overlay().is_drawn
    overlay().draw()  # a redraw that was under way finds nothing


def everything():
    """Every data-block of the file, window managers and screens aside."""
    return {
        (kind.identifier, data.session_uid)
        for kind in bpy.data.bl_rna.properties
        if kind.type == "COLLECTION" and kind.identifier not in ("screens",)
        for data in getattr(bpy.data, kind.identifier)
    }


def test_the_newest_estimate_is_drawn_where_the_face_will_be(window, solved, tmp_path):
    bpy.context.scene.bsface.size = 2.0
    before = everything()
    operator = begin(window)
    drawn = overlay().estimate
    assert overlay().is_drawn and everything() == before
    assert np.array_equal(drawn.control_points, net())
    assert len(drawn.points) == np.prod(overlays.LINES) <= 40 * 50
    assert np.isfinite(drawn.points).all() and np.isfinite(drawn.colours).all()
    assert until_end(operator, window) == {"FINISHED"}
    # Where `place` puts a new face of this size.
    bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"))
    face = bpy.context.scene.bsface.face
    assert np.allclose(drawn.frame, coordinates.world_frame(face))
    points = surface_object.read(face)
    beside = scene.frame_of_new(bpy.context, points, 2.0)
    bpy.ops.bsface.reconstruct(separate=True)
    second = bpy.context.scene.bsface.face
    assert second != face
    assert np.allclose(beside, coordinates.world_frame(second), atol=1e-6)


def test_over_a_face_it_follows_its_object(window, solved, tmp_path):
    bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"))
    face = bpy.context.scene.bsface.face
    face.matrix_world = Matrix.Translation((1, 2, 3)) @ Matrix.Rotation(0.5, 4, "Y")
    before, points = everything(), surface_object.read(face)
    operator = begin(window, face=face)
    drawn = overlay().estimate
    assert np.allclose(drawn.frame, coordinates.world_frame(face))
    face.location.x = 7
    bpy.context.view_layer.update()
    operator.show_estimate(window, session.running())
    assert overlay().estimate.frame.translation.x == pytest.approx(7)
    assert everything() == before
    assert np.array_equal(surface_object.read(face), points)


def test_views_are_drawn_anew_for_news_only(window):
    operator = begin(window)
    window.redrawn.reset_mock()
    operator.show_estimate(window, session.running())
    window.redrawn.assert_not_called()


def test_what_is_updated_is_what_the_estimate_lies_over(addon, solved, tmp_path):
    state = bpy.context.scene.bsface
    chosen = reconstruct.BSFACE_OT_reconstruct.chosen
    asked = SimpleNamespace(separate=False, directory="")
    assert chosen(asked, bpy.context) is None
    bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"))
    assert chosen(asked, bpy.context) == state.face
    state.separate = True
    assert chosen(asked, bpy.context) is None
    # Fits that end in the face itself or in a key of it, whatever that setting is.
    for other in (
        surface_operators.BSFACE_OT_surface_refit,
        expressions.BSFACE_OT_expression_key,
    ):
        assert other.chosen(SimpleNamespace(), bpy.context) == state.face


def test_nothing_is_left_after_the_result(window):
    before = everything()
    operator = begin(window, "outcome")
    assert until_end(operator, window) == {"FINISHED"}
    assert operator.delivered == ["outcome"] and operator.undisturbed
    assert_empty()
    assert everything() == before


def test_nothing_is_left_after_esc(window):
    operator = begin(window)
    assert operator.modal(window, ESC) == {"CANCELLED"}
    assert_empty()
    operator.go.set()


def test_nothing_is_left_after_a_failure(window):
    operator = begin(window, errors.ReconstructionError("No photo can be used."))
    assert until_end(operator, window) == {"CANCELLED"}
    assert operator.said == ["No photo can be used."]
    assert_empty()


def test_nothing_is_left_when_another_file_is_loaded(window):
    operator = begin(window)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert_empty()
    operator.go.set()


def test_nothing_is_left_when_the_addon_is_disabled(addon, window):
    operator = begin(window)
    was = overlay()
    addon.unregister()
    try:
        assert was.estimate is None and not was.is_drawn
    finally:
        addon.register()
    operator.go.set()


@pytest.mark.parametrize("touched", [False, True])
def test_views_of_a_new_file_turn_to_the_face_and_back(window, view, touched):
    operator = begin(window)
    assert view.view_distance < 1 and list(view.view_rotation)[0] < 1
    if touched:
        view.view_distance = 5.0
    operator.modal(window, ESC)
    assert view.view_distance == (5.0 if touched else 17.0)
    assert (list(view.view_rotation) == [1.0, 0.0, 0.0, 0.0]) is not touched
    operator.go.set()


def test_views_that_look_at_a_face_stay(window, view, solved, tmp_path):
    bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"))
    operator = begin(window, face=bpy.context.scene.bsface.face)
    assert view.view_distance == 17.0
    operator.modal(window, ESC)
    assert view.view_distance == 17.0
    operator.go.set()


def test_extent_is_that_of_the_points_in_the_scene():
    points = np.array([[[-1, 0, 0], [3, 0, 0]], [[1, 1, 0], [1, -1, 2]]], float)
    frame = Matrix.Translation((10, 0, 0)) @ Matrix.Scale(2, 4)
    middle, reach = overlays.extent(points, frame)
    assert np.allclose(middle, (12, 0, 2))
    assert reach == pytest.approx(np.linalg.norm((8, 4, 4)) / 2)
