"""Which shape keys the add-on has made, and whether they are still as it made them.

A key that the user made or changed by hand is not overwritten.  What is remembered are
a few sums over a key's movements, on Blender's block of the keys: they hold through a
new basis, which all keys follow.
"""

from __future__ import annotations

import json

import bpy
import numpy as np

from ..core.errors import ReconstructionError
from . import messages, photo_expression, surface_object

# On the block of the keys: name -> kind and sums, JSON.
MADE = "bsface_made"
BASIS = "Neutral"
EXPRESSION, ARKIT = "expression", "arkit"
#: Sums that differ by less are equal but for float32, mm and mm2.
ROUNDING = 0.05


def check_word(face: bpy.types.Object, word: str) -> None:
    """Refuse a word that cannot name the shape key of an expression.

    Raises
    ------
    ReconstructionError
        The add-on needs the name itself, or the key is not one of an expression.
    """
    keys = face.data.shape_keys
    reserved = {BASIS, photo_expression.KEY}
    if keys is not None:
        reserved.add(keys.reference_key.name)
    if word in reserved:
        raise ReconstructionError(messages.RESERVED_WORD.format(name=word))
    there = keys is not None and word in keys.key_blocks
    if there and _kind(keys, word) != EXPRESSION:
        raise ReconstructionError(messages.KEY_IS_THERE.format(name=word))


def is_changed(face: bpy.types.Object, name: str, kind: str) -> bool:
    """Whether a key of this name is there that is not as the add-on made it."""
    keys = face.data.shape_keys
    if keys is None or name not in keys.key_blocks:
        return False
    if _kind(keys, name) != kind:
        return True
    now, then = _sums(face, name), np.array(_made(keys)[name][1])
    return now.shape != then.shape or not np.allclose(now, then, rtol=0, atol=ROUNDING)


def remember(face: bpy.types.Object, name: str, kind: str) -> None:
    """Note that the add-on has made a key, as it is now."""
    keys = face.data.shape_keys
    made = _made(keys) | {name: [kind, _sums(face, name).round(4).tolist()]}
    keys[MADE] = json.dumps({n: row for n, row in made.items() if n in keys.key_blocks})


def of_kind(face: bpy.types.Object, kind: str) -> list[bpy.types.ShapeKey]:
    """Keys that the add-on has made, changed since or not."""
    keys = face.data.shape_keys
    return [key for key in keys.key_blocks if _kind(keys, key.name) == kind]


def unchanged(face: bpy.types.Object) -> dict[str, str]:
    """Keys that are as the add-on made them, with their kinds."""
    made = {name: row[0] for name, row in _made(face.data.shape_keys).items()}
    there = face.data.shape_keys.key_blocks
    return {n: k for n, k in made.items() if n in there and not is_changed(face, n, k)}


def _kind(keys: bpy.types.Key, name: str) -> str:
    return _made(keys).get(name, [""])[0]


def _made(keys: bpy.types.Key) -> dict[str, list]:
    """What is remembered; the user may have written anything there."""
    try:
        found = json.loads(keys[MADE])
        return {
            name: [kind, [float(value) for value in sums]]
            for name, (kind, sums) in found.items()
            if isinstance(kind, str)
        }
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError):
        return {}


def _sums(face: bpy.types.Object, name: str) -> np.ndarray:
    """Sums of a key's movements along the axes, and of their squares."""
    moved = surface_object.read(face, name) - surface_object.read(face)
    moved = moved.reshape(-1, 3)
    return np.concatenate([moved.sum(axis=0), (moved**2).sum(axis=0)])
