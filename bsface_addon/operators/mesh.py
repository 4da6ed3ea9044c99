"""What others animate: a mesh of the face or of the whole head, and the ARKit keys."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
from bpy.props import BoolProperty, EnumProperty

from ...core.rig.arkit import arkit_keys
from ...core.rig.head import full_head
from ...core.rig.mesh import quad_mesh
from .. import (
    coordinates,
    face_file,
    made_keys,
    maps,
    material,
    mesh_copy,
    messages,
    photo_expression,
    scene,
    selection,
    surface_object,
)
from ..face_file import StoredFace
from .running import LongOperator
from .surface import ChangingOperator

DENSITY = EnumProperty(
    name="Density",
    items=(
        ("LOW", "Low", "About 2,500 quads"),
        ("MEDIUM", "Medium", "About 10,000 quads"),
        ("HIGH", "High", "About 40,000 quads"),
    ),
    default="MEDIUM",
)
OPENINGS = BoolProperty(
    name="Eyes and Mouth",
    description="Lid openings with eyeballs, and an open line between the lips",
    default=True,
)
KEYS = BoolProperty(
    name="ARKit Keys",
    description="The 52 ARKit expressions as shape keys",
    default=True,
)


@dataclass(frozen=True)
class MeshRequest:
    """A mesh of a face, in an object with so many units per millimetre."""

    face: StoredFace
    density: str
    openings: bool
    keys: bool
    unit: float | None


class BSFACE_OT_surface_to_mesh(ChangingOperator, LongOperator, bpy.types.Operator):
    """Make a mesh of quads with UVs, the same material and keys; the surface stays"""

    bl_idname = "bsface.surface_to_mesh"
    bl_label = "Convert to Mesh"
    bl_options = {"UNDO"}
    edits = False

    density: DENSITY
    openings: OPENINGS
    keys: KEYS

    def prepare(self, context):
        face = scene.active_face(context)
        return MeshRequest(
            face_file.stored(face),
            self.density.lower(),
            self.openings,
            self.keys,
            face.get(coordinates.UNIT_KEY),
        )

    @staticmethod
    def work(solver, request, progress):
        made = quad_mesh(
            request.face.read(),
            request.density,
            eyes=request.openings,
            mouth=request.openings,
            keys=request.keys,
        )
        return mesh_copy.local_mesh(made, request.unit)

    def deliver(self, context, request, outcome):
        face = self.kept(context)
        with scene.all_or_nothing(context):
            made = mesh_copy.add(face, outcome)
        self.report({"INFO"}, messages.MESH.format(count=len(made.data.polygons)))


@dataclass(frozen=True)
class HeadRequest:
    """A head of a face.

    Attributes
    ----------
    face : StoredFace
    density : str
    keys : bool
    picture, detail : bytes
        Packed files of the face's skin and of its normal map; empty for none.
    unit : float or None
        The object's units per millimetre.
    """

    face: StoredFace
    density: str
    keys: bool
    picture: bytes
    detail: bytes
    unit: float | None


class BSFACE_OT_full_head(ChangingOperator, LongOperator, bpy.types.Operator):
    """Make a mesh of the whole head, with ears, skull and neck; the surface stays"""

    bl_idname = "bsface.full_head"
    bl_label = "Make Full Head"
    bl_options = {"UNDO"}
    edits = False

    density: DENSITY
    keys: KEYS

    def prepare(self, context):
        face = scene.active_face(context)
        return HeadRequest(
            face_file.stored(face),
            self.density.lower(),
            self.keys,
            picture=material.packed_map(face, "SKIN"),
            detail=material.packed_map(face, material.DETAIL),
            unit=face.get(coordinates.UNIT_KEY),
        )

    @staticmethod
    def work(solver, request, progress):
        face = request.face.read()
        head = full_head(face, request.density, keys=request.keys)
        picture, detail = request.picture, request.detail
        if picture:
            picture = maps.head(picture, face.template)
        if detail:
            detail = maps.head(detail, face.template, detail=True)
        return mesh_copy.local_mesh(head, request.unit), picture, detail

    def deliver(self, context, request, outcome):
        face = self.kept(context)
        head, picture, detail = outcome
        with scene.all_or_nothing(context):
            skin = mesh_copy.head_skin(face, picture, detail)
            made = mesh_copy.add(face, head, "head", skin)
        self.report({"INFO"}, messages.HEAD.format(count=len(made.data.polygons)))


class BSFACE_OT_arkit_keys(ChangingOperator, LongOperator, bpy.types.Operator):
    """Add the 52 ARKit expressions as shape keys, scaled to this person"""

    bl_idname = "bsface.arkit_keys"
    bl_label = "Add ARKit Keys"
    bl_options = {"UNDO"}

    def prepare(self, context):
        return face_file.stored(scene.active_face(context))

    @staticmethod
    def work(solver, request, progress):
        return arkit_keys(request.read())

    def deliver(self, context, request, outcome):
        face = self.kept(context)
        with scene.all_or_nothing(context), selection.object_mode(context):
            photo_expression.hide(face)
            # On the net as it is now: it may have been edited meanwhile.
            neutral = surface_object.read(face)
            kept = [
                name
                for name in outcome
                if made_keys.is_changed(face, name, made_keys.ARKIT)
            ]
            for name, moved in outcome.items():
                if name not in kept:
                    surface_object.add_shape_key(face, name, neutral + moved)
                    made_keys.remember(face, name, made_keys.ARKIT)
        count = len(outcome) - len(kept)
        self.report({"INFO"}, messages.keys_added(count, len(kept)))


CLASSES = (BSFACE_OT_surface_to_mesh, BSFACE_OT_full_head, BSFACE_OT_arkit_keys)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
