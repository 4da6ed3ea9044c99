"""The light that the core estimated per photo, as suns.

Of a photo's nine spherical-harmonic coefficients the three of first order make the
sun: their direction is where the light comes from, their length its strength.
"""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Matrix, Vector

PHOTO_KEY = "bsface_photo"


def sun(coefficients):
    """Direction and strength of the sun nearest to a harmonic light.

    Parameters
    ----------
    coefficients : (9,) array
        Head frame; order 1, x, y, z, xy, xz, yz, x2-y2, 3z2-1.

    Returns
    -------
    direction : (3,) array
        Unit vector from the face to the light; +z where there is no direction.
    energy : float
        Blender's sun strength: a surface of albedo 1 facing the sun gets
        ``energy / pi``.
    """
    first = np.asarray(coefficients, float)[1:4]
    length = float(np.linalg.norm(first))
    if not length > 0:
        return np.array([0.0, 0.0, 1.0]), 0.0
    return first / length, math.pi * length


def add(face, name, coefficients, photo_name, collection):
    """Add one sun, switched off, as a child of the face."""
    direction, energy = sun(coefficients)
    data = bpy.data.lights.new(name, "SUN")
    data.energy = energy
    data.angle = math.radians(10)
    obj = bpy.data.objects.new(name, data)
    collection.objects.link(obj)
    unit = face.matrix_world.to_scale().x
    obj.parent = face
    obj.matrix_parent_inverse = Matrix.Scale(1 / unit, 4)
    towards = Vector(direction)
    # A sun shines along its local -z.
    obj.matrix_basis = Matrix.Translation(towards * 400 * unit) @ (
        towards.to_track_quat("Z", "Y").to_matrix().to_4x4()
    )
    obj[PHOTO_KEY] = photo_name
    switch(obj, False)
    return obj


def of_face(face):
    """The face's suns, in the order of their photos' names."""
    found = [obj for obj in face.children if obj.type == "LIGHT" and PHOTO_KEY in obj]
    return sorted(found, key=lambda obj: obj.name)


def switch(obj, on):
    """Show the sun and let it shine, or neither."""
    obj.hide_viewport = obj.hide_render = not on
