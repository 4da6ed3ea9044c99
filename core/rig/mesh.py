"""The face as a mesh of quads, with eyes and a mouth that open.

The skin is a regular grid over (u, v), trimmed to the outline, with the lids and the
line between the lips along fixed curves of (u, v): the same vertex is the same place of
every face. Behind the openings stand eyeballs and a mouth bag. Every vertex of the skin
lies on the surface; the surface itself stays one sheet.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from .._types import Array, Indices
from ..kinds import expect
from ..surface.bspline import basis_matrix
from .arkit import (
    Face,
    FaceUnits,
    arkit_keys,
    feature_sizes,
    key_factors,
    lid_slit,
    units_for,
)
from .eyes import EYE_DISTANCE_MM, Eyeball, fit_eyeball, sphere, turned
from .grid import Slit, slit_grid
from .names import ARKIT_NAMES
from .pockets import bag_movement, lid_rim, mouth_bag

#: Name -> quads along u and v, quads along the edge of an eyeball's cube.
DENSITIES = {"low": (48, 52, 4), "medium": (96, 104, 6), "high": (192, 208, 10)}
#: Materials of the quads, by number.
PARTS = ("skin", "eyes", "mouth")
#: The subject's right first, as in `FaceUnits.lids_uv`.
SIDES = ("Right", "Left")


@dataclass(frozen=True, eq=False)
class QuadMesh:
    """Quads.

    Attributes
    ----------
    points : (p, 3) array
        Millimetres.
    quads : (q, 4) int array
        Counter-clockwise seen from outside.
    uv : (p, 2) array
        Texture coordinates of each vertex, v downwards: of the skin the (u, v) of the
        surface, of an eyeball those of `eyes.iris_picture`.
    groups : dict of int arrays
        Vertices of each region: "forehead", "brow_left", "lip_upper", "eyeball_left".
    part : (q,) int array
        Index into `PARTS` of each quad.
    keys : dict of (p, 3) arrays
        Displacements of the ARKit keys, mm; empty when not asked for.
    """

    points: Array
    quads: Indices
    uv: Array
    groups: Mapping[str, Indices]
    part: Indices
    keys: Mapping[str, Array] = field(default_factory=dict)


def quad_mesh(
    face: Face,
    density: str = "medium",
    *,
    eyes: bool = True,
    mouth: bool = True,
    keys: bool = True,
) -> QuadMesh:
    """Quads of a face.

    Parameters
    ----------
    face : Reconstruction
    density : "low", "medium" or "high"
        About 2,500, 10,000 or 40,000 quads of skin.
    eyes : bool
        Lid openings with eyeballs.
    mouth : bool
        An open line between the lips with a bag behind it.
    keys : bool
        Also the ARKit keys.

    Raises
    ------
    ReconstructionError
        When the face was made with a template whose (u, v) is not the bundled one's.
    ValueError
        When the density is unknown.
    """
    expect(Face, "a face with its template", face=face)
    nu, nv, ball_cells = cells_of(density)
    units = units_for(face)
    slits = [lid_slit(loop) for loop in units.lids_uv] if eyes else []
    if mouth:
        slits.append(Slit(units.lips_uv, units.lips_uv))
    grid = slit_grid(face.template.outline_uv, tuple(slits), (nu, nv))
    # The lips part; without a mouth the sheet's own keys are right.
    lip_side = grid.side[-1] if mouth else np.zeros(len(grid.uv))
    sheet = SurfaceSkin(face, units, grid.uv, lip_side)
    groups = regions(grid.uv, units)
    lids = tuple(
        np.concatenate([upper, lower[-2:0:-1]])
        for upper, lower in grid.banks[: 2 * eyes]
    )
    skin = Skin(
        points=sheet.points,
        quads=grid.quads,
        uv=grid.uv,
        groups=divided_lips(groups, lip_side) if mouth else groups,
        lids=lids,
        lips=grid.banks[-1] if mouth else None,
        blinks=tuple(
            sheet.movement(f"eyeBlink{side}")[loop]
            for side, loop in zip(SIDES, lids, strict=False)
        ),
        movement=sheet.movement,
    )
    eye_distance = feature_sizes(face.surface, units)["eyes"]
    return furnished(skin, units, eye_distance, ball_cells, keys)


def cells_of(density: str) -> tuple[int, int, int]:
    """Quads along u and v, and along the edge of an eyeball's cube.

    Raises
    ------
    ValueError
        When the density is unknown.
    """
    if density not in DENSITIES:
        raise ValueError(
            f"density must be one of {', '.join(DENSITIES)}, not {density!r}"
        )
    return DENSITIES[density]


class SurfaceSkin:
    """How skin on the surface moves.

    Parameters
    ----------
    face : Reconstruction
    units : FaceUnits
    uv : (p, 2) array
        Where its vertices lie.
    lip_side : (p,) array
        1 above the line between the lips, -1 below it, 0 on it.
    """

    def __init__(self, face: Face, units: FaceUnits, uv: Array, lip_side: Array):
        self.units, self.lip_side = units, lip_side
        self.points = face.surface.evaluate(*uv.T)
        self.keys = arkit_keys(face)
        self.factors = key_factors(face, units)
        self.basis = basis_matrix(face.surface.shape, *uv.T)
        shape = (units.keys.shape[1], units.keys.shape[2])
        self.lip_basis = basis_matrix(shape, *uv.T)

    def movement(self, name: str) -> Array:
        """Displacement at full strength of a key, (p, 3)."""
        moved = self.basis @ self.keys[name].reshape(-1, 3)
        k = ARKIT_NAMES.index(name)
        jump = self.units.jumps[k]
        if jump.any():
            apart = np.zeros_like(self.units.keys[k])
            i, j = self.units.jump_first
            apart[i : i + jump.shape[0], j : j + jump.shape[1]] = jump / 2
            parted = self.factors[k] * (self.lip_basis @ apart.reshape(-1, 3))
            moved = moved + self.lip_side[:, None] * parted
        return moved


@dataclass(frozen=True)
class Skin:
    """Skin with openings, before anything is behind them.

    Attributes
    ----------
    points, quads, uv, groups
        As in `QuadMesh`.
    lids : tuple of int arrays
        Vertices of the lid margins, the subject's right eye first, clockwise as seen
        from the front; empty without openings.
    lips : two int arrays, optional
        Vertices of the upper and the lower lip, from the subject's right corner to the
        left.
    blinks : tuple of (k, 3) arrays
        Displacements of the lid margins to the closed eye.
    movement : callable
        Displacement of its vertices at full strength of a key.
    """

    points: Array
    quads: Indices
    uv: Array
    groups: Mapping[str, Indices]
    lids: tuple[Indices, ...]
    lips: tuple[Indices, Indices] | None
    blinks: tuple[Array, ...]
    movement: Callable[[str], Array]


def furnished(
    skin: Skin, units: FaceUnits, eye_distance: float, ball_cells: int, keys: bool
) -> QuadMesh:
    """Skin with eyeballs, lid rims and a mouth bag.

    Parameters
    ----------
    skin : Skin
    units : FaceUnits
    eye_distance : float
        mm.
    ball_cells : int
        Quads along the edge of an eyeball's cube.
    keys : bool
        Also the ARKit keys.
    """
    builder = _Builder(skin, units, eye_distance)
    for k, loop in enumerate(skin.lids):
        builder.add_eye(k, loop, ball_cells)
    if skin.lips is not None:
        builder.add_mouth(*skin.lips)
    return builder.mesh(keys)


class _Builder:
    """Skin first, then what stands behind it; movements in the same order."""

    def __init__(self, skin: Skin, units: FaceUnits, eye_distance: float):
        self.skin, self.units, self.eye_distance = skin, units, eye_distance
        self.points, self.uv = [skin.points], [skin.uv]
        self.quads, self.part = [skin.quads], [np.zeros(len(skin.quads), np.int64)]
        self.groups = dict(skin.groups)
        self.count = len(skin.points)
        self.eyes: list[tuple[int, Eyeball, Indices, Array, Array]] = []
        self.bag: tuple[Indices, Indices] | None = None

    def _add(self, points: Array, quads: Indices, uv: Array, part: str) -> Indices:
        """Append a piece; returns the numbers of its vertices."""
        numbers = self.count + np.arange(len(points))
        self.points.append(points)
        self.uv.append(uv)
        self.quads.append(quads)
        self.part.append(np.full(len(quads), PARTS.index(part)))
        self.count += len(points)
        return numbers

    def add_eye(self, k: int, loop: Indices, cells: int) -> None:
        lids = self.skin.points[loop]
        ball = fit_eyeball(lids, self.skin.blinks[k], self.eye_distance)
        pocket = lid_rim(lids, ball)
        table = np.concatenate([loop, self.count + np.arange(len(pocket.points))])
        uv = np.tile(self.skin.uv[loop], (len(pocket.points) // len(loop), 1))
        numbers = self._add(pocket.points, table[pocket.quads], uv, "skin")
        side = SIDES[k].lower()
        self.groups[f"lid_rim_{side}"] = numbers
        points, quads, uv = sphere(ball, cells)
        numbers = self._add(points, self.count + quads, uv, "eyes")
        self.groups[f"eyeball_{side}"] = numbers
        self.eyes.append((k, ball, loop, pocket.points, points))

    def add_mouth(self, upper: Indices, lower: Indices) -> None:
        unit = self.eye_distance / EYE_DISTANCE_MM
        points = self.skin.points
        pocket = mouth_bag(points[upper], points[lower], unit)
        loop = np.concatenate([upper, lower[-2:0:-1]])
        table = np.concatenate([loop, self.count + np.arange(len(pocket.points))])
        uv = self.skin.uv[upper].mean(axis=0)
        uv = np.broadcast_to(uv, (len(pocket.points), 2))
        numbers = self._add(pocket.points, table[pocket.quads], uv, "mouth")
        self.groups["mouth_bag"] = numbers
        self.bag = (upper, lower)

    def movement(self, name: str) -> Array:
        """Displacement of every vertex at full strength of a key."""
        skin = self.skin.movement(name)
        moved = [skin]
        for k, ball, loop, rim, points in self.eyes:
            rings = len(rim) // len(loop)
            gone = np.tile(skin[loop], (rings, 1))
            radius = np.linalg.norm(rim - ball.centre, axis=1, keepdims=True)
            share = radius / ball.radius
            away = ball.centre + share * (ball.onto(rim + gone) - ball.centre) - rim
            away[~gone.any(axis=1)] = 0.0
            moved += [away, self._eye_turn(name, k, ball, points)]
        if self.bag is not None:
            upper, lower = self.bag
            moved.append(bag_movement(skin[upper], skin[lower]))
        return np.concatenate(moved)

    def _eye_turn(self, name: str, k: int, ball: Eyeball, points: Array) -> Array:
        for way, degrees in zip(
            ("Up", "Down", "In", "Out"), self.units.eye_turn_degrees, strict=True
        ):
            if name == f"eyeLook{way}{SIDES[k]}":
                inwards = 1.0 if SIDES[k] == "Right" else -1.0
                across = {"In": inwards, "Out": -inwards}.get(way, 0.0)
                up = {"Up": 1.0, "Down": -1.0}.get(way, 0.0)
                return turned(ball, points, (across * degrees, up * degrees))
        return np.zeros_like(points)

    def mesh(self, keys: bool) -> QuadMesh:
        return QuadMesh(
            points=np.concatenate(self.points),
            quads=np.concatenate(self.quads),
            uv=np.concatenate(self.uv),
            groups=self.groups,
            part=np.concatenate(self.part),
            keys={n: self.movement(n) for n in ARKIT_NAMES} if keys else {},
        )


def divided_lips(groups: dict[str, Indices], lip_side: Array) -> dict[str, Indices]:
    """Groups with the two lips told apart by the side of their vertices."""
    lip = np.concatenate([groups["lip_upper"], groups["lip_lower"]])
    upper = lip_side[lip] >= 0
    return {
        **groups,
        "lip_upper": np.sort(lip[upper]),
        "lip_lower": np.sort(lip[~upper]),
    }


def regions(uv: Array, units: FaceUnits) -> dict[str, Indices]:
    """Vertices of the regions of a face, by the class of the nearest landmark.

    Every vertex is in one region. "left" is the subject's.
    """
    known = np.flatnonzero(units.landmark_class != "outline")
    nearest = known[cKDTree(units.landmark_uv[known]).query(uv)[1]]
    place = units.landmark_class[nearest]
    left = uv[:, 0] > 0.5
    above = uv[:, 1] < np.interp(uv[:, 0], *units.lips_uv.T)
    halves = {"brow": left, "eye": left, "cheek": left, "lip": above}
    groups = {}
    for name in ("forehead", "brow", "eye", "nose", "cheek", "lip", "jaw"):
        here = place == name
        if name in halves:
            one, other = ("upper", "lower") if name == "lip" else ("left", "right")
            groups[f"{name}_{one}"] = np.flatnonzero(here & halves[name])
            groups[f"{name}_{other}"] = np.flatnonzero(here & ~halves[name])
        else:
            groups[name] = np.flatnonzero(here)
    return groups
