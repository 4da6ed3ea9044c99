"""A whole head: the average head with ears, skull and neck, continued from a face.

Where the face is sure, the vertices lie on its surface. From there the difference to
the average head, moved onto the face by a similarity, is continued over the rest so
that neither the skin nor its tangent jumps; towards the back of the head it fades out.
Between the sure part and the outline of the face, where photos see little, the surface
counts less and less.

Eyes, mouth and the ARKit keys are those of :func:`.mesh.quad_mesh`.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from .._types import Array, Indices
from ..kinds import expect
from ..surface.alignment import fit_similarity
from .arkit import Face, FaceUnits, feature_sizes, units_for
from .base_head import BaseHead, base_head, face_region
from .continuation import Continuation
from .mesh import (
    SIDES,
    QuadMesh,
    Skin,
    SurfaceSkin,
    cells_of,
    divided_lips,
    furnished,
    regions,
)

#: Share of the face, see `face_region`, in which the vertices lie on the surface.
SURE = 0.80
#: Length in mm over which the surface draws the skin next to the sure part.
DRAW = 8.0
#: mm over which the shape of the face, and the movement of a key, fade out; the first
#: by `tools/build_head.py --measure`.
SHAPE_REACH, KEY_REACH = 160.0, 18.0
#: Vertices that a key moves by less, mm, do not move.
STILL = 0.02
#: Height of the lower end of the skull above the origin, mm, of the average head.
NAPE = -60.0


def full_head(face: Face, density: str = "medium", *, keys: bool = True) -> QuadMesh:
    """The head of a face, with eyeballs and a mouth.

    Parameters
    ----------
    face : Reconstruction
    density : "low", "medium" or "high"
        About 2,900, 11,600 or 46,000 quads of skin.
    keys : bool
        Also the ARKit keys.

    Returns
    -------
    QuadMesh
        ``uv`` of the skin are places in the picture of
        :func:`bsface.texture.head.head_picture`; the groups have ``ear_left``,
        ``ear_right``, ``scalp`` and ``neck`` besides those of the face.

    Raises
    ------
    ReconstructionError
        When the face was made with a template whose (u, v) is not the bundled one's.
    ValueError
        When the density is unknown.
    """
    expect(Face, "a face with its template", face=face)
    *_, ball_cells = cells_of(density)
    units = units_for(face)
    base = base_head(density)
    region = face_region(base.uv)
    seen = np.flatnonzero(region <= 1)
    lip_side = _lip_side(base, units)
    sheet = SurfaceSkin(face, units, base.uv[seen], lip_side[seen])
    sure = region[seen] <= SURE
    placed = fit_similarity(base.points[seen][sure], sheet.points[sure])

    def continued(of_face: Array, reach: float) -> Array:
        given = np.zeros_like(base.points)
        given[seen] = of_face
        return carry(reach)(given)

    @lru_cache
    def carry(reach: float) -> Continuation:
        return Continuation(base.points, base.quads, surface_weight(region), reach)

    back = (sheet.points - placed.t) @ placed.R / placed.scale
    points = placed(base.points + continued(back - base.points[seen], SHAPE_REACH))
    points[seen[sure]] = sheet.points[sure]

    def movement(name: str) -> Array:
        moved = sheet.movement(name)
        if not moved.any():
            return np.zeros_like(base.points)
        moved = continued(moved, KEY_REACH)
        moved[np.linalg.norm(moved, axis=1) < STILL] = 0.0
        return moved

    skin = Skin(
        points=points,
        quads=base.quads,
        uv=base.place,
        groups=_groups(base, region, lip_side, units),
        lids=base.lids,
        lips=(base.lip_upper, base.lip_lower),
        blinks=tuple(
            sheet.movement(f"eyeBlink{side}")[np.searchsorted(seen, loop)]
            for side, loop in zip(SIDES, base.lids, strict=True)
        ),
        movement=movement,
    )
    eye_distance = feature_sizes(face.surface, units)["eyes"]
    return furnished(skin, units, eye_distance, ball_cells, keys)


def surface_weight(region: Array) -> Array:
    """What `Continuation` reads: the surface holds, then counts less, then nothing."""
    fade = np.clip((1 - region) / (1 - SURE), 0, 1)
    weight = np.where(region <= SURE, np.inf, fade**2 * DRAW**-4)
    return np.where(np.isnan(region), 0.0, weight)


def _lip_side(base: BaseHead, units: FaceUnits) -> Array:
    """1 above the line between the lips, -1 below it, 0 at its corners."""
    line = np.interp(base.uv[:, 0], *units.lips_uv.T)
    side = np.where(base.uv[:, 1] < line, 1.0, -1.0)
    side[base.lip_upper], side[base.lip_lower] = 1.0, -1.0
    side[base.lip_upper[[0, -1]]] = 0.0
    return side


def _groups(
    base: BaseHead, region: Array, lip_side: Array, units: FaceUnits
) -> dict[str, Indices]:
    """Vertices of each region; every vertex is in one."""
    is_face = region <= 1
    is_face[base.ears] = False
    numbers = np.flatnonzero(is_face)
    found = divided_lips(regions(base.uv[numbers], units), lip_side[numbers])
    groups = {name: numbers[index] for name, index in found.items()}
    left = base.points[:, 0] > 0
    ear = np.zeros(len(left), bool)
    ear[base.ears] = True
    groups["ear_left"] = np.flatnonzero(ear & left)
    groups["ear_right"] = np.flatnonzero(ear & ~left)
    rest = ~is_face & ~ear
    nostril = rest & (base.points[:, 2] > 0) & (np.abs(base.points[:, 1]) < 60)
    groups["nose"] = np.sort(np.append(groups["nose"], np.flatnonzero(nostril)))
    rest &= ~nostril
    high = base.points[:, 1] > NAPE
    groups["scalp"] = np.flatnonzero(rest & high)
    groups["neck"] = np.flatnonzero(rest & ~high)
    return groups
