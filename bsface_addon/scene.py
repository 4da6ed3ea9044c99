"""A reconstruction in the Blender scene: face, cameras, lights, material.

Everything is made on the main thread in one go (`place`), and either all of it
stands or nothing has changed (`all_or_nothing`).
"""

from __future__ import annotations

import contextlib
import json

import bpy
import numpy as np
from mathutils import Matrix

from ..core._types import Array
from . import (
    cameras,
    coordinates,
    face_file,
    lights,
    material,
    photo_expression,
    renewal,
    rig,
    selection,
    shape_keys,
    surface_object,
)
from .solving import Outcome

# On a face object.
MARK = "bsface"
# On a coarse net that is edited: its face.
COARSE_OF = "bsface_coarse_of"
_KINDS = (
    "objects",
    "curves",
    "cameras",
    "lights",
    "materials",
    "images",
    "collections",
    "meshes",
    "shape_keys",
    "texts",
)


def place(
    context: bpy.types.Context,
    outcome: Outcome,
    name: str,
    *,
    face: bpy.types.Object | None = None,
    scale: float = 1.0,
    select: bool = True,
) -> bpy.types.Object:
    """Put a reconstruction into the scene.

    Parameters
    ----------
    outcome : Outcome
    name : str
        Name of a new face; its collection is called ``BSface <name>``.
    face : bpy.types.Object, optional
        A face made earlier: it is updated in place (its own name, matrix and
        materials stay), and so are the cameras and lights of its photos.
    scale : float
        Size of a new face; 1 is life size.
    select : bool
        Make the face active and the only selected object, in object mode; otherwise
        mode, selection and active object stay as they are.

    Returns
    -------
    bpy.types.Object
        The face. A new one stands beside those that are there.
    """
    result, maps = outcome.result, outcome.maps
    with all_or_nothing(context), selection.object_mode(context):
        points = result.surface.control_points
        old = [] if face is None else [*cameras.of_face(face), *lights.of_face(face)]
        fresh = face is None
        if fresh:
            face = surface_object.create(context, name, points, scale)
            face.location.x = _free_place(context, *_extent(face))
            face[MARK] = True
            own = _collection(context, face)
            _move(face, own)
        else:
            own = _home(context, face)
        context.view_layer.update()
        parent = rig.ensure(face, own)
        made = [
            *_add_cameras(face, parent, outcome, own),
            *_add_lights(face, parent, result, own),
        ]
        material.own(face, (o for o in bpy.data.objects if o != face and is_face(o)))
        for kind, found in maps.items():
            material.store_map(face, kind, found)
        material.drop_others(face, maps)
        if fresh or material.shown(face) == "PLAIN":
            material.show(face, "SKIN" if "SKIN" in maps else "PLAIN")
        _write_facts(face, outcome)
        if not fresh:
            shape_keys.write(context, face, points)
            made = renewal.renewed(context, face, old, made)
        rig.note(parent, made)
    if select:
        selection.leave_edit_mode(context)
        selection.select_only(context, face)
    return face


def frame_of_new(
    context: bpy.types.Context, control_points: Array, scale: float
) -> Matrix:
    """From the core's axes and millimetres to the scene, for a face before `place`.

    Parameters
    ----------
    control_points : (M, N, 3) array
    scale : float
        As in `place`.
    """
    unit = coordinates.units_per_mm(context, scale)
    x = unit * control_points[..., 0]
    place = _free_place(context, float(x.min()), float(x.max()))
    return (
        Matrix.Translation((place, 0, 0)) @ coordinates.UPRIGHT @ Matrix.Scale(unit, 4)
    )


def faces(context):
    """Faces of the scene that this add-on made, by name."""
    found = [obj for obj in context.scene.objects if is_face(obj)]
    return sorted(found, key=lambda obj: obj.name)


def is_face(obj):
    """Whether the object is a face that `place` made and that is still a surface."""
    return obj is not None and bool(obj.get(MARK)) and surface_object.is_surface(obj)


def is_own(face: bpy.types.Object) -> bool:
    """Whether this file holds the face; what is done to a linked one is not saved."""
    return face.is_editable and face.data.is_editable


def active_face(context):
    """The face that the buttons mean: the active one, or the scene's latest."""
    active = context.view_layer.objects.active
    if is_face(active):
        return active
    home = None
    if active is not None:
        home = active.get(COARSE_OF) or rig.face_of(active)
    if is_face(home):
        return home
    chosen = getattr(context.scene, "bsface", None)
    if chosen is None or not is_face(chosen.face):
        return None
    # The property keeps a deleted object alive outside the scene.
    return chosen.face if chosen.face.name in context.scene.objects else None


def face_with(context, number):
    """The face of the scene with Blender's own number (`session_uid`), or None."""
    return next(
        (f for f in context.scene.objects if f.session_uid == number and is_face(f)),
        None,
    )


def stored(face, key, default):
    """A JSON fact of a face; the default where it is none of the default's kind."""
    try:
        fact = json.loads(face[key])
    except (KeyError, TypeError, ValueError, RecursionError):
        return default
    known = default is None or isinstance(fact, type(default))
    return fact if known else default


@contextlib.contextmanager
def all_or_nothing(context):
    """On an exception: new data goes, active object, selection and mode come back."""
    before = {kind: {d.session_uid for d in getattr(bpy.data, kind)} for kind in _KINDS}
    chosen = selection.current(context)
    camera = context.scene.camera
    try:
        yield
    except BaseException:
        selection.leave_edit_mode(context)
        # An object goes with its data: a face keeps the net that it has now.
        old = [o for o in bpy.data.objects if o.session_uid in before["objects"]]
        kept = {obj.data for obj in old}
        kept |= {getattr(data, "shape_keys", None) for data in kept}
        bpy.data.batch_remove(
            [
                data
                for kind in _KINDS
                for data in getattr(bpy.data, kind)
                if data.session_uid not in before[kind] and data not in kept
            ]
        )
        context.scene.camera = camera
        selection.restore(context, chosen)
        raise


def _free_place(context: bpy.types.Context, left: float, right: float) -> float:
    """Where along x a face of this extent is clear of the others; 0 for the first."""
    ends = [_extent(other) for other in faces(context)]
    if not ends:
        return 0.0
    return max(end for _, end in ends) - left + 0.2 * (right - left)


def _extent(face: bpy.types.Object) -> tuple[float, float]:
    """The least and the largest x of a face's control points in the scene."""
    points = surface_object.read(face).reshape(-1, 3)
    frame = np.array(coordinates.world_frame(face))
    x = points @ frame[0, :3] + frame[0, 3]
    return float(x.min()), float(x.max())


def _add_cameras(face, parent, outcome, own):
    result, made = outcome.result, []
    if not result.cameras:
        return made
    group = _child_collection(own, "cameras")
    for camera, photo in zip(result.cameras, result.photos, strict=True):
        turn = outcome.turns.get(photo.name)
        view = cameras.add(
            parent, f"{face.name} {photo.name}", camera, photo, turn, group
        )
        if photo.name in outcome.skin:
            view[cameras.SKIN_KEY] = outcome.skin[photo.name]
        made.append(view)
    return made


def _add_lights(face, parent, result, own):
    if result.photometric is None:
        return []
    group = _child_collection(own, "lights")
    found = zip(result.photometric.lights, result.photos, strict=True)
    return [
        lights.add(
            parent, f"{face.name} light {photo.name}", coefficients, photo.name, group
        )
        for coefficients, photo in found
    ]


def _write_facts(face, outcome):
    for name, text in outcome.facts.items():
        face[name] = text
    face_file.keep(face, outcome.file)
    photo_expression.keep(face, outcome.result)


def _collection(context, face):
    collection = bpy.data.collections.new(f"BSface {face.name}")
    collection[MARK] = "face"
    context.scene.collection.children.link(collection)
    return collection


def _home(context, face):
    for collection in face.users_collection:
        return collection
    return context.scene.collection


def _child_collection(own, what):
    for child in own.children:
        if child.get(MARK) == what:
            return child
    child = bpy.data.collections.new(f"{own.name} {what}")
    child[MARK] = what
    own.children.link(child)
    return child


def _move(obj, collection):
    for other in obj.users_collection:
        other.objects.unlink(obj)
    collection.objects.link(obj)
