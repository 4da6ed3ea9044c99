"""How an operator with long core work runs: straight through, or beside the UI.

`LongOperator` is mixed into operators that define ``prepare(context)`` -> request and
``deliver(context, request, outcome)``, both on the main thread, and ``work(solver,
request, progress)``, a static function of core code only.  Where the core reports the
face as it is so far, the views show it (`estimate_overlay`).
"""

from __future__ import annotations

import contextlib
import functools
import traceback
from collections.abc import Iterator
from typing import TYPE_CHECKING

import bpy

from ...core.errors import ReconstructionError, out_of_memory
from .. import (
    camera_views,
    coarse_editor,
    coordinates,
    messages,
    scene,
    session,
    showing,
    view_areas,
)
from ..estimate_overlay import extent

if TYPE_CHECKING:
    from ...core.progress import Progress
    from ..job import Job
    from ..request import Request
    from ..solving import Outcome, Solver

INTERVAL_S = 0.1


def free_to_change(cls: type[bpy.types.Operator]) -> bool:
    """Shared poll: no job runs and no coarse net is open, which would undo a change."""
    if session.running() is not None:
        cls.poll_message_set(messages.RUNNING)
        return False
    if coarse_editor.editor() is not None:
        cls.poll_message_set(messages.COARSE_OPEN)
        return False
    return True


class LongOperator:
    """``execute`` runs straight through; ``invoke`` runs beside the UI (see `job`)."""

    @staticmethod
    def work(solver: Solver, request: Request, progress: Progress | None) -> Outcome:
        """What the thread does."""
        return solver.solve(request, progress)

    def chosen(self, context: bpy.types.Context) -> bpy.types.Object | None:
        """The face that the job is for, as it begins; None for a new one."""
        return scene.active_face(context)

    def updated(self, context: bpy.types.Context) -> bpy.types.Object | None:
        """The face that the job is for, whatever the user has made active meanwhile.

        None for a new one, and where it is not in the scene any more.
        """
        return scene.face_with(context, self._face)

    def kept(self, context: bpy.types.Context) -> bpy.types.Object:
        """The face that the job is for; a failure where it is gone."""
        face = self.updated(context)
        if face is None:
            raise ReconstructionError(messages.FACE_GONE)
        return face

    def begin_for(self, context: bpy.types.Context) -> Request:
        """Remember the face that the job is for; the request."""
        face = self.chosen(context)
        self._face = None if face is None else face.session_uid
        self._scene = context.scene.session_uid
        return self.prepare(context)

    # On: its result is an editor, for who looks at the scene that it was begun in.
    opens_editor = False

    @contextlib.contextmanager
    def in_its_scene(self, context: bpy.types.Context) -> Iterator[None]:
        """Inside, the window shows the scene in which the job was begun.

        Raises
        ------
        ReconstructionError
            The scene was deleted, or an editor would open unseen.
        """
        if context.scene.session_uid == self._scene:
            yield
            return
        home = next((s for s in bpy.data.scenes if s.session_uid == self._scene), None)
        if home is None:
            raise ReconstructionError(messages.SCENE_GONE)
        if self.opens_editor:
            raise ReconstructionError(messages.OTHER_SCENE.format(name=home.name))
        window = context.window
        now, layer = window.scene, window.view_layer
        window.scene = home
        try:
            yield
        finally:
            window.scene, window.view_layer = now, layer

    # Whether the user has left everything alone since the job began; otherwise the
    # result must not take selection, mode and view away.
    undisturbed = True

    def execute(self, context):
        try:
            request = self.begin_for(context)
            outcome = self.work(session.current().solver, request, None)
            self.deliver(context, request, outcome)
        except Exception as error:
            return self.failed(context, error, traceback.format_exc())
        return {"FINISHED"}

    def invoke(self, context, event):
        if bpy.app.background:
            return self.execute(context)
        return self.start(context)

    def start(self, context):
        """Start the job and go on as a modal operator."""
        try:
            self._request = self.begin_for(context)
        except Exception as error:
            return self.failed(context, error, traceback.format_exc())
        now = session.current()
        # The thread gets the function and the request, not the operator.
        now.start(functools.partial(type(self).work, now.solver, self._request))
        self._before, self._views = footprint(context), []
        begin(context)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        running = session.running()
        if running is None:
            end(context)
            return {"CANCELLED"}
        if event.type == "ESC" and event.value == "PRESS":
            running.cancel()
        elif event.type != "TIMER":
            return {"PASS_THROUGH"}
        if running.cancelled:
            # The worker stops at its next report; nobody waits for it.
            end(context)
            self.put_views_back(context)
            self.report({"INFO"}, messages.CANCELLED)
            return {"CANCELLED"}
        if running.poll():
            show_progress(context, running)
            self.show_estimate(context, running)
        if not running.finished:
            return {"PASS_THROUGH"}
        end(context)
        self.undisturbed = footprint(context) == self._before
        try:
            if running.error is not None:
                raise running.error
            with self.in_its_scene(context):
                self.deliver(context, self._request, running.result)
        except Exception as error:
            self.put_views_back(context)
            return self.failed(context, error, running.trace or traceback.format_exc())
        redraw(context)
        return {"FINISHED"}

    def show_estimate(self, context: bpy.types.Context, running: Job) -> None:
        """Draw the face as the job has it so far, where the result will be."""
        points, overlay = running.control_points, session.current().overlay
        if points is None or context.scene.session_uid != self._scene:
            return
        face, first = self.updated(context), overlay.estimate is None
        if face is None:
            frame = scene.frame_of_new(context, points, context.scene.bsface.size)
        else:
            frame = coordinates.world_frame(face)
        overlay.show(context, points, frame)
        if first and face is None and footprint(context) == self._before:
            # Views of a new file show metres; the face would be a dot in them.
            self._views = [
                camera_views.view_state(view) for view in view_areas.spaces(context)
            ]
            showing.look_at_front(context, *extent(points, frame))
            self._before = footprint(context)

    def put_views_back(self, context: bpy.types.Context) -> None:
        """Where there is no result: look from where the user did, if nobody moved."""
        if self._views and footprint(context) == self._before:
            for view, then in zip(view_areas.spaces(context), self._views, strict=True):
                camera_views.set_view(view, then)

    def cancel(self, context):
        """Blender stops the operator: another file is loaded, or it quits."""
        end(context)

    def failed(self, context, error, trace):
        """Report a failure in one sentence; the trace goes into the error block."""
        state = context.scene.bsface
        if isinstance(error, ReconstructionError):
            sentence = str(error)
            state.last_error = sentence
        elif isinstance(error, ImportError):
            sentence = messages.MISSING.format(missing=error.name or error)
            state.last_error = trace
        elif out_of_memory(error):
            sentence = messages.NO_MEMORY
            state.last_error = trace
        else:
            sentence = messages.UNEXPECTED.format(error=error)
            state.last_error = trace
        self.report({"ERROR"}, sentence)
        return {"CANCELLED"}


def footprint(context: bpy.types.Context) -> tuple:
    """What differs after a user has selected, changed or looked at something else."""
    layer, manager = context.view_layer, context.window_manager
    active = layer.objects.active
    return (
        context.scene.session_uid,
        None if active is None else (active.name, active.mode),
        [obj.name for obj in layer.objects if obj.select_get()],
        [camera_views.view_state(view) for view in view_areas.spaces(context)],
        [operator.as_pointer() for operator in manager.operators],
    )


def begin(context: bpy.types.Context) -> None:
    """Show in the cursor and the status bar that a job runs."""
    manager = context.window_manager
    session.current().timer = manager.event_timer_add(INTERVAL_S, window=context.window)
    manager.progress_begin(0, 100)


def end(context: bpy.types.Context) -> None:
    """Forget the job and take its progress off the screen; fine where none runs."""
    now = session.current()
    now.stop()
    now.overlay.clear(context)
    if now.timer is None:
        return
    manager = context.window_manager
    manager.event_timer_remove(now.timer)
    now.timer = None
    manager.progress_end()
    if context.workspace is not None:
        context.workspace.status_text_set(None)
    redraw(context)


def show_progress(context: bpy.types.Context, running: Job) -> None:
    """Progress in the cursor, the status bar and the sidebar."""
    if running.step is None:
        return
    context.window_manager.progress_update(100 * running.fraction)
    if context.workspace is not None:
        # A text would stay with its workspace after the user has gone to another one.
        context.workspace.status_text_set(draw_status)
    redraw(context)


def draw_status(header, context):
    """The status bar of a running job."""
    running = session.running()
    if running is not None:
        parts = (messages.progress_line(running), messages.time_left(running))
        text = ", ".join(part for part in parts if part) + "   Esc: stop"
        header.layout.label(text=text, translate=False)


def redraw(context: bpy.types.Context) -> None:
    """Redraw the sidebars of the 3D views, not the views: those are slow."""
    view_areas.redraw(context, "UI")
