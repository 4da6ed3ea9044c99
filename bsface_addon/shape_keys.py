"""Control points with other numbers: shape keys go along."""

from __future__ import annotations

import bpy
import numpy as np

from ..core._types import Array
from ..core.errors import ReconstructionError
from ..core.surface.bspline import resampled_net
from . import attachments, made_keys, messages, surface_object


def write(
    context: bpy.types.Context, obj: bpy.types.Object, control_points: Array
) -> None:
    """As `surface_object.write`, but a net of another size keeps the shape keys.

    Each key moves the new surface as it moved the old one.  What hangs on control
    points goes along, see `attachments`.

    Parameters
    ----------
    control_points : (M, N, 3) array

    Raises
    ------
    ReconstructionError
        The keys are no finite numbers; nothing has changed.
    """
    keys, count = obj.data.shape_keys, control_points.shape[:2]
    if surface_object.shape(obj) == count:
        surface_object.write(context, obj, control_points)
        return
    if keys is None:
        with attachments.carried(context, obj):
            surface_object.write(context, obj, control_points)
        return
    blocks = [key for key in keys.key_blocks if key != keys.reference_key]
    basis = surface_object.read(obj)
    moved = [surface_object.read(obj, key.name) - basis for key in blocks]
    if not np.isfinite([basis, *moved]).all():
        raise ReconstructionError(messages.NO_NUMBERS.format(name=obj.name))
    ours = made_keys.unchanged(obj)
    with attachments.carried(context, obj):
        surface_object.resize(context, obj, count)
        surface_object.write(context, obj, control_points)
    for key, move in zip(blocks, moved, strict=True):
        points = control_points + resampled_net(move, count)
        surface_object.add_shape_key(obj, key.name, points)
    for name, kind in ours.items():
        made_keys.remember(obj, name, kind)
