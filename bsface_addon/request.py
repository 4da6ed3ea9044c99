"""One job as plain data: what the panel's state and an operator's options mean.

A `Request` holds no Blender data, so that a thread can work on it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import ReconstructionError, one_line
from . import messages, photo_list

if TYPE_CHECKING:
    from ..core.landmarks.landmarks import Landmarks
    from ..core.problem import Constraint
    from ..core.settings import Settings
    from ..core.surface.bspline import BSplineSurface
    from .properties import BSFACE_PG_scene

# Folder names that say nothing about the person.
NAMELESS = ("", "photos", "images", "pictures")


@dataclass(frozen=True)
class Request:
    """One job.

    Attributes
    ----------
    photos : tuple of Path
    settings : Settings
    name : str
        Name of a new face.
    ignore : tuple of str
        Names of photos to leave out.
    landmarks : mapping of photo name to Landmarks
        They replace detection.
    masks : mapping of photo name to bytes
        Painted masks, as the content of mask files.
    start : BSplineSurface or None
        A face to start from, in the size and place of results; None for the average.
    constraint : Constraint or None
        Control points of ``start`` that stay where they are.
    texture_size : int or None
        Pixels along a side; None for what the photos are worth.
    """

    photos: tuple[Path, ...]
    settings: Settings
    name: str
    ignore: tuple[str, ...] = ()
    landmarks: Mapping[str, Landmarks] = field(default_factory=dict)
    masks: Mapping[str, bytes] = field(default_factory=dict)
    start: BSplineSurface | None = None
    constraint: Constraint | None = None
    texture_size: int | None = None


def from_panel(
    state: BSFACE_PG_scene,
    photos: Iterable[Path] | None = None,
    name: str = "",
    changes: Mapping[str, object] | None = None,
    **fields,
) -> Request:
    """The `Request` that the panel's state means.

    Parameters
    ----------
    photos : paths, optional
        Instead of those of the list.
    name : str
        Of a new face; by default that of the photos' folder.
    changes : mapping, optional
        Settings by the core's names that win over the panel's.
    fields
        Other fields of `Request`.

    Raises
    ------
    ReconstructionError
        There are no photos, or a setting is not possible.
    """
    if photos is None:
        fields.setdefault("ignore", photo_list.ignored(state))
        fields.setdefault("landmarks", photo_list.known_landmarks(state))
        fields.setdefault("masks", photo_list.known_masks(state))
        photos = photo_list.paths(state)
    photos = tuple(photos)
    if not photos:
        raise ReconstructionError(messages.NO_PHOTOS)
    size = state.texture_size
    return Request(
        photos=photos,
        settings=_settings(state.settings, changes),
        texture_size=None if size == "AUTO" else int(size),
        # Blender takes text only; folders have any names.
        name=one_line(name or face_name(photos)),
        **fields,
    )


def parsed(text: str) -> dict[str, object]:
    """Settings written as a JSON object; empty text is no settings."""
    try:
        changes = json.loads(text) if text.strip() else {}
    except (ValueError, RecursionError) as error:
        raise ReconstructionError(messages.BAD_SETTINGS.format(why=error)) from None
    if not isinstance(changes, dict):
        why = "give a JSON object such as {}".format('{"method": "motion"}')
        raise ReconstructionError(messages.BAD_SETTINGS.format(why=why))
    return changes


def face_name(photos: Iterable[Path]) -> str:
    """A name for the face: that of the folder of its photos."""
    folders = {Path(path).parent for path in photos}
    name = folders.pop().name if len(folders) == 1 else ""
    return "Face" if name.lower() in NAMELESS else name


def _settings(group, changes: Mapping[str, object] | None) -> Settings:
    from . import settings_group

    try:
        return settings_group.to_core(group, changes)
    except ValueError as error:
        # The core's sentence names the setting and its limits.
        raise ReconstructionError(str(error)) from error
    except TypeError as error:
        raise ReconstructionError(messages.BAD_SETTINGS.format(why=error)) from error
