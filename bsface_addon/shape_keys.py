"""Control points with other numbers: shape keys and their animation go along."""

from __future__ import annotations

import bpy
import numpy as np

from ..core._types import Array
from ..core.errors import ReconstructionError
from ..core.surface.bspline import resampled_net
from . import messages, surface_object

# What the user sets of a key, besides its points.
KEPT = ("slider_min", "slider_max", "value", "mute")


def write(
    context: bpy.types.Context, obj: bpy.types.Object, control_points: Array
) -> None:
    """As `surface_object.write`, but a net of another size keeps the shape keys.

    Each key moves the new surface as it moved the old one.

    Parameters
    ----------
    control_points : (M, N, 3) array

    Raises
    ------
    ReconstructionError
        The keys are no finite numbers; nothing has changed.
    """
    old, count = obj.data.shape_keys, control_points.shape[:2]
    if old is None or surface_object.shape(obj) == count:
        surface_object.write(context, obj, control_points)
        return
    curve, index = obj.data, obj.active_shape_key_index
    blocks = [key for key in old.key_blocks if key != old.reference_key]
    basis = surface_object.read(obj)
    moved = [surface_object.read(obj, key.name) - basis for key in blocks]
    if not np.isfinite([basis, *moved]).all():
        raise ReconstructionError(messages.NO_NUMBERS.format(name=obj.name))
    # Blender would take the keys away with the old net.
    curve.use_fake_user, kept = True, curve.use_fake_user
    surface_object.write(context, obj, control_points)
    obj.shape_key_add(name=old.reference_key.name, from_mix=False)
    for key, move in zip(blocks, moved, strict=True):
        points = control_points + resampled_net(move, count)
        made = surface_object.add_shape_key(obj, key.name, points)
        for name in KEPT:
            setattr(made, name, getattr(key, name))
    obj.active_shape_key_index = index
    _keep_animation(old, obj.data.shape_keys)
    curve.use_fake_user = kept
    if curve.users == 0:
        name = curve.name
        bpy.data.curves.remove(curve)
        obj.data.name = name


def _keep_animation(old: bpy.types.Key, new: bpy.types.Key) -> None:
    """Let an action and drivers move the new keys."""
    before = old.animation_data
    if before is None:
        return
    now = new.animation_data_create()
    if before.action is not None:
        now.action = before.action
        now.action_slot = before.action_slot
    for driver in before.drivers:
        now.drivers.from_existing(src_driver=driver)
