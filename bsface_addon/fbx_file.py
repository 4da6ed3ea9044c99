"""FBX files, by Blender's own exporter in a second Blender without a window.

The exporter belongs to Blender's main thread and takes seconds; in a Blender of its own
(`fbx_script.py`) it does not stop the artist's.  No Blender in this module.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ..core.errors import ReconstructionError
from ..core.files import temporary_folder, write_bytes
from ..core.rig.mesh import QuadMesh

ENDING = ".fbx"
SCRIPT = Path(__file__).with_name("fbx_script.py")
MESH, JOB, RESULT = "mesh.npz", "job.json", "face.fbx"
TEXTURE, NORMALS = "texture.png", "normal.png"


def program(binary: str) -> tuple[str, ...]:
    """The command that runs a Python script in Blender.

    Parameters
    ----------
    binary : str
        ``bpy.app.binary_path``; empty in Blender's Python module.
    """
    if binary:
        return (binary, "--background", "--factory-startup", "--python-exit-code", "1")
    return (sys.executable,)


def write_fbx(
    path: Path,
    mesh: QuadMesh,
    name: str,
    program: Sequence[str],
    pictures: Mapping[str, bytes],
) -> Path:
    """Write a mesh with its keys and its pictures.

    Parameters
    ----------
    program : sequence of str
        See `program`.
    pictures : mapping
        `TEXTURE`, `NORMALS`, or none of them -> a PNG whose top row is v = 0; the
        normal map has green up.

    Raises
    ------
    ReconstructionError
        Blender could not write it, or there is no place for the file.
    """
    with temporary_folder() as folder:
        groups = {f"group {key}": found for key, found in mesh.groups.items()}
        keys = {f"key {key}": moved for key, moved in mesh.keys.items()}
        arrays = {"points": mesh.points, "quads": mesh.quads, "uv": mesh.uv}
        np.savez(folder / MESH, part=mesh.part, **arrays, **groups, **keys)
        for file, picture in pictures.items():
            (folder / file).write_bytes(picture)
        # The packages of the extension are not on the path of another Blender.
        job = {"name": name, "sys.path": sys.path}
        (folder / JOB).write_text(json.dumps(job), "utf-8")
        blender = len(program) > 1
        run = subprocess.run(
            [*program, *(["--python"] if blender else []), str(SCRIPT)]
            + [*(["--"] if blender else []), str(folder)],
            capture_output=True,
            text=True,
            errors="replace",
        )
        if not (folder / RESULT).is_file():
            said = [line for line in run.stderr.splitlines() if line.strip()]
            why = said[-1].strip() if said else f"exit code {run.returncode}"
            raise ReconstructionError(
                f"{path}: Blender could not write this file ({why}); "
                "write glTF instead."
            )
        return write_bytes(path, (folder / RESULT).read_bytes())
