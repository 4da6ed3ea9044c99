"""What is skin: the tint over the photos, the paint, its files, its way into a run."""

import dataclasses

import bpy
import cv2
import numpy as np
import pytest
from blender import faces
from blender.checkout import load

cameras = load("bsface_addon.cameras")
mask_editor = load("bsface_addon.mask_editor")
photo_list = load("bsface_addon.photo_list")
scene = load("bsface_addon.scene")
skin_overlay = load("bsface_addon.skin_overlay")
skin_pictures = load("bsface_addon.skin_pictures")
solving = load("bsface_addon.solving")
mask_file = load("core.images.mask_file")
SkinMask = load("core.photometry.skin").SkinMask
Photo = load("core.images.photo").Photo

WIDTH, HEIGHT = faces.SIZE


@pytest.fixture
def rows(addon, solved, tmp_path):
    """Three photos in the list."""
    bpy.ops.bsface.photos_add(directory=str(tmp_path / "photos"))
    return bpy.context.scene.bsface.photos


@pytest.fixture
def face(rows, solver):
    """A face; of each photo the left half counts as skin."""
    half = np.tile(np.repeat(np.float32([1, 0]), WIDTH // 8), (HEIGHT // 4, 1))
    skin = {
        photo.name: skin_pictures.measured(SkinMask(half, (0.0, 0.0, 0.25)), photo)
        for photo in solver.answer.result.photos
    }
    solver.answer = dataclasses.replace(solver.answer, skin=skin)
    bpy.ops.bsface.reconstruct()
    solver.requests.clear()
    return bpy.context.scene.bsface.face


def strokes():
    """The image that is being painted."""
    obj = mask_editor.editor()
    return obj.data.materials[0].node_tree.nodes["Strokes"].image


def paint(columns, rgba):
    """Give columns of the open image a colour, as a brush would."""
    image = strokes()
    width, height = image.size
    pixels = np.empty(4 * width * height, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(height, width, 4)
    pixels[:, columns] = rgba
    image.pixels.foreach_set(pixels.ravel())


def decoded(data):
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)


def tint():
    """RGBA of the picture over the photo that one looks through, or None."""
    slots = bpy.context.scene.camera.data.background_images
    if len(slots) == 1:
        return None
    return decoded(slots[2].image.packed_file.data)


# --- pictures ------------------------------------------------------------------------


def test_the_measured_mask_covers_the_whole_photo():
    photo = Photo("a", None, (1000, 400), np.zeros((1, 1, 3), np.uint8))
    mask = SkinMask(np.ones((20, 30), np.float32), (200.0, 100.0, 0.1))
    grey = decoded(skin_pictures.measured(mask, photo))
    assert grey.shape == (205, 512)
    y, x = np.nonzero(grey)
    scale = 0.512
    box = np.array([x.min(), y.min(), x.max() + 1, y.max() + 1]) / scale
    np.testing.assert_allclose(box, [200, 100, 500, 300], atol=2 / scale)
    assert set(np.unique(grey)) == {0, 255}
    # The measurement is shown, not what the photo's own mask made of it.
    black = dataclasses.replace(
        mask, values=np.zeros_like(mask.values), measured=mask.values
    )
    np.testing.assert_array_equal(decoded(skin_pictures.measured(black, photo)), grey)


def test_paint_and_mask_say_the_same():
    levels = np.linspace(0, 1, 256, dtype=np.float32).reshape(16, 16)
    again = mask_file.decode_mask(
        skin_pictures.to_mask(skin_pictures.to_strokes(levels))
    )
    told = np.abs(levels - 0.5) > mask_file.SILENT
    np.testing.assert_allclose(again[told], levels[told], atol=1e-6)
    nothing = np.zeros((4, 4, 4), np.float32)
    assert skin_pictures.to_mask(nothing) == b""


# --- the tint ------------------------------------------------------------------------


def test_the_tint_lies_over_the_photo_that_one_looks_through(face):
    state = bpy.context.scene.bsface
    state.active_photo = 1
    bpy.ops.bsface.view_leave()
    bpy.ops.bsface.skin_show()
    camera = bpy.context.scene.camera
    assert camera[cameras.PHOTO_KEY] == "1.png"
    opacity = tint()[..., 3]
    half = opacity.shape[1] // 2
    assert opacity[:, : half - 2].max() < 70 and opacity[:, half + 2 :].min() > 80
    slots = camera.data.background_images
    assert [slot.display_depth for slot in slots] == ["BACK", "FRONT", "FRONT"]
    assert slots[1].image == slots[0].image
    bpy.ops.bsface.view_photo()
    assert len(camera.data.background_images) == 1 and tint() is not None
    # What the user says of the photo concerns the photo alone.
    bpy.ops.bsface.view_front(front=True)
    bpy.ops.bsface.view_front(front=False)
    assert [s.display_depth for s in bpy.context.scene.camera.data.background_images][
        1:
    ] == ["FRONT", "FRONT"]
    bpy.ops.bsface.skin_show(show=False)
    assert tint() is None
    assert not [image for image in bpy.data.images if skin_overlay.MARK in image]


def test_a_new_run_and_leaving_clear_the_tint(face):
    bpy.ops.bsface.skin_show()
    bpy.ops.bsface.reconstruct()
    assert tint() is not None
    assert len([i for i in bpy.data.images if skin_overlay.MARK in i]) == 1
    bpy.ops.bsface.view_leave()
    assert not [image for image in bpy.data.images if skin_overlay.MARK in image]
    bpy.ops.bsface.skin_show()
    bpy.ops.bsface.face_remove()
    assert not [image for image in bpy.data.images if skin_overlay.MARK in image]


def test_without_masks_the_button_says_so(rows, solver):
    bpy.ops.bsface.reconstruct()
    bpy.ops.bsface.skin_show()
    assert tint() is None


# --- the paint -----------------------------------------------------------------------


def test_paint_goes_into_the_next_run_and_into_the_tint(face, rows, solver):
    bpy.ops.bsface.skin_show()
    assert bpy.ops.bsface.mask_edit(photo="0.png") == {"FINISHED"}
    obj = mask_editor.editor()
    assert obj.mode == "TEXTURE_PAINT"
    assert bpy.context.tool_settings.image_paint.canvas == strokes()
    assert tuple(strokes().size) == faces.SIZE
    paint(slice(0, WIDTH // 4), (0, 0, 0, 1))
    paint(slice(3 * WIDTH // 4, WIDTH), (1, 1, 1, 1))
    bpy.ops.bsface.mask_done()
    assert mask_editor.editor() is None
    bpy.ops.bsface.reconstruct()
    (request,) = solver.requests
    assert list(request.masks) == ["0.png"]
    mask = mask_file.decode_mask(request.masks["0.png"])
    expected = np.repeat([0, 0.5, 0.5, 1], WIDTH // 4)
    np.testing.assert_array_equal(mask, np.tile(expected, (HEIGHT, 1)))
    # Measured: the left half is skin.
    bpy.ops.bsface.view_photo(direction="NAMED", photo="0.png")
    columns = tint()[..., 3].mean(axis=0).reshape(4, -1)[:, 2:-2].mean(axis=1)
    top = 255 * skin_pictures.OPACITY
    np.testing.assert_allclose(columns / top, [1, 0.25, 0.75, 0], atol=0.26)
    assert columns[0] > 0.95 * top and columns[3] < 0.05 * top


def test_paint_can_be_taken_up_again_and_taken_off(face, rows):
    bpy.ops.bsface.mask_edit(photo="0.png")
    paint(slice(0, 40), (0, 0, 0, 1))
    bpy.ops.bsface.mask_done()
    first = photo_list.mask(rows[0])
    bpy.ops.bsface.mask_edit(photo="0.png")
    bpy.ops.bsface.mask_done()
    assert photo_list.mask(rows[0]) == first
    bpy.ops.bsface.mask_edit(photo="0.png")
    paint(slice(0, WIDTH), (1, 1, 1, 1))
    bpy.ops.bsface.mask_done(keep=False)
    assert photo_list.mask(rows[0]) == first
    bpy.ops.bsface.mask_edit(photo="0.png")
    paint(slice(0, WIDTH), (0, 0, 0, 0))
    bpy.ops.bsface.mask_done()
    assert rows[0].mask is None
    assert not [image for image in bpy.data.images if image.name.endswith("mask")]


@pytest.mark.parametrize("keep", [True, False])
def test_leaving_the_paint_leaves_nothing(face, rows, keep):
    kinds = ("objects", "meshes", "cameras", "materials", "images", "brushes")

    def names():
        return {kind: sorted(d.name for d in getattr(bpy.data, kind)) for kind in kinds}

    tools, now = bpy.context.tool_settings, bpy.context.scene
    # Blender makes its own brushes when painting begins for the first time.
    bpy.ops.bsface.mask_edit(photo="1.png")
    bpy.ops.bsface.mask_done(keep=False)
    before, camera = names(), now.camera
    transform = now.view_settings.view_transform
    size = mask_editor.unified(bpy.context).size
    bpy.ops.bsface.mask_edit(photo="1.png")
    assert now.view_settings.view_transform == "Standard"
    bpy.ops.bsface.mask_done(keep=keep)
    assert names() == before and now.camera == camera
    assert now.view_settings.view_transform == transform
    assert mask_editor.unified(bpy.context).size == size
    assert (tools.image_paint.mode, tools.image_paint.canvas) == ("MATERIAL", None)
    assert bpy.context.view_layer.objects.active == face and face.mode == "OBJECT"
    assert not bpy.ops.bsface.mask_done.poll()


def test_brushes(face):
    bpy.ops.bsface.mask_edit(photo="0.png")
    brush = bpy.context.tool_settings.image_paint
    for kind, colour, blend in (
        ("SKIN", 1, "MIX"),
        ("MEASURED", 0, "ERASE_ALPHA"),
        ("OTHER", 0, "MIX"),
    ):
        bpy.ops.bsface.mask_brush(kind=kind)
        assert mask_editor.chosen(bpy.context) == kind
        assert brush.brush.blend == blend
        assert tuple(brush.brush.color) == (colour,) * 3
    bpy.ops.bsface.mask_done(keep=False)
    assert not bpy.ops.bsface.mask_brush.poll()


def test_a_photo_is_painted_before_the_first_run_too(rows):
    bpy.ops.bsface.mask_edit(photo="2.png")
    assert not bpy.ops.bsface.mask_edit.poll() and not bpy.ops.bsface.skin_show.poll()
    paint(slice(0, 9), (0, 0, 0, 1))
    bpy.ops.bsface.mask_done()
    assert list(photo_list.known_masks(bpy.context.scene.bsface)) == ["2.png"]


def test_what_cannot_be_painted_is_told_in_one_sentence(rows, tmp_path):
    (tmp_path / "photos" / "0.mask.png").write_bytes(b"nothing")
    with pytest.raises(RuntimeError, match=r"0\.mask\.png"):
        bpy.ops.bsface.mask_edit(photo="0.png")
    (tmp_path / "photos" / "1.png").write_bytes(b"nothing")
    with pytest.raises(RuntimeError, match=r"1\.png"):
        bpy.ops.bsface.mask_edit(photo="1.png")
    assert mask_editor.editor() is None and not bpy.data.objects
    assert not bpy.ops.bsface.mask_save.poll() and not bpy.ops.bsface.mask_clear.poll()


# --- files ---------------------------------------------------------------------------


def test_masks_are_saved_with_the_file_and_beside_the_photos(face, rows, tmp_path):
    bpy.ops.bsface.mask_edit(photo="0.png")
    paint(slice(0, 40), (0, 0, 0, 1))
    bpy.ops.bsface.mask_done()
    painted = photo_list.mask(rows[0])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    row = bpy.context.scene.bsface.photos[0]
    assert photo_list.mask(row) == painted
    bpy.ops.bsface.mask_save()
    path = tmp_path / "photos" / "0.mask.png"
    assert path.read_bytes() == painted
    assert mask_file.mask_file_beside(photo_list.absolute(row)) == path
    # Without the paint the file counts, and it is where painting starts.
    bpy.ops.bsface.mask_clear()
    assert row.mask is None
    bpy.ops.bsface.mask_edit(photo="0.png")
    bpy.ops.bsface.mask_done()
    assert photo_list.mask(row) == painted


def test_the_mask_of_a_turned_copy_fits_the_file_it_was_made_of(rows, tmp_path):
    bpy.context.scene.bsface.active_photo = 1
    bpy.ops.bsface.photos_turn(quarters=1)
    bpy.ops.bsface.mask_edit()
    assert tuple(strokes().size) == (HEIGHT, WIDTH)
    paint(slice(HEIGHT - 50, HEIGHT), (0, 0, 0, 1))  # its right: the file's top
    bpy.ops.bsface.mask_done()
    bpy.ops.bsface.mask_save()
    grey = cv2.imread(str(tmp_path / "photos" / "1.mask.png"), cv2.IMREAD_UNCHANGED)
    assert grey.shape == (HEIGHT, WIDTH)
    assert (grey[:50] == 0).all() and (grey[50:] == 128).all()


def test_a_mask_file_that_is_replaced_is_told(rows, tmp_path, capfd):
    path = tmp_path / "photos" / "0.mask.png"
    grey = cv2.imencode(".png", np.full((HEIGHT, WIDTH), 255, np.uint8))[1].tobytes()
    path.write_bytes(grey)
    bpy.ops.bsface.mask_edit(photo="0.png")
    paint(slice(0, 40), (0, 0, 0, 1))
    bpy.ops.bsface.mask_done()
    for said in ("; 1 other file of that name replaced", "beside the photos\n"):
        capfd.readouterr()
        bpy.ops.bsface.mask_save()
        assert said in capfd.readouterr().out
    assert path.read_bytes() != grey


def test_another_picture_in_the_row_has_no_mask(face, rows, tmp_path):
    bpy.ops.bsface.mask_edit(photo="0.png")
    paint(slice(0, 40), (0, 0, 0, 1))
    bpy.ops.bsface.mask_done()
    bpy.ops.bsface.photos_replace(
        photo="0.png", filepath=str(tmp_path / "photos" / "1.png")
    )
    assert rows[0].mask is None


# --- the real thing ------------------------------------------------------------------


def test_half_of_a_face_painted_out_is_not_skin_in_the_run(
    addon, tmp_path, example_photos
):
    """No fakes: the paint changes the mask of this photo, and of no other."""
    example_photos(tmp_path, (3, 8))
    bpy.ops.bsface.photos_add(directory=str(tmp_path))
    state = bpy.context.scene.bsface
    state.settings.method, state.texture_size = "motion", "512"
    state.settings.control_points_u = state.settings.control_points_v = 12
    seen = []

    class Solver(solving.Solver):
        def solve(self, request, progress=None):
            seen.append(super().solve(request, progress))
            return seen[-1]

    now = load("bsface_addon.session").current()
    real, now.solver = now.solver, Solver()
    try:
        bpy.ops.bsface.mask_edit(photo="008.jpg")
        middle = strokes().size[0] // 2
        paint(slice(0, middle), (0, 0, 0, 1))
        bpy.ops.bsface.mask_done()
        bpy.ops.bsface.reconstruct()
    finally:
        now.solver = real
    (outcome,) = seen
    for photo, mask in zip(outcome.result.photos, outcome.texture.skin, strict=True):
        if photo.name != "008.jpg":
            assert mask.measured is None
            continue
        x0, _, scale = mask.window
        edge = round((middle - x0) * scale)
        left, right = slice(0, edge - 2), slice(edge + 3, None)
        assert mask.measured[:, left].mean() > 0.2
        assert mask.values[:, left].max() < 0.02
        np.testing.assert_array_equal(mask.values[:, right], mask.measured[:, right])
    # The tint shows what was measured with the paint over it.
    bpy.ops.bsface.skin_show()
    bpy.ops.bsface.view_photo(direction="NAMED", photo="008.jpg")
    opacity = tint()[..., 3]
    half = opacity.shape[1] // 2
    assert opacity[:, : half - 2].min() > 250 * skin_pictures.OPACITY
    assert opacity[:, half + 2 :].min() == 0
