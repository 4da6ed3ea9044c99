"""What the command line tells while it works."""

from __future__ import annotations

import sys
import time


class Console:
    """Progress on stderr: a bar where somebody watches, a line per stage elsewhere."""

    def __init__(self, quiet):
        self.quiet = quiet
        self.bar = sys.stderr.isatty()
        self.stage = None
        self.started = time.monotonic()

    def __call__(self, step):
        if self.quiet:
            return
        if step.stage != self.stage:
            self.close()
            self.stage, self.started = step.stage, time.monotonic()
        if self.bar:
            part = step.done / max(step.total, 1)
            filled = round(24 * part)
            line = f"\r{step.stage:>10} [{'#' * filled:24}] {step.message[:40]:40}"
            _write(line)
        self.message = step.message

    def close(self):
        """End the line of the stage that ran."""
        if self.stage is not None and not self.quiet:
            seconds = time.monotonic() - self.started
            start = "\r" if self.bar else ""
            text = f"{start}{self.stage:>10} {seconds:6.1f} s  {self.message[:60]:60}"
            _write(text + "\n")
        self.stage = None

    def say(self, text):
        """One line for people."""
        if not self.quiet:
            _write(text + "\n")


def _write(text):
    sys.stderr.write(text)
    sys.stderr.flush()
