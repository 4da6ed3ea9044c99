"""The face with the expression of the photo that one looks at.

The face is calm; where the photos differ in expression, each is seen through its own
mixture of the template's expression modes.  While one looks through a photo's camera a
shape key shows that mixture, so that the surface lies over the photo; it goes when one
leaves the cameras.
"""

from __future__ import annotations

import json

import numpy as np

from ..core.json_text import to_json
from ..core.solve.expression import expression_displacements
from ..core.surface.alignment import relative_size
from ..core.surface.template import load_template
from . import face_file, surface_object

KEY = "As in Photo"
# On the face object: photo -> coefficients of the expression modes, JSON.
STORED = "bsface_expressions"
# Coefficients below this move nothing that one could see; they are in standard
# deviations.
FAINT = 1e-3


def keep(face, result):
    """Store the expressions of a run's photos; nothing where they share one."""
    found = {}
    for photo, mixture in zip(result.photos, result.expressions, strict=True):
        if abs(mixture).max(initial=0.0) > FAINT:
            found[photo.name] = mixture.round(4).tolist()
    face.pop(STORED, None)
    if found:
        face[STORED] = to_json(found)


def show(face, photo):
    """Give the face the expression of a photo, or none where it is calm."""
    mixture = _mixture(face, photo)
    # In edit mode Blender shows the basis, and keys cannot be written.
    if mixture is None or face.mode == "EDIT":
        hide(face)
        return
    surface_object.add_shape_key(face, KEY, _points(face, mixture)).value = 1.0


def hide(face):
    """The calm face again."""
    keys = face.data.shape_keys
    if keys is None or KEY not in keys.key_blocks:
        return
    if face.mode == "EDIT":
        keys.key_blocks[KEY].value = 0.0
        return
    face.shape_key_remove(keys.key_blocks[KEY])
    if len(face.data.shape_keys.key_blocks) == 1:
        # Only the basis is left, and `show` made it.
        surface_object.remove_shape_keys(face)


def _mixture(face, photo):
    """Coefficients of a photo, or None; the user may write anything there."""
    try:
        found = np.array(json.loads(face[STORED])[photo], float)
    except (KeyError, TypeError, ValueError, RecursionError):
        return None
    known = found.shape == (len(load_template().expression_modes),)
    return found if known and np.isfinite(found).all() else None


def _points(face, mixture):
    surface = face_file.surface(face)
    template = load_template().resampled(surface.shape)
    size = relative_size(surface, template)
    (moved,) = expression_displacements(template, mixture[None], size)
    return surface.control_points + moved
