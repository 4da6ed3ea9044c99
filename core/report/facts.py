"""The facts of a result as plain values: the one JSON of bsface.

The command line (``--json``), the page (``.json`` beside it), the batch
(``result.json`` per person) and Blender's command print or write what `result_facts`
returns; ``docs/result.schema.json`` describes it.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import PhotoFailure
from ..json_text import plain
from ..result import PhotoReport, Reconstruction
from ..versions import VERSION, library_versions

#: Version of the JSON; it grows when a key goes or changes its meaning.
SCHEMA = 1


def result_facts(
    face: Reconstruction,
    *,
    title: str = "",
    files: Sequence[str | os.PathLike] = (),
    timings: bool = True,
) -> dict[str, Any]:
    """Everything about a result that is not a picture or an array of points.

    Parameters
    ----------
    face : Reconstruction
    title : str
        Name of the person or the folder; by default that of the photos' folder.
    files : sequence of path-like
        All files that were written.
    timings : bool
        False leaves out what differs between two equal runs.

    Returns
    -------
    dict
        Valid against ``docs/result.schema.json`` once it is JSON.
    """
    reports = plain(face.reports)
    used = [row for row in reports if row["status"] == "used"]
    facts: dict[str, Any] = {
        "schema": SCHEMA,
        "ok": True,
        "program": "bsface",
        "versions": versions(),
        "title": title or folder_name(face),
        "files": [os.fspath(path) for path in files],
        "photos": {"all": len(reports), "used": face.used},
        "control_points": list(face.surface.shape),
        "residuals": {
            "reprojection_pct": _median([row["reprojection_pct"] for row in used]),
            "intensity": _median([row["residual"] for row in used]),
        },
        "settings": face.settings.to_dict(),
        "report": reports,
        "warnings": list(face.warnings),
        "history": [step._asdict() for step in face.history],
        "cameras": [
            {"photo": photo.name, **plain(camera)}
            for photo, camera in zip(face.photos, face.cameras, strict=True)
        ],
    }
    light = face.photometric
    if light is not None and light.singular_values is not None:
        values = np.asarray(light.singular_values, float)
        energy = np.cumsum(values**2) / max(float((values**2).sum()), 1e-30)
        facts["singular_values"] = values
        facts["rank_4_share"] = float(energy[min(3, len(energy) - 1)])
    if face.deviation is not None:
        facts["confidence_mm"] = {
            "median": float(np.median(face.deviation)),
            "worst": float(np.max(face.deviation)),
        }
    if timings and face.seconds:
        facts["seconds"] = dict(face.seconds)
    return facts


def failure_facts(sentence: str, photos: Sequence[PhotoFailure] = ()) -> dict[str, Any]:
    """The JSON of a job that failed, with the photos for which it did."""
    return {
        "schema": SCHEMA,
        "ok": False,
        "program": "bsface",
        "error": sentence,
        "report": [plain(PhotoReport(p.name, p.code, p.reason)) for p in photos],
    }


def folder_name(face: Reconstruction) -> str:
    """Name of the folder that the photos came from, "" if they came as arrays."""
    for photo in face.photos:
        if photo.path is not None and Path(photo.path).parent.name:
            return Path(photo.path).parent.name.replace("_", " ")
    return ""


def versions() -> dict[str, str]:
    """Versions that a rerun needs."""
    return {"bsface": VERSION, **library_versions()}


def _median(values: list[float | None]) -> float | None:
    finite = [v for v in values if v is not None]
    return float(np.median(finite)) if finite else None
