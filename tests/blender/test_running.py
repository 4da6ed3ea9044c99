"""The modal half of the long operators, driven by made-up events."""

import subprocess
import sys
import threading
import time
from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import pytest
from blender.checkout import load
from blender.modal_events import ESC, TIMER, until_end

running = load("bsface_addon.operators.running")
session = load("bsface_addon.session")
job = load("bsface_addon.job")
errors = load("core.errors")
Step = load("core.progress").Step
MOUSE = SimpleNamespace(type="MOUSEMOVE", value="NOTHING")


class Operator(running.LongOperator):
    """What Blender would make of it, as far as the modal half goes."""

    def __init__(self):
        self.delivered, self.said, self.asked = [], [], "request"

    def prepare(self, context):
        if isinstance(self.asked, Exception):
            raise self.asked
        return self.asked

    def deliver(self, context, request, outcome):
        self.delivered.append((request, outcome))

    def report(self, kind, text):
        self.said.append((*kind, text))


@pytest.fixture
def window(registered):
    """A context with a window."""
    context = MagicMock()
    yield context
    running.end(context)


def started(window, solve):
    """The operator after Blender has invoked it in a window."""

    class Started(Operator):
        @staticmethod
        def work(solver, request, progress):
            return solve(request, progress)

    operator = Started()
    assert operator.start(window) == {"RUNNING_MODAL"}
    return operator


def assert_cleaned(operator, window):
    assert session.running() is None
    manager = window.window_manager
    manager.event_timer_remove.assert_called_once()
    manager.progress_end.assert_called_once()
    window.workspace.status_text_set.assert_called_with(None)


def test_the_result_is_delivered_on_the_main_thread(window):
    def solve(request, progress):
        progress(Step("motion", 1, 2, 0.5, "half"))
        return request.upper()

    operator = started(window, solve)
    assert operator.modal(window, MOUSE) == {"PASS_THROUGH"}
    assert until_end(operator, window) == {"FINISHED"}
    assert operator.delivered == [("request", "REQUEST")]
    window.window_manager.progress_update.assert_called_with(50.0)
    assert_cleaned(operator, window)


def test_esc_ends_at_once_and_delivers_nothing(window):
    go = threading.Event()
    operator = started(window, lambda request, progress: go.wait(20))
    began = session.running()
    assert operator.modal(window, ESC) == {"CANCELLED"}
    assert not operator.delivered and began.cancelled
    assert "as it was" in operator.said[0][1]
    assert_cleaned(operator, window)
    go.set()
    assert began.wait(20)


def test_blender_stops_it_when_another_file_is_loaded(window):
    go = threading.Event()
    operator = started(window, lambda request, progress: go.wait(20))
    operator.cancel(window)
    assert_cleaned(operator, window)
    # Events that still come find the job gone.
    assert operator.modal(window, TIMER) == {"CANCELLED"}
    go.set()


@pytest.fixture
def going(addon):
    """A job under way in this Blender, and what lets it go on."""
    go = threading.Event()
    began = session.current().start(lambda progress: go.wait(20))
    running.begin(bpy.context)
    yield began
    go.set()
    assert began.wait(20)
    running.end(bpy.context)


def assert_nothing_runs(began):
    assert began.cancelled and session.running() is None
    # Blender removes a timer only once: a second time is an error.
    assert session.current().timer is None


def test_loading_a_file_ends_the_job(going):
    assert not bpy.ops.bsface.reconstruct.poll()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert_nothing_runs(going)
    assert bpy.ops.bsface.reconstruct.poll()


def test_disabling_the_addon_ends_the_job(addon, going):
    addon.unregister()
    try:
        assert_nothing_runs(going)
        assert not hasattr(bpy.types, "BSFACE_OT_reconstruct")
        assert addon.stop_job not in bpy.app.handlers.load_pre
    finally:
        addon.register()
    assert bpy.ops.bsface.reconstruct.poll()


def test_quitting_does_not_wait_for_the_job():
    """An interpreter ends although its job never does."""
    program = (
        "import sys, threading; from importlib import util\n"
        "spec = util.spec_from_file_location('job', sys.argv[1])\n"
        "job = util.module_from_spec(spec); spec.loader.exec_module(job)\n"
        "started = threading.Event()\n"
        "work = lambda progress: (started.set(), threading.Event().wait())\n"
        "job.Job(work, KeyError)\n"
        "assert started.wait(20)\n"
    )
    command = [sys.executable, "-c", program, job.__file__]
    assert subprocess.run(command, timeout=60).returncode == 0


def test_the_status_bar_shows_the_job_and_is_given_back(window):
    go = threading.Event()

    def solve(request, progress):
        progress(Step("motion", 3, 8, 0.4, ""))
        go.wait(20)

    operator = started(window, solve)
    for _ in range(400):
        operator.modal(window, TIMER)
        if session.running().step is not None:
            break
        time.sleep(0.01)
    window.workspace.status_text_set.assert_called_with(running.draw_status)
    header = MagicMock()
    running.draw_status(header, window)
    (said,) = header.layout.label.call_args_list
    assert "Placing cameras 3/8" in said.kwargs["text"]
    go.set()
    assert until_end(operator, window) == {"FINISHED"}
    running.draw_status(header, window)
    assert header.layout.label.call_count == 1
    assert_cleaned(operator, window)


@pytest.mark.parametrize(
    "error, words",
    [
        (errors.ReconstructionError("No photo can be used."), "No photo can be used."),
        (ZeroDivisionError("inside"), "error inside BSface"),
        (ModuleNotFoundError("no", name="scipy"), "scipy is missing"),
    ],
)
def test_an_error_of_the_worker_is_reported(window, error, words):
    def solve(request, progress):
        raise error

    operator = started(window, solve)
    assert until_end(operator, window) == {"CANCELLED"}
    ((kind, text),) = operator.said
    assert kind == "ERROR" and words in text
    assert not operator.delivered
    assert_cleaned(operator, window)


def test_an_error_of_the_delivery_is_reported(window):
    operator = started(window, lambda request, progress: "fine")

    def deliver(*_):
        raise RuntimeError("no place")

    operator.deliver = deliver
    assert until_end(operator, window) == {"CANCELLED"}
    assert "no place" in operator.said[0][1]
    assert "no place" in window.scene.bsface.last_error


def test_a_wrong_request_starts_nothing(window):
    operator = Operator()
    operator.asked = errors.ReconstructionError("Add photos of one person first")
    assert operator.start(window) == {"CANCELLED"}
    assert session.running() is None
    window.window_manager.event_timer_add.assert_not_called()


def test_the_cancel_button_stops_the_job(going):
    assert bpy.ops.bsface.job_cancel() == {"FINISHED"}
    assert going.cancelled
    running.end(bpy.context)
    assert not bpy.ops.bsface.job_cancel.poll()


@pytest.mark.parametrize("touched", [False, True])
def test_whether_the_user_did_something_meanwhile_is_known(window, touched):
    operator = started(window, lambda request, progress: "fine")
    if touched:
        window.view_layer.objects.active = MagicMock()
    assert until_end(operator, window) == {"FINISHED"}
    assert operator.undisturbed is not touched


def test_views_and_maps_can_be_changed_while_a_job_runs(addon, solver, tmp_path):
    bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"))
    go = threading.Event()
    began = session.current().start(lambda progress: go.wait(20))
    assert bpy.ops.bsface.view_photo.poll() and bpy.ops.bsface.surface_map.poll()
    assert not bpy.ops.bsface.surface_symmetrise.poll()
    go.set()
    assert began.wait(20)
    session.current().stop()
