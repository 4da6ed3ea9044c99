"""What an operator cannot do, as one sentence in the status bar."""

from __future__ import annotations

import functools
from collections.abc import Callable

import bpy

from ...core.errors import ReconstructionError

Execute = Callable[[bpy.types.Operator, bpy.types.Context], set[str]]


def refusals_reported(execute: Execute) -> Execute:
    """Let an operator's ``execute`` report a `ReconstructionError` and cancel."""

    @functools.wraps(execute)
    def reporting(self: bpy.types.Operator, context: bpy.types.Context) -> set[str]:
        try:
            return execute(self, context)
        except ReconstructionError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}

    return reporting
