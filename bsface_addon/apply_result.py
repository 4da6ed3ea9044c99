"""A finished reconstruction becomes the scene's face and the panel's news.

Operators, the script and the command end here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from . import photo_list, scene, skin_overlay

if TYPE_CHECKING:
    import bpy

    from .request import Request
    from .solving import Outcome


def apply_result(
    context: bpy.types.Context,
    request: Request,
    outcome: Outcome,
    *,
    face: bpy.types.Object | None = None,
    scale: float = 1.0,
    select: bool = True,
) -> bpy.types.Object:
    """Put an outcome into the scene, the photo list and the hints.

    Parameters
    ----------
    face : bpy.types.Object, optional
        A face made earlier, which is updated; by default a new one is made.
    scale : float
        Size of a new face; 1 is life size.
    select : bool
        See `scene.place`.

    Returns
    -------
    bpy.types.Object
        The face.
    """
    result = outcome.result
    face = scene.place(
        context, outcome, request.name, face=face, scale=scale, select=select
    )
    state = context.scene.bsface
    state.face = face
    if set(request.photos) - set(photo_list.paths(state)):
        photo_list.replace(state, request.photos)
    photo_list.take_reports(state, result.reports)
    photo_list.take_landmarks(state, result.landmarks, outcome.landmarks)
    state.hints = "\n".join(result.warnings)
    skin_overlay.refresh(context, face)
    return face
