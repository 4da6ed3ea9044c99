"""The photo list of the panel: rows in, rows out, and what a run said of each."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import bpy


def add(state, paths):
    """Add photos that are not in the list yet; how many were added."""
    present = {absolute(row) for row in state.photos}
    before = len(state.photos)
    for path in paths:
        path = Path(path)
        if path in present:
            continue
        present.add(path)
        row = state.photos.add()
        row.path = str(path)
    rename(state)
    return len(state.photos) - before


def replace(state, paths):
    """Make the list that of a run over other photos."""
    state.photos.clear()
    add(state, paths)


def rename(state):
    """Give each row the name that the core will give its photo."""
    names = [absolute(row).name for row in state.photos]
    count, taken = Counter(names), Counter()
    for row, name in zip(state.photos, names, strict=True):
        if count[name] > 1:
            taken[name] += 1
            name = f"{name} ({taken[name]})"
        row.name = name


def absolute(row):
    """The row's file, whether stored relative to the .blend or not."""
    return Path(bpy.path.abspath(row.path))


def paths(state):
    """Files of all rows, in the list's order."""
    return tuple(absolute(row) for row in state.photos)


def ignored(state):
    """Names of the rows whose box is not ticked."""
    return tuple(row.name for row in state.photos if not row.use)


def take_reports(state, reports):
    """Write status, reason and pose of a run's report into the rows."""
    rows = {row.name: row for row in state.photos}
    for report in reports:
        row = rows.get(report.name)
        if row is None:
            continue
        row.status, row.reason = report.status, report.reason
        row.yaw = report.yaw or 0.0


def take_failures(state, failures):
    """Write the failures of a detection into the rows."""
    rows = {row.name: row for row in state.photos}
    for failure in failures:
        if failure.name in rows:
            rows[failure.name].status = failure.code
            rows[failure.name].reason = failure.reason


def counts(state):
    """How many rows there are, are ticked, have failed, and shape the face."""
    rows = [row for row in state.photos if row.use]
    fine = ("waiting", "found", "used")
    return {
        "all": len(state.photos),
        "use": len(rows),
        "failed": sum(row.status not in fine for row in rows),
        "used": sum(row.status == "used" for row in rows),
    }
