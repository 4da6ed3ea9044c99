"""Run by a Blender without a window: a mesh of `fbx_file` becomes an FBX file.

    blender --background --factory-startup --python fbx_script.py -- FOLDER
    python fbx_script.py FOLDER                              (Python with bpy)

One unit is a metre, up is y and the face looks along z, as FBX has it; the object
itself has scale 1 and no rotation.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import sys
from pathlib import Path


def main(folder: Path) -> None:
    """Write ``face.fbx`` into the folder that holds mesh, pictures and job."""
    job = json.loads((folder / "job.json").read_text("utf-8"))
    sys.path += [path for path in job["sys.path"] if path not in sys.path]
    root = Path(__file__).resolve().parents[1]
    spec = importlib.util.spec_from_file_location(
        "bsface_script", root / "__init__.py", submodule_search_locations=[str(root)]
    )
    sys.modules["bsface_script"] = importlib.util.module_from_spec(spec)
    import addon_utils
    import bpy
    import numpy as np

    fbx_file = importlib.import_module("bsface_script.bsface_addon.fbx_file")
    mesh_copy = importlib.import_module("bsface_script.bsface_addon.mesh_copy")
    QuadMesh = importlib.import_module("bsface_script.core.rig.mesh").QuadMesh
    with np.load(folder / fbx_file.MESH) as file:
        arrays = dict(file)
    made = QuadMesh(
        **{name: arrays[name] for name in ("points", "quads", "uv", "part")},
        groups={n[6:]: a for n, a in arrays.items() if n.startswith("group ")},
        keys={n[4:]: a for n, a in arrays.items() if n.startswith("key ")},
    )
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    texture, normals = (
        named(folder / file, bpy.path.clean_name(job["name"]) + end)
        for file, end in ((fbx_file.TEXTURE, ".png"), (fbx_file.NORMALS, "_normal.png"))
    )
    obj = mesh_copy.stand_alone(job["name"], made, texture, normals)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    if not addon_utils.check("io_scene_fbx")[1]:
        addon_utils.enable("io_scene_fbx")
    bpy.ops.export_scene.fbx(
        filepath=str(folder / fbx_file.RESULT),
        use_selection=True,
        object_types={"MESH"},
        use_mesh_modifiers=False,
        apply_scale_options="FBX_SCALE_UNITS",
        bake_space_transform=True,
        bake_anim=False,
        path_mode="COPY",
        embed_textures=True,
    )


def named(picture: Path, name: str) -> Path | None:
    """Rename a picture: programs that unpack the file keep the name; None for none."""
    return picture.rename(picture.with_name(name)) if picture.is_file() else None


if __name__ == "__main__":
    # The command without "--" is Python with bpy, which has hung at its end.
    main(Path(sys.argv[-1]))
    if "--" not in sys.argv:
        sys.stderr.flush()
        os._exit(0)
