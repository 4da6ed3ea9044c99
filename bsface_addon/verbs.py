"""What the verbs of the add-on's command line do: reconstruct, export, info.

Imports stand in the functions, so that a missing package is a sentence of the verb that
needs it.
"""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path


def reconstruct(options):
    """``reconstruct PHOTOS OUT.blend``: solve, build the scene, write the files."""
    import bpy

    from ..core.errors import ReconstructionError
    from ..core.files import why_not_writable
    from ..core.images.folder import list_photos
    from ..core.report.outputs import check_outputs
    from . import arguments, session, showing
    from .apply_result import apply_result
    from .console import Console
    from .request import from_panel, parsed

    if options.out and options.output:
        raise ReconstructionError(
            f"Give one name for the result, not {options.out} and {options.output}."
        )
    given = options.output or options.out or ""
    output = Path(given)
    if output.suffix.lower() != ".blend":
        raise ReconstructionError(
            f"Give a second name that ends in .blend for the result, not {given!r}."
        )
    why = why_not_writable(output)
    if why:
        raise ReconstructionError(f"{output}: {why}.")
    npz = options.npz and Path(options.npz)
    if npz and npz.suffix.lower() not in ("", ".npz"):
        raise ReconstructionError(f"{npz}: the face file must end in .npz.")
    try:
        check_outputs(
            [str(npz.with_suffix(".npz"))] if npz else [],
            report=options.report,
            photos=options.photos,
        )
    except ValueError as error:
        raise ReconstructionError(str(error)) from None
    photos = list_photos(options.photos)
    changes = parsed(options.settings)
    if options.method:
        changes["method"] = options.method
    if options.points:
        changes["control_points"] = arguments.points(options.points)
    _empty_file(bpy)
    state = bpy.context.scene.bsface
    state.texture_size = options.texture
    request = from_panel(
        state, photos, options.name, changes, ignore=tuple(options.ignore)
    )
    console = Console(options.quiet or options.json)
    try:
        outcome = session.current().solver.solve(request, console)
    finally:
        console.close()
    face = apply_result(bpy.context, request, outcome, scale=options.size)
    if not bpy.data.filepath:
        showing.present(bpy.context, face)
    written = _write(bpy, output, outcome, options)
    return _facts(face, outcome.result, written, console.say)


def info(options):
    """``info FILE``: what a .blend or .npz file holds."""
    import bpy

    from . import scene, stored_facts, surface_object

    path = _existing(options.file)
    if path.suffix.lower() == ".npz":
        from ..core.formats import load_face
        from ..core.json_text import plain

        saved = load_face(path)
        reports, settings = plain(saved.reports), saved.settings.to_dict()
        found = [_summary(path.stem, saved.surface.shape, reports, settings)]
    else:
        _open(bpy, path)
        found = [
            _summary(
                face.name,
                surface_object.shape(face),
                scene.stored(face, stored_facts.REPORT, []),
                scene.stored(face, stored_facts.SETTINGS, {}),
            )
            for face in bpy.data.objects
            if scene.is_face(face)
        ]
    if not options.json:
        for face in found:
            _print_summary(face)
    return {"file": str(path), "faces": found}


def export(options):
    """``export FILE OUT``: a face of a .blend or .npz in another format."""
    import bpy

    from ..core.errors import ReconstructionError
    from ..core.formats import export as write
    from ..core.formats.options import ExportOptions
    from ..core.report.outputs import check_inputs, files_of
    from . import export_face, face_file, face_photos, fbx_file, material, scene

    path, target = _existing(options.file), Path(options.out)
    trimmed = not options.untrimmed
    if path.suffix.lower() == ".npz":
        from ..core.formats import load_face

        try:
            check_inputs(files_of(target), read=[path])
        except ValueError as error:
            raise ReconstructionError(str(error)) from None
        face = load_face(path)
        written = write(target, face, trimmed=trimmed, tolerance=options.tolerance)
        return _wrote(written)
    _open(bpy, path)
    found = {face.name: face for face in bpy.data.objects if scene.is_face(face)}
    if not found:
        raise ReconstructionError(f"{path.name} holds no face made by BSface.")
    name = options.name or next(iter(found))
    if name not in found:
        raise ReconstructionError(
            f"{path.name} holds no face {name!r}; it holds {', '.join(found)}."
        )
    wanted = export_face.FileToWrite(
        target,
        face_file.stored(found[name]),
        ExportOptions(trimmed=trimmed, tolerance=options.tolerance, name=name),
        picture=material.packed_map(found[name], "SKIN"),
        blender=fbx_file.program(bpy.app.binary_path),
        detail=material.packed_map(found[name], material.DETAIL),
        photos=face_photos.all_files(found[name]),
        read=(path,),
    )
    return _wrote(export_face.write(wanted))


def _wrote(path):
    print(f"wrote {path}", file=sys.stderr, flush=True)
    return {"written": [str(path)]}


VERBS = {"reconstruct": reconstruct, "export": export, "info": info}


def _existing(name):
    from ..core.errors import ReconstructionError

    path = Path(name)
    if not path.is_file():
        raise ReconstructionError(f"There is no file {name}; give a .blend or .npz.")
    return path.resolve()


def _open(bpy, path):
    from ..core.errors import ReconstructionError

    try:
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False)
    except RuntimeError:
        raise ReconstructionError(
            f"{path.name} is not a .blend file that this Blender can open."
        ) from None


def _empty_file(bpy):
    """A file with nothing in it, unless one was opened on the command line."""
    if not bpy.data.filepath:
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    if not hasattr(bpy.types.Scene, "bsface"):
        from . import register

        register()


def _write(bpy, output, outcome, options):
    """Write what was asked for; each file appears whole or not at all."""
    from ..core.files import replacing

    written = [output]
    with replacing(output) as temporary:
        _relative_images(bpy, output.resolve().parent)
        temporary.unlink()  # or Blender keeps it as a backup, .blend1
        bpy.ops.wm.save_as_mainfile(
            filepath=str(temporary.resolve()), compress=True, relative_remap=True
        )
    if options.npz:
        written.append(outcome.result.save(options.npz))
    if options.report:
        from ..core.report.report import report_files, write_report

        page = write_report(
            options.report,
            outcome.result,
            title=options.name or None,
            texture=outcome.texture,
        )
        written += report_files(page)
    return [str(path) for path in written]


def _relative_images(bpy, folder):
    """Photos are found again when the file moves together with them.

    Paths that are relative already are Blender's to keep right, as those of libraries
    are: it takes them for relative to the file that was opened.
    """
    opened = bpy.data.filepath
    start = str(Path(opened).resolve().parent) if opened else str(folder)
    for image in bpy.data.images:
        path = image.filepath
        if image.source != "FILE" or image.packed_file or not path:
            continue
        if not path.startswith("//"):
            with contextlib.suppress(ValueError):  # on another drive
                image.filepath = bpy.path.relpath(path, start=start)


def _facts(face, result, written, say):
    from . import messages

    say(messages.done(face, result.reports))
    for report in result.reports:
        if report.status != "used":
            say(f"  left out: {report.reason or report.name}")
    for warning in result.warnings:
        say(f"  note: {warning}")
    for path in written:
        say(f"  wrote {path}")
    from ..core.report.facts import result_facts

    return result_facts(result, files=written) | {"face": face.name}


def _summary(name, shape, report, settings):
    used = [row for row in report if row.get("status") == "used"]
    return {
        "name": name,
        "control_points": list(shape),
        "photos": len(report),
        "used": len(used),
        "settings": settings,
        "report": report,
    }


def _print_summary(face):
    across, down = face["control_points"]
    print(f"{face['name']}: {across} x {down} control points")
    print(f"  {face['used']} of {face['photos']} photos used")
    for row in face["report"]:
        if row.get("status") != "used":
            print(f"  {row['name']}: {row.get('reason') or row.get('status')}")
