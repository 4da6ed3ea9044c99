"""The photo list and its operators."""

import sys
from pathlib import Path

import bpy
import cv2
import numpy as np
import pytest
from blender import faces
from blender.checkout import load

photo_list = load("bsface_addon.photo_list")
landmarks = load("core.landmarks.landmarks")
cameras = load("bsface_addon.cameras")


@pytest.fixture
def rows(addon, tmp_path):
    """Three photos in the list."""
    faces.photo_files(tmp_path / "photos")
    bpy.ops.bsface.photos_add(directory=str(tmp_path / "photos"))
    return bpy.context.scene.bsface.photos


def names():
    return [row.name for row in bpy.context.scene.bsface.photos]


def test_a_folder_without_a_choice_is_added_whole(rows):
    assert names() == ["0.png", "1.png", "2.png"]
    assert all(row.use and row.status == "waiting" for row in rows)


def test_chosen_files_are_added_once(rows, tmp_path):
    folder = str(tmp_path / "photos")
    bpy.ops.bsface.photos_add(directory=folder, files=[{"name": "1.png"}])
    assert len(rows) == 3
    bpy.ops.bsface.photos_clear()
    bpy.ops.bsface.photos_add(
        directory=folder, files=[{"name": "2.png"}, {"name": "0.png"}]
    )
    assert names() == ["2.png", "0.png"]


def test_same_names_of_two_folders_are_told_apart_as_the_core_does(rows, tmp_path):
    faces.photo_files(tmp_path / "more")
    bpy.ops.bsface.photos_add(directory=str(tmp_path / "more"))
    photo_sources = load("core.images.sources").photo_sources
    paths = photo_list.paths(bpy.context.scene.bsface)
    assert names() == [name for name, _ in photo_sources(paths, False)[0]]
    assert len(set(names())) == 6


def test_a_chosen_folder_is_added_whole(addon, tmp_path):
    faces.photo_files(tmp_path / "photos")
    bpy.ops.bsface.photos_add(directory=str(tmp_path), files=[{"name": "photos"}])
    assert names() == ["0.png", "1.png", "2.png"]


def test_a_folder_without_photos_is_refused_in_one_sentence(addon, tmp_path):
    with pytest.raises(RuntimeError, match="holds no photos"):
        bpy.ops.bsface.photos_add(directory=str(tmp_path))


def test_remove_replace_and_clear(rows, tmp_path):
    bpy.ops.bsface.photos_remove(photo="1.png")
    assert names() == ["0.png", "2.png"]
    rows[1].status, rows[1].reason, rows[1].landmarks = "dark", "too dark", "{}"
    bpy.ops.bsface.photos_replace(
        photo="2.png", filepath=str(tmp_path / "photos" / "1.png")
    )
    assert names() == ["0.png", "1.png"]
    assert (rows[1].status, rows[1].reason, rows[1].landmarks) == ("waiting", "", "")
    with pytest.raises(RuntimeError, match="no file"):
        bpy.ops.bsface.photos_replace(photo="1.png", filepath=str(tmp_path / "no.png"))
    with pytest.raises(RuntimeError, match="no photo"):
        bpy.ops.bsface.photos_remove(photo="9.png")
    bpy.ops.bsface.photos_clear()
    assert not rows and not bpy.ops.bsface.photos_remove.poll()


def test_the_last_row_removed_moves_the_active_row_up(rows):
    state = bpy.context.scene.bsface
    state.active_photo = 2
    bpy.ops.bsface.photos_remove()
    assert names() == ["0.png", "1.png"] and state.active_photo == 1


@pytest.mark.parametrize(
    "which, expected",
    [
        ("ALL", [True, True, True]),
        ("NONE", [False, False, False]),
        ("INVERT", [False, True, False]),
        ("GOOD", [True, True, False]),
    ],
)
def test_ticking_several_rows(rows, which, expected):
    rows[1].use = False
    rows[2].status = "blurred"
    bpy.ops.bsface.photos_use(which=which)
    assert [row.use for row in rows] == expected


def test_turning_makes_a_copy_and_four_turns_come_back(rows, tmp_path):
    picture = np.random.default_rng(0).integers(0, 255, (40, 60, 3), np.uint8)
    path = tmp_path / "photos" / "1.png"
    cv2.imwrite(str(path), picture)
    before = path.read_bytes()
    state = bpy.context.scene.bsface
    state.active_photo = 1
    bpy.ops.bsface.photos_turn(quarters=1)
    turned = cv2.imread(str(photo_list.absolute(rows[1])))
    np.testing.assert_array_equal(turned, np.rot90(picture, -1))
    bpy.ops.bsface.photos_turn(quarters=2)
    turned = cv2.imread(str(photo_list.absolute(rows[1])))
    np.testing.assert_array_equal(turned, np.rot90(picture, 1))
    bpy.ops.bsface.photos_turn(quarters=1)
    assert photo_list.absolute(rows[1]) == path and rows[1].quarters == 0
    assert path.read_bytes() == before
    assert names()[1] == "1.png"


def test_what_a_person_gave_is_turned_with_the_photo(rows, tmp_path):
    photo = str(tmp_path / "photos" / "0.png")
    width, height = faces.SIZE
    mark = (30, 70)  # x and y of the only white pixel of the photo
    picture = np.zeros((height, width), np.uint8)
    picture[mark[1], mark[0]] = 255
    cv2.imwrite(photo, picture)
    cv2.imwrite(str(tmp_path / "photos" / "0.mask.png"), 255 - picture)
    row = rows[0]
    points = np.tile(mark, (40, 1)) + np.eye(40, 2)
    given = landmarks.Landmarks("0.png", "40", points, np.ones(40), source="hand")
    landmarks.write_landmarks(tmp_path / "photos" / "0.json", given)
    photo_list.keep_landmarks(row, given)
    painted = np.full((height, width), 128, np.uint8)
    painted[mark[1], mark[0]] = 255
    photo_list.keep_mask(row, cv2.imencode(".png", painted)[1].tobytes())
    for quarters in (1, 1, 1, 1):
        bpy.ops.bsface.photos_turn(quarters=quarters)
        path = photo_list.absolute(row)
        shown = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        (y,), (x,) = np.nonzero(shown)
        known = photo_list.landmarks(row).points
        np.testing.assert_allclose(known[2:], [(x, y)] * 38)
        assert photo_list.landmarks(row).source == "hand" and row.status == "found"
        mask = cv2.imdecode(np.frombuffer(photo_list.mask(row), np.uint8), 0)
        assert mask.shape == shown.shape and mask[y, x] == 255
        # The files beside it count for the copy too.
        beside = cv2.imread(str(path.with_suffix(".mask.png")), cv2.IMREAD_GRAYSCALE)
        np.testing.assert_array_equal(beside, 255 - shown)
        found = landmarks.read_landmarks(path.with_suffix(".json"))
        np.testing.assert_allclose(found.points, known)
    assert path == Path(photo) and (x, y) == mark


def test_an_unreadable_photo_cannot_be_turned(rows, tmp_path):
    (tmp_path / "photos" / "0.png").write_bytes(b"nothing")
    with pytest.raises(RuntimeError, match=r"0\.png"):
        bpy.ops.bsface.photos_turn(photo="0.png")


def test_unticked_and_expressive_photos_stay_out_of_the_neutral_run(rows):
    rows[0].use = False
    rows[1].expression = "Smile"
    state = bpy.context.scene.bsface
    assert photo_list.ignored(state) == ("0.png", "1.png")
    assert photo_list.counts(state) == {"all": 3, "use": 2, "failed": 0, "used": 0}


def test_images_dropped_into_the_view_go_to_the_same_operator():
    handler = bpy.types.BSFACE_FH_photos
    assert handler.bl_import_operator == "bsface.photos_add"
    assert ".jpg" in handler.bl_file_extensions.split(";")


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX names")
def test_name_that_is_no_text(addon, solved, tmp_path):
    """Old archives have names in other encodings; Blender's texts are UTF-8."""
    (tmp_path / "photos" / "0.png").rename(tmp_path / "photos" / "\udcff.png")
    assert bpy.ops.bsface.photos_add(directory=str(tmp_path / "photos")) == {"FINISHED"}
    names = [row.name for row in bpy.context.scene.bsface.photos]
    assert sorted(names) == ["1.png", "2.png", "?.png"]


def test_photos_to_leave_out(addon, solved, tmp_path):
    folder = str(tmp_path / "photos")
    bpy.ops.bsface.reconstruct(directory=folder, ignore="0.png|2.png")
    assert solved[-1].ignore == ("0.png", "2.png")
    bpy.context.scene.bsface.photos[1].use = False
    bpy.ops.bsface.reconstruct(ignore="0.png")
    assert solved[-1].ignore == ("0.png", "1.png")
