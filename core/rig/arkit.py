"""Apple's 52 face keys as movements of the control net, scaled to the person.

The keys come from ``core/data/arkit.npz``, which ``tools/build_arkit.py`` makes out of
the *Face Units* pack for the MakeHuman base mesh. They fit every face of the bundled
template, because all of them share its (u, v). A key is a displacement of the control
points: ``surface.control_points + weight * key``; weights run from 0 to 1 and keys add
up. The net at weight 0 is the neutral face, bit for bit.

Scaling: all keys by the person's eye distance; a blink by how far the eye is open, and
then by the least movement of the lids that makes them meet along their whole length.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from .._types import Array
from ..errors import ReconstructionError
from ..kinds import expect
from ..npz_arrays import floats, read_arrays
from ..surface.alignment import EYE_CORNERS
from ..surface.bspline import BSplineSurface, basis_matrix
from ..surface.template import Template, load_template
from .eyes import EYE_DISTANCE_MM
from .grid import Slit, along
from .names import ARKIT_NAMES

BUNDLED = Path(__file__).resolve().parents[1] / "data" / "arkit.npz"
MAX_BYTES = 50_000_000
#: Landmarks in the middle of the upper and the lower lid, by the subject's side.
LIDS = {"Right": (159, 145), "Left": (386, 374)}
#: Where the upper lid margin of a closed eye may lie, from the lower one, mm: upwards
#: and forwards, at the middle of the lids.
LID_OVER, LID_BEFORE = (-0.5, -0.1), (0.1, 0.8)


@runtime_checkable
class Face(Protocol):
    """What a rig needs to know of a `Reconstruction`."""

    @property
    def surface(self) -> BSplineSurface: ...

    @property
    def template(self) -> Template: ...


@dataclass(frozen=True)
class FaceUnits:
    """The keys of the template face.

    Attributes
    ----------
    keys : (52, M, N, 3) array
        Displacements of the control points, mm, in the order of `ARKIT_NAMES`.
    jumps : (52, a, b, 3) array
        The same points moved apart for the two lips: half of it up, half down.
    jump_first : (2,) int array
        Index of the first of them in the net.
    eye_turn_degrees : (4,) array
        How far the eyes turn up, down, in and out.
    lids_uv : (2, k, 2) array
        Lid margins, the subject's right eye first: from the inner corner over the
        upper lid to the outer one and back.
    lips_uv : (k, 2) array
        The line between the lips, the subject's right corner first.
    landmark_uv : (468, 2) array
        Of the template that the keys were made for.
    landmark_class : (468,) array of text
        brow, cheek, eye, forehead, jaw, lip, nose or outline.
    """

    keys: Array
    jumps: Array
    jump_first: np.ndarray
    eye_turn_degrees: Array
    lids_uv: Array
    lips_uv: Array
    landmark_uv: Array
    landmark_class: np.ndarray


@lru_cache(maxsize=1)
def face_units() -> FaceUnits:
    """The bundled keys."""
    with BUNDLED.open("rb") as file:
        a = read_arrays(file, MAX_BYTES)
    keys = floats(a, "keys", len(ARKIT_NAMES), None, None, 3)
    if tuple(str(n) for n in a["names"]) != ARKIT_NAMES:
        raise ValueError(f"{BUNDLED}: other names than Apple's; build it again")
    return FaceUnits(
        keys=keys,
        jumps=floats(a, "jumps", len(keys), None, None, 3),
        jump_first=floats(a, "jump_first", 2).astype(int),
        eye_turn_degrees=floats(a, "eye_turn_degrees", 4),
        lids_uv=floats(a, "lids_uv", 2, None, 2),
        lips_uv=floats(a, "lips_uv", None, 2),
        landmark_uv=floats(a, "landmark_uv", 468, 2),
        landmark_class=a["landmark_class"],
    )


def arkit_keys(face: Face) -> dict[str, Array]:
    """The 52 ARKit keys of a face.

    Parameters
    ----------
    face : Reconstruction
        Any object with a ``surface`` and its ``template``.

    Returns
    -------
    dict of (M, N, 3) arrays
        Apple's names in Apple's order; displacements of the control points at full
        strength, mm. Left and right are the subject's. ``tongueOut`` moves no skin:
        its key is zero.

    Raises
    ------
    ReconstructionError
        When the face was made with a template whose (u, v) is not the bundled one's.
    """
    expect(Face, "a face with its template", face=face)
    units = units_for(face)
    factors = key_factors(face, units)
    shape = face.surface.shape
    keys = {}
    for name, key, factor in zip(ARKIT_NAMES, units.keys, factors, strict=True):
        if key.shape[:2] != shape and key.any():
            key = BSplineSurface(key).resampled(shape).control_points
        elif key.shape[:2] != shape:
            key = np.zeros((*shape, 3))
        keys[name] = factor * key
    for side, loop in zip(("Right", "Left"), units.lids_uv, strict=True):
        name = f"eyeBlink{side}"
        keys[name] = keys[name] + lid_closure(
            face.surface,
            keys[name],
            lid_slit(loop),
            feature_sizes(face.surface, units)["eyes"] / EYE_DISTANCE_MM,
        )
    return keys


def lid_slit(loop: Array) -> Slit:
    """Upper and lower lid with u rising, of a loop from the inner corner."""
    outer = int(np.abs(loop[:, 0] - loop[0, 0]).argmax())
    upper, lower = loop[: outer + 1], np.vstack([loop[outer:], loop[:1]])[::-1]
    if upper[0, 0] > upper[-1, 0]:
        upper, lower = upper[::-1], lower[::-1]
    return Slit(upper, lower)


def lid_closure(
    surface: BSplineSurface, blink: Array, lids: Slit, unit: float
) -> Array:
    """What is to be added to a blink so that the lids meet, (M, N, 3).

    The smallest change of the control points, in the sense of least squares, that
    brings the upper margin just over and before the lower one.

    Parameters
    ----------
    surface : BSplineSurface
    blink : (M, N, 3) array
    lids : Slit
    unit : float
        How much larger the face is than one of 62 mm between the eyes.
    """
    share = np.linspace(0, 1, 22)[1:-1]
    upper, lower = (
        basis_matrix(surface.shape, *along(bank, share).T)
        for bank in (lids.upper, lids.lower)
    )
    D = (upper - lower).toarray()
    gap = D @ (surface.control_points + blink).reshape(-1, 3)
    room = unit * np.sin(np.pi * share)
    wanted = gap.copy()
    wanted[:, 1] = np.clip(gap[:, 1], LID_OVER[0] * room, LID_OVER[1] * room)
    wanted[:, 2] = np.clip(gap[:, 2], LID_BEFORE[0] * room, LID_BEFORE[1] * room)
    gram = D @ D.T
    gram += 1e-2 * np.trace(gram) / len(gram) * np.eye(len(gram))
    return (D.T @ np.linalg.solve(gram, wanted - gap)).reshape(blink.shape)


def units_for(face: Face) -> FaceUnits:
    """The bundled keys, after a check that they fit the face's parametrisation."""
    units = face_units()
    if np.abs(face.template.landmark_uv - units.landmark_uv).max() > 1e-3:
        raise ReconstructionError(
            "The face was made with a template of its own, and the ARKit keys fit the "
            "bundled one only; reconstruct it without a template file."
        )
    return units


def key_factors(face: Face, units: FaceUnits) -> Array:
    """What each key is multiplied by to fit the person, (52,)."""
    average = load_template().surface
    own = feature_sizes(face.surface, units)
    mean = feature_sizes(average, units)
    scale = own["eyes"] / mean["eyes"]
    factors = np.full(len(ARKIT_NAMES), scale)
    for side in LIDS:
        factors[ARKIT_NAMES.index(f"eyeBlink{side}")] = own[side] / mean[side]
    return factors


def feature_sizes(surface: BSplineSurface, units: FaceUnits) -> dict[str, float]:
    """Distance of the eyes ("eyes") and opening of each ("Right", "Left"), mm."""
    uv = units.landmark_uv
    middle = {
        side: surface.evaluate(*uv[list(pair)].T).mean(0)
        for side, pair in zip(("Right", "Left"), EYE_CORNERS, strict=True)
    }
    sizes = {"eyes": float(np.linalg.norm(middle["Left"] - middle["Right"]))}
    for side, pair in LIDS.items():
        upper, lower = surface.evaluate(*uv[list(pair)].T)
        sizes[side] = float(np.linalg.norm(upper - lower))
    return sizes
