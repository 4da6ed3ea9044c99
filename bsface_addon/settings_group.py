"""The core's `Settings` as Blender properties: made from the dataclass, not copied.

Defaults, limits and the sentences of the tooltips come from `core.settings`.  The one
field that Blender cannot hold as it is, the pair ``control_points``, becomes
``control_points_u`` and ``control_points_v``.
"""

from __future__ import annotations

import dataclasses
import inspect
import re

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty

from ..core.settings import LIMITS, METHODS, SCHEMES, Settings

LABELS = {
    "eye_distance_mm": "Eye Distance (mm)",
    "distance_mm": "Camera Distance (mm)",
    "detector": "Detect Faces",
    "one_person": "One Person",
    "landmark_offset_mm": "Landmark Offset (mm)",
    "landmark_noise_mm": "Landmark Noise (mm)",
    "modes": "Identity Modes",
    "smooth_mm": "Smoothness (mm)",
    "smooth_length": "Smoothness Length",
    "light_degree": "Light Degree",
    "shadows": "Own Shadows",
    "finest_blur_mm": "Finest Blur (mm)",
    "expressions": "Photos with Expressions",
    "lam": "Lambda",
}
CHOICES = {
    "method": {
        "joint": ("Joint", "Landmarks, then shading and motion in one system"),
        "imls": ("Alternating", "Shading and motion in turn, robust"),
        "paper": ("As Printed", "The published algorithm as it is written"),
        "motion": ("Landmarks Only", "No shading; quick, and coarse"),
    },
    "landmarks": {
        "468": ("468", "All points of the face mesh"),
        "68": ("68", "The iBUG points"),
        "40": ("40", "The paper's points"),
    },
    "light_degree": {
        "1": ("1", "Four numbers for each light, as in the paper"),
        "2": ("2", "Nine numbers: soft light"),
        "3": ("3", "Sixteen numbers"),
        "4": ("4", "Twenty-five numbers: hard light too, in half the time"),
        "5": ("5", "Thirty-six numbers"),
        "6": ("6", "Forty-nine numbers: hard light"),
    },
}
# Shown first; all others are for those who know the method.
MAIN = (
    "method",
    "control_points_u",
    "control_points_v",
    "expressions",
    "perspective",
    "distance_mm",
)
POINTS = ("control_points_u", "control_points_v")


def descriptions():
    """Name -> sentence, from the docstring of `Settings`."""
    found, text = {}, inspect.cleandoc(Settings.__doc__ or "")
    entry = re.compile(r"^(\w[\w, ]*) : .*\n((?:    .*\n?)+)", re.MULTILINE)
    for names, body in entry.findall(text):
        sentence = " ".join(body.split()).rstrip(".").replace("``", "")
        for name in names.split(", "):
            found[name] = sentence
    return found


def to_core(group, changes=None):
    """The core's Settings from the properties; ``changes`` win over them.

    Raises
    ------
    ValueError, TypeError
        A value is not possible.
    """
    values = {name: _exact(getattr(group, name)) for name in NAMES}
    values["control_points"] = tuple(values.pop(name) for name in POINTS)
    values["light_degree"] = int(values["light_degree"])
    return Settings.from_dict({**values, **(changes or {})})


def _exact(value):
    """Blender keeps float32; the decimal number that was typed is meant."""
    return float(f"{value:.7g}") if isinstance(value, float) else value


def _properties():
    says, made = descriptions(), {}
    for field in dataclasses.fields(Settings):
        name, default = field.name, field.default
        label = LABELS.get(name, name.replace("_", " ").title())
        text = says.get(name, "")
        if name == "control_points":
            for part, word, value in zip(
                POINTS, ("Across", "Down"), default, strict=True
            ):
                made[part] = IntProperty(
                    name=f"Control Points {word}",
                    description="More control points give finer detail",
                    default=value,
                    min=8,
                    max=120,
                )
        elif name in CHOICES:
            made[name] = EnumProperty(
                name=label,
                description=text,
                items=[(key, *words) for key, words in CHOICES[name].items()],
                default=str(default),
            )
        elif isinstance(default, bool):
            made[name] = BoolProperty(name=label, description=text, default=default)
        else:
            low, high = LIMITS[name]
            kind = IntProperty if isinstance(default, int) else FloatProperty
            # As many digits as there is room for beside the label.
            digits = 3 if default < 100 else 1
            extra = {} if kind is IntProperty else {"precision": digits}
            made[name] = kind(
                name=label,
                description=text,
                default=default,
                min=low if extra else int(low),
                max=high if extra else int(high),
                **extra,
            )
    return made


class BSFACE_PG_settings(bpy.types.PropertyGroup):
    """The core's settings."""

    __annotations__ = _properties()


# Of the properties, in the order of the dataclass.
NAMES = tuple(BSFACE_PG_settings.__annotations__)


assert set(CHOICES["method"]) == set(METHODS)
assert set(CHOICES["landmarks"]) == set(SCHEMES)
