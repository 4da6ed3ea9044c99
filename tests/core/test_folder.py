"""Listing a folder: what is read, what is passed over and named, and what is wrong."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from bsface.drawing.pictures import write_png
from bsface.errors import ReconstructionError
from bsface.images.folder import list_photos, list_sources, natural_key, scan_folder
from bsface.images.read import read_photo
from hypothesis import given, settings
from hypothesis import strategies as st
from pictures_for_tests import encoded

PIXELS = np.random.default_rng(0).integers(0, 255, (40, 60, 3), np.uint8)


def names(paths: tuple[Path, ...], folder: Path) -> list[str]:
    return [path.relative_to(folder).as_posix() for path in paths]


def test_listing(tmp_path):
    names = ["10.jpg", "2.JPG", "b1.png", ".hidden.jpg", "notes.txt", "x.heic"]
    for name in names:
        (tmp_path / name).touch()
    (tmp_path / "sub.jpg").mkdir()
    (tmp_path / "loop.jpg").symlink_to(tmp_path / "loop.jpg")
    found = [path.name for path in list_photos(tmp_path)]
    assert found == ["2.JPG", "10.jpg", "b1.png", "loop.jpg", "x.heic"]


@given(st.lists(st.text(max_size=8), max_size=8))
@settings(deadline=None)
def test_natural_order_is_an_order(names):
    ordered = sorted(names, key=natural_key)
    assert sorted(reversed(names), key=natural_key) == ordered


@pytest.mark.parametrize("kind", ["none", "file", "empty", "loop", "nul"])
def test_no_folder_of_photos(tmp_path, kind):
    folder = tmp_path / "folder"
    if kind == "file":
        folder.write_text("x")
    elif kind == "empty":
        folder.mkdir()
        (folder / "readme.txt").touch()
    elif kind == "loop":
        folder.symlink_to(folder)
    elif kind == "nul":
        folder = "a\0b"
    with pytest.raises(ReconstructionError) as info:
        list_photos(folder)
    assert "\n" not in str(info.value)
    assert str(info.value).endswith(".")


def test_photos_videos_and_what_is_passed_over(tmp_path):
    for name in ["2.jpg", "10.jpg", "walk.MP4", "notes.txt", "2.json", ".DS_Store"]:
        (tmp_path / name).touch()
    scan = scan_folder(tmp_path)
    assert names(scan.photos, tmp_path) == ["2.jpg", "10.jpg"]
    assert names(scan.videos, tmp_path) == ["walk.MP4"]
    assert names(scan.sources, tmp_path) == ["2.jpg", "10.jpg", "walk.MP4"]
    assert list_sources(tmp_path) == scan.sources
    assert scan.others == ("notes.txt",)
    assert scan.passed_over == ()
    assert scan.hints() == ("notes.txt is not a photo and is passed over.",)
    (tmp_path / "old.doc").touch()
    assert scan_folder(tmp_path).hints() == (
        "notes.txt, old.doc are not photos and are passed over.",
    )


def test_pictures_that_we_wrote_are_not_photos(tmp_path):
    """A report 001.html beside 001.jpg brings a 001.png along."""
    (tmp_path / "001.jpg").write_bytes(encoded(".jpg", PIXELS))
    write_png(tmp_path / "001.png", PIXELS)
    (tmp_path / "002.png").write_bytes(encoded(".png", PIXELS))
    scan = scan_folder(tmp_path)
    assert names(scan.photos, tmp_path) == ["001.jpg", "002.png"]
    assert scan.hints() == (
        "001.png was written by bsface and is not read as a photo.",
    )
    # The mark changes no pixel, and a picture given by its own name is read.
    np.testing.assert_array_equal(read_photo(tmp_path / "001.png").pixels, PIXELS)
    for path in scan.photos:
        path.unlink()
    with pytest.raises(ReconstructionError, match="pictures that bsface wrote"):
        list_photos(tmp_path)


def test_sub_folders_are_hinted_at_or_entered(tmp_path):
    for name in ["a.jpg", "ann/1.jpg", "ann/deep/2.jpg", "bob/3.heic", "empty/x.txt"]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    scan = scan_folder(tmp_path)
    assert names(scan.photos, tmp_path) == ["a.jpg"]
    assert scan.photo_folders == ("ann", "bob")
    (hint,) = scan.hints()
    assert "ann, bob" in hint and "--recursive" in hint and "batch" in hint
    found = names(list_photos(tmp_path, recursive=True), tmp_path)
    assert found == ["a.jpg", "ann/1.jpg", "ann/deep/2.jpg", "bob/3.heic"]
    (tmp_path / "a.jpg").unlink()
    with pytest.raises(ReconstructionError, match=r"sub-folders do \(ann, bob\)"):
        list_photos(tmp_path)


def test_links_that_lead_in_a_circle_are_not_followed(tmp_path):
    folder, outside = tmp_path / "photos", tmp_path / "outside"
    (folder / "in").mkdir(parents=True)
    outside.mkdir()
    for path in (folder / "1.jpg", folder / "in" / "2.jpg", outside / "3.jpg"):
        path.touch()
    (folder / "loop").symlink_to(".", target_is_directory=True)
    (folder / "in" / "up").symlink_to("..", target_is_directory=True)
    (folder / "away").symlink_to(outside, target_is_directory=True)
    assert names(list_photos(folder, recursive=True), folder) == ["1.jpg", "in/2.jpg"]
    for name, hint in zip(("away", "loop"), scan_folder(folder).hints(), strict=False):
        assert hint == f"{name} is a link to a folder, which is not followed."


def test_a_photo_that_vanishes_is_one_sentence(tmp_path):
    (tmp_path / "1.jpg").write_bytes(encoded(".jpg", PIXELS))
    (path,) = list_photos(tmp_path)
    path.unlink()
    reason = read_photo(path).reason
    assert reason.startswith("1.jpg cannot be opened (no such file or directory)")


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX names")
def test_name_that_is_no_text(tmp_path):
    path = os.fsencode(tmp_path) + b"/\xff\xfe.png"
    with open(path, "wb") as file:
        file.write(encoded(".png", PIXELS))
    (found,) = list_photos(tmp_path)
    assert read_photo(found, "shown")
