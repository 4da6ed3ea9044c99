"""Progress on the terminal."""

from __future__ import annotations

import sys

from ..errors import one_line
from ..progress import Step
from .terminal import tell


class Bar:
    """One line a stage, rewritten as it fills; finished stages only in a log file."""

    def __init__(self) -> None:
        self.stage = ""
        self.live = sys.stderr is not None and sys.stderr.isatty()

    def __call__(self, step: Step) -> None:
        new = step.stage != self.stage
        last = step.done >= step.total
        if not (self.live or last):
            return
        if new and self.stage and self.live:
            tell("\n")
        self.stage = step.stage
        full = round(24 * step.done / max(step.total, 1))
        bar = "#" * full + "." * (24 - full)
        message = one_line(step.message)
        line = f"{step.stage:<10} [{bar}] {step.done}/{step.total}  {message}"
        end = "" if self.live else "\n"
        tell(("\r\x1b[2K" if self.live else "") + line[:110] + end)

    def close(self) -> None:
        """End the line that is being rewritten."""
        if self.live and self.stage:
            tell("\n")
