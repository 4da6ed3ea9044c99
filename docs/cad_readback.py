#!/usr/bin/env python3
"""Write a face in every format, read it back with other programs, and draw what came.

    python docs/cad_readback.py [FACE.npz]

STEP and IGES are read by OpenCASCADE (``cadquery-ocp-novtk``), 3dm by ``rhino3dm``,
meshes by Blender's importers.  The drawing, ``docs/images/cad_readback.png``, has one
column a format with the size that the reader found; a reader that is not installed is
left out.  Without a file the face of ``out/demo/`` is taken.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from bsface.drawing.pictures import write_png
from bsface.drawing.render import shaded_view
from bsface.drawing.surface_grid import SurfaceGrid
from bsface.errors import ReconstructionError
from bsface.formats import export, load_face
from bsface.surface.bspline import grid_triangles

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "images" / "cad_readback.png"
FACE = ROOT / "out" / "demo" / "face.npz"
SIZE, MM_PER_PIXEL = (300, 400), 0.58
Triangles = tuple[np.ndarray, np.ndarray]


def by_opencascade(path: Path) -> Triangles:
    """Triangles of the trimmed face in a STEP or IGES file."""
    from OCP.BRep import BRep_Tool
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.IGESControl import IGESControl_Reader
    from OCP.STEPControl import STEPControl_Reader
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    reader = STEPControl_Reader() if path.suffix == ".step" else IGESControl_Reader()
    reader.ReadFile(str(path))
    reader.TransferRoots()
    shape = reader.OneShape()
    BRepMesh_IncrementalMesh(shape, 0.1, False, 0.1)
    found = TopExp_Explorer(shape, TopAbs_FACE).Current()
    face = (getattr(TopoDS, "Face_s", None) or TopoDS.Face)(found)
    mesh = BRep_Tool.Triangulation_s(face, TopLoc_Location())
    nodes = (mesh.Node(k + 1) for k in range(mesh.NbNodes()))
    points = np.array([(p.X(), p.Y(), p.Z()) for p in nodes])
    corners = (mesh.Triangle(k + 1) for k in range(mesh.NbTriangles()))
    triangles = np.array([t.Get() for t in corners], np.int64) - 1
    return points, triangles


def by_rhino3dm(path: Path) -> Triangles:
    """Triangles of the untrimmed surface in a Rhino file."""
    import rhino3dm

    model = rhino3dm.File3dm.Read(str(path))
    geometry = (item.Geometry for item in model.Objects)
    surface = next(g for g in geometry if hasattr(g, "KnotsU"))
    at = np.linspace(0, 1, 161)
    points = [surface.PointAt(float(u), float(1 - v)) for u in at for v in at]
    return np.array([(p.X, p.Y, p.Z) for p in points]), grid_triangles(161, 161)


def by_blender(path: Path) -> Triangles:
    """Triangles of a mesh file."""
    import bpy

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    read = bpy.ops.wm.obj_import if path.suffix == ".obj" else bpy.ops.wm.ply_import
    read(filepath=str(path), forward_axis="Y", up_axis="Z")
    mesh = bpy.data.meshes[0]
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    corners = np.empty(3 * len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("vertices", corners)
    return points.reshape(-1, 3).astype(float), corners.reshape(-1, 3).astype(int)


READERS: dict[str, tuple[str, Callable[[Path], Triangles]]] = {
    ".step": ("STEP by OpenCASCADE", by_opencascade),
    ".igs": ("IGES by OpenCASCADE", by_opencascade),
    ".3dm": ("3dm by rhino3dm", by_rhino3dm),
    ".obj": ("OBJ mesh by Blender", by_blender),
    ".ply": ("PLY mesh by Blender", by_blender),
}


def drawing(points: np.ndarray, triangles: np.ndarray, title: str) -> np.ndarray:
    """Front view of triangles under a title and their size."""
    normals = np.zeros_like(points)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    for k in range(3):
        np.add.at(normals, triangles[:, k], np.cross(b - a, c - a))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    grid = SurfaceGrid(points, normals, np.zeros((len(points), 2)), triangles, None)
    view = shaded_view(grid, size=SIZE, mm_per_pixel=MM_PER_PIXEL)
    head = np.full((56, SIZE[0], 3), 255, np.uint8)
    size = " x ".join(f"{x:.1f}" for x in np.ptp(points[np.unique(triangles)], axis=0))
    for row, text in enumerate((title, f"{size} mm")):
        place = (12, 22 + 22 * row)
        cv2.putText(
            head, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (30, 30, 35), 1,
            cv2.LINE_AA,
        )  # fmt: skip
    return np.concatenate([head, view])


def main(file: str | Path = FACE) -> None:
    """Make the drawing."""
    if not Path(file).is_file():
        print(f"{file} is not there (python3 dev.py demo makes it); drawing unchanged")
        return
    face = load_face(file)
    columns = []
    with tempfile.TemporaryDirectory() as folder:
        for ending, (title, reader) in READERS.items():
            try:
                path = export(Path(folder) / f"face{ending}", face, tolerance=0.1)
                points, triangles = reader(path)
            except (ImportError, ReconstructionError) as error:
                print(f"{ending}: {error}")
                continue
            size = np.ptp(points[np.unique(triangles)], axis=0)
            print(f"{title}: {len(triangles)} triangles, {size.round(2)} mm")
            columns.append(drawing(points, triangles, title))
    print(f"written: {write_png(PICTURE, np.concatenate(columns, axis=1))}")


if __name__ == "__main__":
    main(*sys.argv[1:])
    # Blender's module has hung at the end of the interpreter.
    sys.stdout.flush()
    os._exit(0)
