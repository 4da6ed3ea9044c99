"""The operator `bsface.reconstruct` and the job beside the UI."""

import threading

import bpy
import numpy as np
import pytest
from blender.checkout import load

session = load("bsface_addon.session")
Job = load("bsface_addon.job").Job
scene = load("bsface_addon.scene")
surface_object = load("bsface_addon.surface_object")
errors = load("core.errors")
Step = load("core.progress").Step


def test_folder_in_surface_out(addon, solved, tmp_path):
    assert bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos")) == {
        "FINISHED"
    }
    face = bpy.context.scene.bsface.face
    assert bpy.context.view_layer.objects.active == face and scene.is_face(face)
    rows = bpy.context.scene.bsface.photos
    assert [row.status for row in rows] == ["used"] * 3
    assert [row.name for row in rows] == ["0.png", "1.png", "2.png"]


def test_settings_of_the_call_win_over_the_panel(addon, solved, tmp_path):
    state = bpy.context.scene.bsface
    state.settings.method = "motion"
    state.settings.control_points_u = 24
    bpy.ops.bsface.reconstruct(
        directory=str(tmp_path / "photos"),
        control_points_v=16,
        settings='{"method": "imls"}',
        name="Bea",
    )
    (request,) = solved
    assert request.settings.control_points == (24, 16)
    assert request.settings.method == "imls"
    assert state.face.name == "Bea"


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({}, "Add photos"),
        ({"directory": "/no/such/folder"}, "cannot open this folder"),
        ({"settings": "{", "directory": "."}, "settings"),
        ({"settings": "[1]", "directory": "."}, "settings"),
        ({"settings": '{"method": "magic"}', "directory": "."}, "method must be"),
        ({"settings": '{"nonsense": 1}', "directory": "."}, "no setting nonsense"),
    ],
)
def test_wrong_calls_say_why_and_change_nothing(
    addon, solved, tmp_path, arguments, message
):
    if arguments.get("directory") == ".":
        arguments = {**arguments, "directory": str(tmp_path / "photos")}
    with pytest.raises(RuntimeError, match=message):
        bpy.ops.bsface.reconstruct(**arguments)
    assert not bpy.data.objects and not bpy.context.scene.bsface.photos
    assert not solved


def test_running_again_updates_the_face_unless_asked(addon, solved, tmp_path):
    folder = str(tmp_path / "photos")
    bpy.ops.bsface.reconstruct(directory=folder)
    first = bpy.context.scene.bsface.face
    bpy.ops.bsface.reconstruct()
    assert bpy.context.scene.bsface.face == first
    assert sum(scene.is_face(obj) for obj in bpy.data.objects) == 1
    bpy.ops.bsface.reconstruct(separate=True)
    assert sum(scene.is_face(obj) for obj in bpy.data.objects) == 2


def test_one_undo_step_removes_the_result(addon, solved, tmp_path):
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.bsface.reconstruct("EXEC_DEFAULT", True, directory=str(tmp_path / "photos"))
    assert len(bpy.data.objects) == 8
    bpy.ops.ed.undo()
    assert not bpy.data.objects
    assert bpy.context.scene.bsface.face is None


def test_a_failed_solve_is_one_sentence_and_leaves_nothing(addon, solver, tmp_path):
    solver.answer = errors.ReconstructionError("None of the 3 photos can be used.")
    with pytest.raises(RuntimeError, match="None of the 3 photos"):
        bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"))
    assert not bpy.data.objects and not bpy.data.collections
    assert "None of the 3" in bpy.context.scene.bsface.last_error


def test_an_unexpected_error_is_kept_for_the_report(addon, solver, tmp_path):
    solver.answer = ZeroDivisionError("inside")
    with pytest.raises(RuntimeError, match="error inside BSface"):
        bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"))
    assert "Traceback" in bpy.context.scene.bsface.last_error


def finish(running):
    assert running.wait(20)
    running.poll()


def test_job_reports_progress_and_result(addon):
    go = threading.Event()

    def work(progress):
        progress(Step("motion", 1, 4, 0.25, "one"))
        go.wait(20)
        return np.arange(3)

    now = session.current()
    running = now.start(work)
    assert session.running() is running
    with pytest.raises(RuntimeError, match="running already"):
        now.start(work)
    go.set()
    finish(running)
    assert running.fraction == 0.25 and running.step.message == "one"
    assert running.finished and running.result.tolist() == [0, 1, 2]
    now.stop()
    assert session.running() is None


def test_job_stops_at_the_next_report():
    go = threading.Event()
    passed = []

    def work(progress):
        go.wait(20)
        progress(Step("motion", 0, 1, 0.0, ""))
        passed.append(True)

    running = Job(work, errors.Cancelled)
    running.cancel()
    go.set()
    finish(running)
    assert running.finished and running.result is None and running.error is None
    assert not passed


def test_job_brings_errors_with_their_trace():
    def work(progress):
        raise ValueError("broken")

    running = Job(work, errors.Cancelled)
    finish(running)
    assert isinstance(running.error, ValueError) and "broken" in running.trace
