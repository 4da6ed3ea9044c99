"""Mode, active object and selection of the user: left for a while, and brought back."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

import bpy

# On the object of an editor: what was selected, active and its mode before it opened.
# Pointers outlive new names.
SELECTED = "bsface_selected_before"
ACTIVE = "bsface_active_before"
MODE = "bsface_mode_before"


@dataclass(frozen=True)
class Selection:
    """What the user had selected in a view layer.

    Attributes
    ----------
    chosen : tuple of objects
    active : bpy.types.Object or None
    mode : str
        Of the active object.
    """

    chosen: tuple[bpy.types.Object, ...]
    active: bpy.types.Object | None
    mode: str = "OBJECT"


def current(context: bpy.types.Context) -> Selection:
    """The selection as it is now."""
    layer = context.view_layer
    active = layer.objects.active
    chosen = tuple(obj for obj in layer.objects if obj.select_get())
    return Selection(chosen, active, "OBJECT" if active is None else active.mode)


def restore(context: bpy.types.Context, then: Selection) -> None:
    """Bring a selection back, as far as its objects are still there."""
    leave_edit_mode(context)
    layer = context.view_layer
    layer.update()
    chosen = [obj for obj in then.chosen if _exists(obj)]
    there = list(layer.objects)
    for obj in there:
        obj.select_set(obj in chosen)
    active = then.active if _exists(then.active) else None
    layer.objects.active = active if active in there else None
    if active in there and active.mode != then.mode:
        # An object that was hidden meanwhile has the mode "OBJECT" only.
        with contextlib.suppress(RuntimeError):
            bpy.ops.object.mode_set(mode=then.mode)


@contextlib.contextmanager
def object_mode(context: bpy.types.Context) -> Iterator[None]:
    """Inside: object mode and nothing selected; afterwards as it was before."""
    before = current(context)
    leave_edit_mode(context)
    for obj in before.chosen:
        obj.select_set(False)
    try:
        yield
    finally:
        restore(context, before)


def keep(editor: bpy.types.Object, before: Selection) -> None:
    """Store a selection with the object of an editor, for when it closes."""
    editor[SELECTED] = {str(i): obj for i, obj in enumerate(before.chosen)}
    editor[MODE] = before.mode
    if before.active is not None:
        editor[ACTIVE] = before.active


def kept(editor: bpy.types.Object) -> Selection:
    """What `keep` has stored."""
    active = editor.get(ACTIVE)
    stored = editor.get(SELECTED)
    # An editor that was saved by version 0.1 knows the active object alone.
    chosen = [active] if stored is None else stored.values()
    found = tuple(obj for obj in chosen if obj is not None)
    return Selection(found, active, editor.get(MODE, "OBJECT"))


def leave_edit_mode(context: bpy.types.Context) -> None:
    """Go to object mode, whatever is edited."""
    active = context.view_layer.objects.active
    if active is not None and active.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


def select_only(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Make an object the active and only selected one, and visible.

    Not where its collection is excluded from the view layer, or it is in no scene.
    """
    context.view_layer.update()
    if context.view_layer.objects.get(obj.name) != obj:
        return
    obj.hide_viewport = False
    obj.hide_set(False)
    for other in context.view_layer.objects:
        other.select_set(other == obj)
    context.view_layer.objects.active = obj


def _exists(obj: bpy.types.Object | None) -> bool:
    """Whether an object is still there: what is removed meanwhile is only a name."""
    try:
        return obj is not None and bool(obj.name)
    except ReferenceError:
        return False
