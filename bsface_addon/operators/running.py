"""How an operator with long core work runs: straight through, or beside the UI.

`LongOperator` is mixed into operators that define ``prepare(context)`` -> request
and ``deliver(context, request, outcome)``, both on the main thread, and
``solve(request, progress)``, a static function of core code only.
"""

from __future__ import annotations

import functools
import traceback

import bpy

from ...core.errors import Cancelled, ReconstructionError, out_of_memory
from .. import job, messages, pipeline

INTERVAL_S = 0.1
# Of the running job; here and not on the operator, because Blender drops the operator
# without a word when the add-on is disabled.
_timer = None


class LongOperator:
    """``execute`` runs straight through; ``invoke`` runs beside the UI (see `job`)."""

    solve = staticmethod(pipeline.solve)

    def execute(self, context):
        try:
            request = self.prepare(context)
            self.deliver(context, request, type(self).solve(request, None))
        except Exception as error:
            return self.failed(context, error, traceback.format_exc())
        return {"FINISHED"}

    def invoke(self, context, event):
        if bpy.app.background:
            return self.execute(context)
        try:
            self._request = self.prepare(context)
        except Exception as error:
            return self.failed(context, error, traceback.format_exc())
        # The thread gets the function and the request, not the operator.
        job.start(functools.partial(type(self).solve, self._request), Cancelled)
        begin(context)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        running = job.current()
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
            self.report({"INFO"}, messages.CANCELLED)
            return {"CANCELLED"}
        if running.poll():
            show_progress(context, running)
        if not running.finished:
            return {"PASS_THROUGH"}
        end(context)
        try:
            if running.error is not None:
                raise running.error
            self.deliver(context, self._request, running.result)
        except Exception as error:
            return self.failed(context, error, running.trace or traceback.format_exc())
        return {"FINISHED"}

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


def begin(context):
    """Show in the cursor and the status bar that a job runs."""
    global _timer
    manager = context.window_manager
    _timer = manager.event_timer_add(INTERVAL_S, window=context.window)
    manager.progress_begin(0, 100)


def end(context):
    """Forget the job and take its progress off the screen; fine where none runs."""
    global _timer
    job.end()
    if _timer is None:
        return
    manager = context.window_manager
    manager.event_timer_remove(_timer)
    _timer = None
    manager.progress_end()
    if context.workspace is not None:
        context.workspace.status_text_set(None)
    redraw(context)


def show_progress(context, running):
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
    running = job.current()
    if running is not None:
        text = messages.progress_line(running) + "   Esc: stop"
        header.layout.label(text=text, translate=False)


def redraw(context):
    """Redraw the sidebars of the 3D views, not the views: those are slow."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()
