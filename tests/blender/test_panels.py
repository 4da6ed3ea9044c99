"""Every panel draws in every state; Blender itself draws none without a window."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import pytest
from blender import faces
from blender.checkout import load

panels = load("bsface_addon.panels")
photo_panels = load("bsface_addon.photo_panels")
photo_list = load("bsface_addon.photo_list")
session = load("bsface_addon.session")
errors = load("core.errors")
messages = load("bsface_addon.messages")
Step = load("core.progress").Step


def drawn():
    """Names of the panels that show, after drawing each with all its parts."""
    names = []
    for cls in (*photo_panels.CLASSES, *panels.CLASSES):
        if not issubclass(cls, bpy.types.Panel | bpy.types.Menu):
            continue
        if not getattr(cls, "poll", lambda context: True)(bpy.context):
            continue
        stub = SimpleNamespace(layout=MagicMock())
        cls.draw(stub, bpy.context)
        if hasattr(cls, "draw_header_preset"):
            cls.draw_header_preset(stub, bpy.context)
        names.append(cls.__name__.removeprefix("BSFACE_PT_"))
        for (kind, *_), *_ in called(stub.layout, "template_list"):
            assert hasattr(bpy.types, kind)
        for operator in operators(stub.layout):
            module, name = operator.split(".")
            assert hasattr(getattr(bpy.types, f"{module.upper()}_OT_{name}"), "bl_rna")
    return names


def called(mock, method):
    """What a method of a layout, or of one within it, was called with."""
    for name, arguments, words in mock.mock_calls:
        if name.split(".")[-1] == method:
            yield arguments, words


def operators(mock):
    """Names of the operators that were put on a layout."""
    for arguments, _ in called(mock, "operator"):
        yield arguments[0]


def test_empty_file_shows_the_first_steps_only(addon):
    assert drawn() == [
        "BSFACE_MT_photos",
        "photos",
        "reconstruct",
        "settings",
        "advanced",
        "support",
    ]


def test_photos_with_faults_show_reason_and_advice(addon, tmp_path):
    faces.photo_files(tmp_path / "photos")
    bpy.ops.bsface.photos_add(directory=str(tmp_path / "photos"))
    state = bpy.context.scene.bsface
    state.hints = "No photo from the left."
    row = state.photos[0]
    row.status, row.reason = "blurred", "0.png is blurred."
    layout = MagicMock()
    photo_panels.BSFACE_PT_photos.draw(SimpleNamespace(layout=layout), bpy.context)
    said = str(layout.mock_calls)
    for text in ("0.png is blurred.", "sharp photo", "from the left", "1 with faults"):
        assert text in said
    assert "landmarks" in drawn()
    for item in state.photos:
        stub = SimpleNamespace(layout=MagicMock())
        photo_panels.BSFACE_UL_photos.draw_item(
            stub, bpy.context, stub.layout, state, item, 0, state, "active_photo", 0
        )


def test_a_face_opens_the_later_panels(addon, solved, tmp_path):
    bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"))
    bpy.ops.bsface.view_photo()
    face = bpy.context.scene.bsface.face
    load("bsface_addon.surface_object").add_shape_key(
        face, "Smile", load("bsface_addon.surface_object").read(face)
    )
    bpy.context.scene.bsface.photos[0].expression = "Smile"
    later = ["surface", "texture", "views", "expressions", "export", "support"]
    assert drawn()[-6:] == later


def test_painting_a_mask_shows_its_brushes_alone(addon, tmp_path):
    faces.photo_files(tmp_path / "photos")
    bpy.ops.bsface.photos_add(directory=str(tmp_path / "photos"))
    bpy.ops.bsface.mask_edit()
    assert drawn() == ["BSFACE_MT_photos", "painting"]
    bpy.ops.bsface.mask_done(keep=False)
    assert "painting" not in drawn()


def test_the_list_of_keys_shows_each_with_its_value(addon, solver, tmp_path):
    bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"))
    bpy.ops.bsface.arkit_keys()
    assert "expressions" in drawn()
    keys = bpy.context.scene.bsface.face.data.shape_keys
    shown = []
    for block in keys.key_blocks[:2]:
        row = MagicMock()
        args = (bpy.context, row, keys, block, 0, None, "", 0)
        panels.BSFACE_UL_keys.draw_item(SimpleNamespace(), *args)
        shown.append([name for (_, name), _ in called(row, "prop")])
    assert shown == [["name"], ["name", "value"]]


def test_editing_landmarks_shows_how_to_end_it(addon, solved, tmp_path):
    bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"))
    bpy.ops.bsface.landmarks_edit()
    layout = MagicMock()
    assert drawn() == ["BSFACE_MT_photos", "editing"]
    photo_panels.BSFACE_PT_editing.draw(SimpleNamespace(layout=layout), bpy.context)
    assert set(operators(layout)) == {"bsface.landmarks_done"}
    bpy.ops.bsface.landmarks_done()


def test_a_running_job_shows_its_progress(addon):
    def work(progress):
        progress(Step("motion", 3, 8, 0.4, ""))

    running = session.current().start(work)
    running.wait(20)
    running.poll()
    layout = MagicMock()
    panels.BSFACE_PT_reconstruct.draw(SimpleNamespace(layout=layout), bpy.context)
    layout.progress.assert_called_once()
    assert layout.progress.call_args.kwargs["factor"] == 0.4
    assert "Placing cameras 3/8" in layout.progress.call_args.kwargs["text"]
    drawn()
    session.current().stop()


def test_every_status_of_the_core_has_words_and_advice():
    for code in errors.FailureCode:
        word, sign, advice = messages.photo_status(str(code))
        assert word == code.label and sign != "QUESTION" and advice
    assert messages.photo_status("used") == ("", "CHECKMARK", "")
    assert messages.photo_status("from 2030") == ("from 2030", "QUESTION", "")


@pytest.mark.parametrize(
    "seconds, text", [(3, "about 3 s left"), (200, "about 3 min left")]
)
def test_time_left(seconds, text):
    assert messages.duration(seconds) == text


def test_long_names_lose_their_beginning(addon):
    panel_base = load("bsface_addon.panel_base")
    name = "a_photo_with_a_very_long_name_of_its_own_0012.jpg"
    short = panel_base.shortened(bpy.context, name, 150)
    assert short.startswith("\N{HORIZONTAL ELLIPSIS}") and short.endswith("0012.jpg")
    assert panel_base.shortened(bpy.context, "1.jpg", 150) == "1.jpg"


@pytest.mark.parametrize("wide", [180, 240, 292, 500])
@pytest.mark.parametrize("expression", ["", "Smile"])
@pytest.mark.parametrize("status", ["used", *map(str, errors.FailureCode)])
def test_words_of_a_row_leave_room_for_its_name(addon, wide, expression, status):
    context = SimpleNamespace(
        region=SimpleNamespace(width=wide),
        preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=1.0)),
    )
    item = SimpleNamespace(status=status, expression=expression, mask=None)
    word, said, taken = photo_panels.words_with_room(context, item)
    room = wide - taken
    assert room >= photo_panels.LEAST_NAME or not (word or said)
    if wide == 500:
        assert (word, said) == (messages.photo_status(status)[0], expression)
    if wide == 180:
        assert (word, said) == ("", "")
    text = load("bsface_addon.panel_base").shortened(context, "portrait_01.jpg", taken)
    assert text.endswith("1.jpg")


def test_one_photo_is_not_plural():
    assert messages.added(1, 1) == "1 photo added"
    assert messages.added(2, 3) == "2 photos added, 1 in the list already"
