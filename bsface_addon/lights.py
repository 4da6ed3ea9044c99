"""The light that the core estimated per photo, as suns.

Of a photo's nine spherical-harmonic coefficients the three of first order make the
sun: their direction is where the light comes from, their length its strength.
"""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Matrix, Vector

from . import rig
from .rig import PHOTO_KEY

# Where a sun is drawn; its light does not depend on it.
DISTANCE_MM = 400.0


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
    # A sun of strength E shades with E/pi max(0, cos), whose part of first order is
    # E/pi cos / 2.
    return first / length, 2 * math.pi * length


def add(parent, name, coefficients, photo_name, collection):
    """Add one sun, switched off; it moves together with the face of its rig."""
    direction, energy = sun(coefficients)
    data = bpy.data.lights.new(name, "SUN")
    data.energy = energy
    data.angle = math.radians(10)
    obj = bpy.data.objects.new(name, data)
    collection.objects.link(obj)
    towards = Vector(direction)
    # A sun shines along its local -z.
    turn = towards.to_track_quat("Z", "Y").to_matrix().to_4x4()
    rig.attach(obj, parent, Matrix.Translation(towards * DISTANCE_MM) @ turn)
    obj[PHOTO_KEY] = photo_name
    switch(obj, False)
    return obj


def of_face(face):
    """The face's suns, in the order of their photos' names."""
    return rig.members(face, "LIGHT")


def switch(obj, on):
    """Show the sun and let it shine, or neither."""
    obj.hide_viewport = obj.hide_render = not on


def renew(old, new):
    """Give a sun the strength that a newer run found."""
    if old.data.users > 1:  # a copy that the user made keeps its own
        old.data = old.data.copy()
    old.data.energy = new.data.energy
