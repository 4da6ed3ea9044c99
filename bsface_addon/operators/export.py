"""Files for other programs; what each format is, the core says."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from ...core.errors import ReconstructionError
from ...core.formats.options import ExportOptions
from .. import (
    export_face,
    face_file,
    face_photos,
    fbx_file,
    material,
    messages,
    scene,
)
from ..export_face import FileToWrite
from ..properties import RELATIVE
from .mesh import DENSITY, KEYS, OPENINGS
from .running import LongOperator
from .surface import ChangingOperator

FORMATS = (
    (".step", "STEP", "Trimmed B-spline surface for CAD programs"),
    (".igs", "IGES", "Trimmed B-spline surface for older CAD programs"),
    (".3dm", "Rhino", "B-spline surface and outline curve"),
    (".nurbs.obj", "OBJ, Free-Form", "B-spline surface for Maya and others"),
    (".glb", "glTF", "Quads with eyes, mouth, texture and the ARKit keys"),
    (".fbx", "FBX", "Quads with eyes, mouth, texture and the ARKit keys"),
    (".obj", "OBJ, Mesh", "Triangles with UVs and texture"),
    (".ply", "PLY, Mesh", "Triangles with UVs"),
    (".stl", "STL, Solid", "Closed solid to print"),
    (".3mf", "3MF, Solid", "Closed solid to print"),
    (".npz", "Face File", "Everything of the run, for Python"),
)
# Format -> the package that its writer needs and that not every Blender has.
NEEDS = {".3dm": "rhino3dm"}


def available(needs: Mapping[str, str] = NEEDS) -> list[tuple[str, str]]:
    """Endings and labels of the formats that can be written here."""
    return [
        (kind, label)
        for kind, label, _ in FORMATS
        if kind not in needs or find_spec(needs[kind]) is not None
    ]


class FileOperator(ChangingOperator, LongOperator):
    """Writes a file, in a window beside the UI."""

    edits = False
    filepath: StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE", *RELATIVE})
    check_existing: BoolProperty(default=True, options={"HIDDEN"})

    def invoke(self, context, event):
        face = scene.active_face(context)
        self.filepath = f"{bpy.path.clean_name(face.name)}{self.ending()}"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def chosen_path(self) -> str:
        """The file to write.

        Raises
        ------
        ReconstructionError
            There is no name in it.
        """
        path = bpy.path.abspath(self.filepath)
        if not bpy.path.display_name_from_filepath(path) or Path(path).is_dir():
            raise ReconstructionError(messages.NO_FILE_NAME.format(path=path or "."))
        return path

    def execute(self, context):
        if bpy.app.background:
            return super().execute(context)
        return self.start(context)

    @staticmethod
    def work(solver, request, progress):
        return export_face.write(request)

    def deliver(self, context, request, outcome):
        self.report({"INFO"}, messages.WROTE.format(path=outcome))


class BSFACE_OT_export(FileOperator, bpy.types.Operator):
    """Write the face in millimetres, as it is now, whatever the object's transform"""

    bl_idname = "bsface.export"
    bl_label = "Export Face"
    bl_options = {"REGISTER"}

    kind: EnumProperty(name="Format", items=FORMATS)
    trimmed: BoolProperty(
        name="Trim to the Face",
        description="Cut the surface at the outline of the face",
        default=True,
    )
    tolerance: FloatProperty(
        name="Tolerance",
        description="Of meshes: largest distance from the surface in millimetres",
        default=0.25,
        min=0.001,
        max=10.0,
    )
    texture: BoolProperty(
        name="Texture",
        description="Skin and normal map, with the OBJ mesh, in glTF and in FBX",
        default=True,
    )
    head: BoolProperty(
        name="Full Head",
        description="The whole head instead of the face, in glTF, FBX and OBJ mesh",
        default=False,
    )
    density: DENSITY
    openings: OPENINGS
    keys: KEYS
    thickness: FloatProperty(
        name="Thickness",
        description="Of the closed solids STL and 3MF, in millimetres",
        default=2.0,
        min=0.1,
        max=50.0,
    )

    def ending(self):
        return self.kind

    def check(self, context):
        changed = export_face.with_ending(self.filepath, self.kind)
        if changed == self.filepath:
            return False
        self.filepath = changed
        return True

    def prepare(self, context):
        path = self.chosen_path()
        if self.properties.is_property_set("kind"):
            path = export_face.with_ending(path, self.kind)
        face = scene.active_face(context)
        options = ExportOptions(
            trimmed=self.trimmed,
            tolerance=self.tolerance,
            name=face.name,
            head=self.head,
            density=self.density.lower(),
            keys=self.keys,
            openings=self.openings,
            thickness=self.thickness,
        )
        return FileToWrite(
            Path(path),
            face_file.stored(face),
            options,
            picture=material.packed_map(face, "SKIN") if self.texture else b"",
            blender=fbx_file.program(bpy.app.binary_path),
            detail=material.packed_map(face, material.DETAIL) if self.texture else b"",
            photos=face_photos.all_files(face),
        )


class BSFACE_OT_texture_save(FileOperator, bpy.types.Operator):
    """Write the picture that is shown on the surface to a PNG file"""

    bl_idname = "bsface.texture_save"
    bl_label = "Save Texture"
    bl_options = {"REGISTER"}

    filter_glob: StringProperty(default="*.png", options={"HIDDEN"})

    def ending(self):
        return ".png"

    def prepare(self, context):
        face = scene.active_face(context)
        picture = material.packed_map(face, material.shown(face))
        if not picture:
            raise ReconstructionError(messages.NO_MAP_SHOWN)
        path = Path(self.chosen_path())
        if path.suffix.lower() != ".png":
            # Ann.v2 is a whole name.
            path = path.with_name(f"{path.name}.png")
        photos = face_photos.all_files(face)
        return FileToWrite(path, None, ExportOptions(), picture, photos=photos)


CLASSES = (BSFACE_OT_export, BSFACE_OT_texture_save)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
