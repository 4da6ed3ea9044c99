"""Files for other programs; what each format is, the core says."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from ...core.errors import ReconstructionError
from .. import export_face, material, messages, scene
from .surface import FaceOperator

FORMATS = (
    (".step", "STEP", "Trimmed B-spline surface for CAD programs"),
    (".igs", "IGES", "Trimmed B-spline surface for older CAD programs"),
    (".3dm", "Rhino", "B-spline surface and outline curve"),
    (".nurbs.obj", "OBJ, Free-Form", "B-spline surface for Maya and others"),
    (".obj", "OBJ, Mesh", "Triangles with UVs"),
    (".ply", "PLY, Mesh", "Triangles with UVs"),
    (".npz", "Face File", "Everything of the run, for Python"),
)


class BSFACE_OT_export(FaceOperator, bpy.types.Operator):
    """Write the face in millimetres, as it is now, whatever the object's transform"""

    bl_idname = "bsface.export"
    bl_label = "Export Face"
    bl_options = {"REGISTER"}

    filepath: StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})
    kind: EnumProperty(name="Format", items=FORMATS)
    trimmed: BoolProperty(
        name="Trim to the Face",
        description="Cut the surface at the outline of the face",
        default=True,
    )
    tolerance: FloatProperty(
        name="Tolerance",
        description="Of meshes: largest distance from the surface in millimetres",
        default=0.05,
        min=0.001,
        max=10.0,
    )
    check_existing: BoolProperty(default=True, options={"HIDDEN"})

    def invoke(self, context, event):
        face = scene.active_face(context)
        self.filepath = f"{bpy.path.clean_name(face.name)}{self.kind}"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def check(self, context):
        changed = export_face.with_ending(self.filepath, self.kind)
        if changed == self.filepath:
            return False
        self.filepath = changed
        return True

    def execute(self, context):
        path = bpy.path.abspath(self.filepath)
        if self.properties.is_property_set("kind"):
            path = export_face.with_ending(path, self.kind)
        face = scene.active_face(context)
        try:
            written = export_face.write(Path(path), face, self.trimmed, self.tolerance)
        except ReconstructionError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, messages.WROTE.format(path=written))
        return {"FINISHED"}


class BSFACE_OT_texture_save(FaceOperator, bpy.types.Operator):
    """Write the picture that is shown on the surface to a PNG file"""

    bl_idname = "bsface.texture_save"
    bl_label = "Save Texture"
    bl_options = {"REGISTER"}

    filepath: StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: StringProperty(default="*.png", options={"HIDDEN"})
    check_existing: BoolProperty(default=True, options={"HIDDEN"})

    def invoke(self, context, event):
        face = scene.active_face(context)
        self.filepath = f"{bpy.path.clean_name(face.name)}.png"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        face = scene.active_face(context)
        image = material.stored_map(face, material.shown(face))
        if image is None:
            self.report({"ERROR"}, messages.NO_MAP_SHOWN)
            return {"CANCELLED"}
        try:
            path = Path(bpy.path.abspath(self.filepath)).with_suffix(".png")
            written = export_face.write_image(path, image)
        except ReconstructionError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, messages.WROTE.format(path=written))
        return {"FINISHED"}


CLASSES = (BSFACE_OT_export, BSFACE_OT_texture_save)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
