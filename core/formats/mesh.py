"""Triangle meshes at a chosen tolerance: OBJ and PLY, millimetres.

The (u, v) square is cut into a grid whose lines lie on the knots and, between them, as
densely as the second derivatives ask for; the grid is clipped at the outline and its
vertices next to the outline are moved onto it, so that the border is smooth and no
sliver is left. All vertices lie on the surface. Texture coordinates are (u, 1 - v):
row 0 of a picture, its top, is v = 0 of the core.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .._types import Array
from ..files import write_bytes, write_text
from ..surface.bspline import BSplineSurface
from .mtl import material, plain_stem, write_pictures


@dataclass(frozen=True)
class Mesh:
    """Triangles on a surface.

    Attributes
    ----------
    vertices, normals : (k, 3) arrays
        Millimetres; outward unit normals.
    uv : (k, 2) array
        Parameters of the core, v downwards.
    triangles : (t, 3) int array
        Counter-clockwise seen from outside.
    deviation : float
        Largest distance found between surface and triangles, mm.
    """

    vertices: Array
    normals: Array
    uv: Array
    triangles: npt.NDArray[np.int64]
    deviation: float


def tessellate(
    surface: BSplineSurface,
    outline_uv: npt.ArrayLike | None = None,
    tolerance: float = 0.05,
    max_vertices: int = 4_000_000,
) -> Mesh:
    """Triangles that stay within ``tolerance`` of the surface.

    Parameters
    ----------
    surface : BSplineSurface
    outline_uv : (k, 2) array, optional
        Outline in (u, v); the whole surface without it.
    tolerance : float
        Millimetres.
    max_vertices : int
        Refuse to make more.

    Raises
    ------
    ValueError
        When the tolerance is not positive or asks for too many vertices.
    """
    if not tolerance > 0:
        raise ValueError(f"tolerance must be a positive length in mm, got {tolerance}")
    share = 1.0
    while True:
        lines = _grid_lines(surface, tolerance * share)
        if len(lines[0]) * len(lines[1]) > max_vertices:
            raise ValueError(
                f"a tolerance of {tolerance:g} mm needs more than {max_vertices} "
                "vertices; choose a larger one"
            )
        uv, triangles = _grid(*lines)
        if outline_uv is not None:
            uv, triangles = _clip(uv, triangles, np.asarray(outline_uv, float))
        vertices = surface.evaluate(uv[:, 0], uv[:, 1])
        deviation = _deviation(surface, uv, vertices, triangles)
        if deviation <= tolerance:
            normals = surface.normals(uv[:, 0], uv[:, 1])
            return Mesh(vertices, normals, uv, triangles, deviation)
        # The estimate holds in the limit of small cells; ask for smaller ones.
        share *= 0.8 * tolerance / deviation


def _grid_lines(surface: BSplineSurface, tolerance: float) -> tuple[Array, Array]:
    """Parameters of the grid lines in u and in v.

    A chord of length h in one parameter leaves the curve by at most h^2 |F''| / 8. The
    twist F_uv adds h_u h_v |F_uv| / 4 for two triangles on a cell.
    """
    m, n = surface.shape
    # Five samples in each knot span: second derivatives are linear along it.
    per = 5
    u = np.linspace(0, 1, (m - 3) * (per - 1) + 1)
    v = np.linspace(0, 1, (n - 3) * (per - 1) + 1)
    uu, vv = np.meshgrid(u, v, indexing="ij")
    bend_u = np.linalg.norm(surface.evaluate(uu, vv, du=2), axis=2).max(axis=1)
    bend_v = np.linalg.norm(surface.evaluate(uu, vv, dv=2), axis=2).max(axis=0)
    twist = np.linalg.norm(surface.evaluate(uu, vv, du=1, dv=1), axis=2)
    # |h_u h_v F_uv| <= (h_u^2 + h_v^2) |F_uv| / 2: share it out to both directions.
    bend_u, bend_v = bend_u + twist.max(axis=1), bend_v + twist.max(axis=0)
    return (
        _subdivided(bend_u, m - 3, per, tolerance / 2),
        _subdivided(bend_v, n - 3, per, tolerance / 2),
    )


def _subdivided(bend: Array, spans: int, per: int, tolerance: float) -> Array:
    lines = [np.zeros(1)]
    for span in range(spans):
        worst = bend[span * (per - 1) : span * (per - 1) + per].max()
        step = np.sqrt(8 * tolerance / max(worst, 1e-12))
        count = max(1, int(np.ceil(1 / (spans * step))))
        lines.append((span + np.arange(1, count + 1) / count) / spans)
    joined = np.concatenate(lines)
    joined[-1] = 1.0
    return joined


def _grid(u: Array, v: Array) -> tuple[Array, npt.NDArray[np.int64]]:
    uu, vv = np.meshgrid(u, v, indexing="ij")
    nv = len(v)
    first = (np.arange(len(u) - 1)[:, None] * nv + np.arange(nv - 1)).ravel()
    below, right, across = first + 1, first + nv, first + nv + 1
    triangles = np.concatenate(
        [
            np.stack([first, below, across], axis=1),
            np.stack([first, across, right], axis=1),
        ]
    )
    return np.stack([uu.ravel(), vv.ravel()], axis=1), triangles


# ------------------------------------------------------------------- clipping
def _clip(
    uv: Array, triangles: npt.NDArray[np.int64], outline: Array
) -> tuple[Array, npt.NDArray[np.int64]]:
    """The part of a (u, v) mesh inside a polygon."""
    distance, nearest = signed_distance(outline, uv)
    # Vertices nearer to the outline than a third of their shortest edge move onto it.
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    edges = np.concatenate([edges, triangles[:, [2, 0]]])
    length = np.linalg.norm(uv[edges[:, 0]] - uv[edges[:, 1]], axis=1)
    shortest = np.full(len(uv), np.inf)
    np.minimum.at(shortest, edges[:, 0], length)
    np.minimum.at(shortest, edges[:, 1], length)
    on_it = np.abs(distance) < shortest / 3
    uv = np.where(on_it[:, None], nearest, uv)
    side = np.where(on_it, 0, np.sign(distance)).astype(int)

    corner = side[triangles]
    whole = (corner >= 0).all(axis=1) & (corner > 0).any(axis=1)
    kept = [triangles[whole]]
    mixed = triangles[(corner > 0).any(axis=1) & (corner < 0).any(axis=1)]
    if len(mixed):
        pairs = np.sort(
            np.concatenate([mixed[:, [0, 1]], mixed[:, [1, 2]], mixed[:, [2, 0]]]), 1
        )
        pairs = np.unique(pairs[side[pairs[:, 0]] * side[pairs[:, 1]] < 0], axis=0)
        crossing = _crossings(outline, uv[pairs[:, 0]], uv[pairs[:, 1]], side[pairs])
        number = {
            (int(a), int(b)): len(uv) + index for index, (a, b) in enumerate(pairs)
        }
        uv = np.concatenate([uv, crossing])
        kept.append(_cut(mixed, side, number))
    triangles = np.concatenate(kept)
    used, index = np.unique(triangles, return_inverse=True)
    return uv[used], index.reshape(triangles.shape)


def _cut(
    mixed: npt.NDArray[np.int64],
    side: npt.NDArray[np.int64],
    number: dict[tuple[int, int], int],
) -> npt.NDArray[np.int64]:
    """Inner parts of the triangles that the outline crosses."""
    result: list[tuple[int, int, int]] = []
    for triangle in mixed.tolist():
        polygon = []
        for a, b in zip(triangle, triangle[1:] + triangle[:1], strict=True):
            if side[a] >= 0:
                polygon.append(a)
            if side[a] * side[b] < 0:
                polygon.append(number[min(a, b), max(a, b)])
        result += [
            (polygon[0], polygon[i], polygon[i + 1]) for i in range(1, len(polygon) - 1)
        ]
    return np.array(result, np.int64).reshape(-1, 3)


def _crossings(outline: Array, a: Array, b: Array, side: npt.NDArray) -> Array:
    """Points of the segments a-b on the outline, by bisection."""
    inner = np.where(side[:, :1] > 0, a, b)
    outer = np.where(side[:, :1] > 0, b, a)
    for _ in range(24):
        middle = (inner + outer) / 2
        is_inside = signed_distance(outline, middle)[0] >= 0
        inner = np.where(is_inside[:, None], middle, inner)
        outer = np.where(is_inside[:, None], outer, middle)
    return signed_distance(outline, inner)[1]


def signed_distance(outline: Array, points: Array) -> tuple[Array, Array]:
    """Distance to a closed polygon, positive inside, and the nearest point on it.

    Parameters
    ----------
    outline : (k, 2) array
    points : (p, 2) array

    Returns
    -------
    distance : (p,) array
    nearest : (p, 2) array
    """
    best = np.full(len(points), np.inf)
    nearest = np.zeros_like(points)
    odd = np.zeros(len(points), bool)
    for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        along = b - a
        t = np.clip((points - a) @ along / max(along @ along, 1e-300), 0, 1)
        foot = a + t[:, None] * along
        squared = ((points - foot) ** 2).sum(axis=1)
        closer = squared < best
        best = np.where(closer, squared, best)
        nearest[closer] = foot[closer]
        crosses = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
        rise = b[1] - a[1] or 1.0
        odd ^= crosses & (points[:, 0] < a[0] + (points[:, 1] - a[1]) * along[0] / rise)
    sign = np.where(odd, 1.0, -1.0)
    return np.asarray(sign * np.sqrt(best), float), nearest


def _deviation(
    surface: BSplineSurface,
    uv: Array,
    vertices: Array,
    triangles: npt.NDArray[np.int64],
) -> float:
    """Largest distance between surface and mesh, at seven points a triangle.

    Measured along the triangle's normal: the distance to its plane.
    """
    weights = np.array(
        [
            [1, 1, 1],
            *([1, 1, 0], [0, 1, 1], [1, 0, 1]),
            *([4, 1, 1], [1, 4, 1], [1, 1, 4]),
        ],
        float,
    )
    weights /= weights.sum(axis=1, keepdims=True)
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, size, out=np.zeros_like(normal), where=size > 1e-12)
    worst = 0.0
    for weight in weights:
        at = np.einsum("c,tck->tk", weight, uv[triangles])
        off = surface.evaluate(at[:, 0], at[:, 1]) - corners[:, 0]
        worst = max(worst, float(np.abs((off * normal).sum(axis=1)).max(initial=0)))
    return worst


# -------------------------------------------------------------------- writing
def write_mesh_obj(
    path: str | os.PathLike,
    surface: BSplineSurface,
    outline_uv: npt.ArrayLike | None = None,
    name: str = "face",
    *,
    tolerance: float = 0.25,
    texture: str | os.PathLike | None = None,
    normals: str | os.PathLike | None = None,
    displacement: str | os.PathLike | None = None,
) -> Path:
    """Write a triangle mesh as Wavefront OBJ with texture coordinates and normals.

    Parameters
    ----------
    path : path-like
    surface : BSplineSurface
    outline_uv : (k, 2) array, optional
    name : str
        Name of the object.
    tolerance : float
        Largest distance between surface and mesh, mm.
    texture : path, optional
        A PNG or JPEG picture over (u, v). It is copied beside the OBJ under its name,
        and a material file ``.mtl`` refers to it.
    normals, displacement : path, optional
        The same for a tangent-space normal map (``norm``, and ``map_Bump`` for
        Blender) and a displacement (``disp``); their names end in ``_normal`` and
        ``_displacement``.

    Raises
    ------
    ReconstructionError
        When the picture cannot be read or a file cannot be written.
    ValueError
        See :func:`tessellate`.
    """
    path = Path(path)
    mesh = tessellate(surface, outline_uv, tolerance)
    lines = [f"# B-spline face within {tolerance:g} mm, millimetres"]
    pictures = write_pictures(
        path, texture=texture, normals=normals, displacement=displacement
    )
    if pictures:
        colour = "1 1 1" if texture is not None else "0.60 0.40 0.31"
        library = path.with_name(f"{plain_stem(path)}.mtl")
        write_text(library, material("skin", colour, pictures))
        lines.append(f"mtllib {library.name}")
    lines.append(f"o {'_'.join(name.split())}")
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"vt {u!r} {1.0 - v!r}" for u, v in mesh.uv.tolist()]
    lines += [f"vn {x:.6f} {y:.6f} {z:.6f}" for x, y, z in mesh.normals.tolist()]
    if pictures:
        lines.append("usemtl skin")
    for a, b, c in (mesh.triangles + 1).tolist():
        lines.append(f"f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}")
    return write_text(path, "\n".join([*lines, ""]))


def write_mesh_ply(
    path: str | os.PathLike,
    surface: BSplineSurface,
    outline_uv: npt.ArrayLike | None = None,
    name: str = "face",
    tolerance: float = 0.25,
) -> Path:
    """Write a triangle mesh as binary PLY.

    Double positions, float normals and texture coordinates ``s, t`` (Blender's and
    MeshLab's names). Parameters and errors as in :func:`write_mesh_obj`.
    """
    mesh = tessellate(surface, outline_uv, tolerance)
    record = np.dtype(
        [(axis, "<f8") for axis in "xyz"]
        + [(f"n{axis}", "<f4") for axis in "xyz"]
        + [("s", "<f4"), ("t", "<f4")]
    )
    vertex = np.zeros(len(mesh.vertices), record)
    for index, axis in enumerate("xyz"):
        vertex[axis] = mesh.vertices[:, index]
        vertex[f"n{axis}"] = mesh.normals[:, index]
    vertex["s"], vertex["t"] = mesh.uv[:, 0], 1.0 - mesh.uv[:, 1]
    face = np.zeros(len(mesh.triangles), [("count", "u1"), ("index", "<i4", 3)])
    face["count"], face["index"] = 3, mesh.triangles
    kinds = {"<f8": "double", "<f4": "float"}
    properties = "".join(
        f"property {kinds[record[field].str]} {field}\n" for field in record.names or ()
    )
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"comment {' '.join(name.split())}, B-spline face within {tolerance:g} mm, "
        f"millimetres\nelement vertex {len(vertex)}\n{properties}"
        f"element face {len(face)}\nproperty list uchar int vertex_indices\n"
        "end_header\n"
    )
    content = header.encode("ascii", "replace") + vertex.tobytes() + face.tobytes()
    return write_bytes(path, content)
