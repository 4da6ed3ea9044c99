"""The tint over a photo that one looks at, where it is not skin of the face.

Each camera keeps the measured mask of its photo.  The camera that one looks through
shows it: the photo once more, in front of the surface, and the tint over it.
"""

from __future__ import annotations

import bpy

from . import cameras, photo_list, skin_pictures
from .packed_image import packed_image

# On the picture of the tint.
MARK = "bsface_tint"


def measured(face: bpy.types.Object | None, photo: str) -> bytes:
    """The measured mask of a photo of a face; empty where none is known."""
    for view in [] if face is None else cameras.of_face(face):
        if view[cameras.PHOTO_KEY] == photo:
            return view.get(cameras.SKIN_KEY, b"")
    return b""


def refresh(context: bpy.types.Context, face: bpy.types.Object | None) -> None:
    """Tint the photo that one looks through, if that is switched on; no other."""
    state, now = context.scene.bsface, context.scene.camera
    for view in [] if face is None else cameras.of_face(face):
        if not _is_own(view):
            continue  # what is done to a linked camera is not saved, or not done
        hide(view)
        known = view.get(cameras.SKIN_KEY)
        if view == now and state.show_skin and known:
            rows = {row.name: row for row in state.photos}
            row = rows.get(view[cameras.PHOTO_KEY])
            painted = b"" if row is None else photo_list.mask(row)
            _show(view, skin_pictures.tint(known, painted))


def _is_own(view: bpy.types.Object) -> bool:
    return view.data.library is None and view.data.override_library is None


def _show(view: bpy.types.Object, tint: bytes) -> None:
    slots = view.data.background_images
    if not slots:
        return  # the photo cannot be shown
    # The first stays as the user has it: before the surface or behind it.
    photo, again, over = slots[0], slots.new(), slots.new()
    for name in ("image", "frame_method", "rotation", "scale", "use_flip_x"):
        setattr(again, name, getattr(photo, name))
    over.image = packed_image(f"{view.name} skin", tint)
    over.image[MARK] = True
    over.frame_method = "FIT"
    for slot in (again, over):
        slot.display_depth, slot.alpha = "FRONT", 1.0


def hide(view: bpy.types.Object) -> None:
    """Take the tint off the photo of a camera."""
    slots = view.data.background_images
    images = [s.image for s in slots if s.image is not None and MARK in s.image]
    for slot in list(slots)[:0:-1]:
        slot.image = None  # Blender would go on counting it as used
        slots.remove(slot)
    for image in images:
        if image.users == 0:
            bpy.data.images.remove(image)
