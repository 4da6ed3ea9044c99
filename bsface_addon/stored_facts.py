"""What a face object keeps of its run, as texts for its custom properties.

No Blender in here: the thread that solves writes them.  JSON, so that they read the
same in every version and outside Blender.
"""

from __future__ import annotations

import json

import numpy as np

from ..core.json_text import to_json
from ..core.landmarks.landmarks import Landmarks
from ..core.result import Reconstruction

# Names of the custom properties.
SETTINGS = "bsface_settings"
REPORT = "bsface_report"
PHOTOS = "bsface_photos"
WARNINGS = "bsface_warnings"
QUALITY = "bsface_quality"


def facts(result: Reconstruction) -> dict[str, str]:
    """Custom properties by name."""
    photos = [{"name": p.name, "path": p.path, "size": p.size} for p in result.photos]
    return {
        SETTINGS: to_json(result.settings.to_dict()),
        REPORT: to_json(list(result.reports)),
        QUALITY: to_json(quality_facts(result)),
        WARNINGS: to_json(list(result.warnings)),
        PHOTOS: to_json(photos),
    }


def quality_facts(result: Reconstruction) -> dict[str, float | int | None]:
    """What says how good a face can be.

    Returns
    -------
    dict
        ``used`` and ``photos``: numbers of photos; ``deviation_mm``: median standard
        deviation inside the outline, None where it is not known; ``eyes_px``: median
        distance between the eyes in the used photos, in pixels.
    """
    deviation = None
    if result.deviation is not None:
        # The outermost control points act on the border.
        m, n = result.surface.shape
        u, v = (np.clip((np.arange(k) - 1) / (k - 3), 0, 1) for k in (m, n))
        grid = np.stack(np.meshgrid(u, v, indexing="ij"), -1)
        inside = result.template.inside(grid)
        deviation = float(np.median(result.deviation[inside]))
    sizes = [camera.s for camera in result.cameras]
    return {
        "used": len(result.photos),
        "photos": len(result.reports),
        "deviation_mm": deviation,
        "eyes_px": float(np.median(sizes)) * result.settings.eye_distance_mm,
    }


def landmark_text(found: Landmarks) -> str:
    """Landmarks of a photo; the digits that matter keep the file small."""
    return json.dumps(
        {
            "scheme": found.scheme,
            "points": found.points.round(3).tolist(),
            "weight": found.weight.round(4).tolist(),
            "source": found.source,
            "score": float(found.score),
            "faces": int(found.faces),
            "note": found.note,
        }
    )
