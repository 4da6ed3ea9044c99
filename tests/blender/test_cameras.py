"""Cameras: they project as the core's do, with the photos upright behind them."""

import struct

import bpy
import cv2
import numpy as np
import pytest
from blender import faces
from blender.checkout import load
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Matrix, Vector

scene = load("bsface_addon.scene")
camera_views = load("bsface_addon.camera_views")
cameras = load("bsface_addon.cameras")
coordinates = load("bsface_addon.coordinates")
surface_object = load("bsface_addon.surface_object")
orientation = load("bsface_addon.orientation").orientation
Outcome = load("bsface_addon.solving").Outcome


def as_in_the_first_version(face):
    """Coordinates in the core's millimetres; the matrix makes them life size."""
    points = surface_object.read(face)
    del face[coordinates.UNIT_KEY]
    surface_object.write(bpy.context, face, points)
    face.matrix_world = coordinates.UPRIGHT @ Matrix.Scale(0.001, 4)
    bpy.context.view_layer.update()


@pytest.mark.parametrize("kappa", [0.0, 1 / 900])
@pytest.mark.parametrize("moved", [False, True])
@pytest.mark.parametrize("version", ["0.1", "now"])
def test_cameras_project_as_the_core_does(empty_scene, tmp_path, kappa, moved, version):
    result = faces.reconstruction(tmp_path, kappa)
    face = scene.place(bpy.context, Outcome.of(result), "Ann")
    if version == "0.1":
        as_in_the_first_version(face)
        scene.place(bpy.context, Outcome.of(result), "Ann", face=face)
        assert coordinates.UNIT_KEY not in face
    if moved:
        face.location = (1, 2, 3)
        face.rotation_euler.z = 0.7
    head = np.random.default_rng(3).uniform(-70, 70, (20, 3))
    found = cameras.of_face(face)
    assert [c[cameras.PHOTO_KEY] for c in found] == ["0.png", "1.png", "2.png"]
    for obj, camera in zip(found, result.cameras, strict=True):
        camera_views.look_through(bpy.context, obj)
        bpy.context.view_layer.update()
        seen = [
            world_to_camera_view(
                empty_scene, obj, coordinates.world_frame(face) @ Vector(q)
            )
            for q in head
        ]
        width, height = faces.SIZE
        pixels = [(p.x * width - 0.5, (1 - p.y) * height - 0.5) for p in seen]
        np.testing.assert_allclose(pixels, camera.project(head), atol=2e-3)


def test_cameras_of_a_mirrored_face_see_it_mirrored(empty_scene, tmp_path):
    result = faces.reconstruction(tmp_path)
    face = scene.place(bpy.context, Outcome.of(result), "Ann")
    face.scale = (-1, 1, 1)
    bpy.context.view_layer.update()
    scene.place(bpy.context, Outcome.of(result), "Ann", face=face)
    head = np.random.default_rng(3).uniform(-70, 70, (20, 3))
    for obj, camera in zip(cameras.of_face(face), result.cameras, strict=True):
        assert 0 < obj.data.clip_start < 1 < obj.data.clip_end
        camera_views.look_through(bpy.context, obj)
        bpy.context.view_layer.update()
        points = [coordinates.world_frame(face) @ Vector(q) for q in head]
        seen = [world_to_camera_view(empty_scene, obj, point) for point in points]
        width, height = faces.SIZE
        pixels = [(p.x * width - 0.5, (1 - p.y) * height - 0.5) for p in seen]
        np.testing.assert_allclose(pixels, camera.project(head), atol=2e-3)


def test_cameras_are_not_scaled_and_see_the_face(empty_scene, tmp_path):
    face = scene.place(bpy.context, Outcome.of(faces.reconstruction(tmp_path)), "Ann")
    assert all(obj.hide_viewport for obj in cameras.of_face(face))
    cameras.set_shown(bpy.context, face, True)
    bpy.context.view_layer.update()
    for obj in cameras.of_face(face):
        np.testing.assert_allclose(obj.matrix_world.to_scale(), 1, atol=1e-5)
        distance = (obj.matrix_world.translation - face.matrix_world.translation).length
        assert obj.data.clip_start < distance < obj.data.clip_end


def test_photos_are_the_cameras_backgrounds(empty_scene, tmp_path):
    result = faces.reconstruction(tmp_path)
    face = scene.place(bpy.context, Outcome.of(result), "Ann")
    for obj, photo in zip(cameras.of_face(face), result.photos, strict=True):
        slot = obj.data.background_images[0]
        assert slot.image.filepath == str(photo.path)
        assert obj.data.show_background_images and slot.rotation == 0
    assert len(bpy.data.images) == 3


def jpeg_with_orientation(pixels, tag):
    """A JPEG file's bytes with the EXIF orientation tag."""
    data = cv2.imencode(".jpg", pixels)[1].tobytes()
    entry = struct.pack("<HHII", 0x0112, 3, 1, tag)
    tiff = b"II*\0" + struct.pack("<IH", 8, 1) + entry + struct.pack("<I", 0)
    exif = b"Exif\0\0" + tiff
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]


@pytest.mark.parametrize("tag", range(1, 9))
def test_orientation_is_found_for_every_exif_tag(tmp_path, tag):
    pixels = np.random.default_rng(0).integers(0, 255, (80, 120, 3), np.uint8)
    path = tmp_path / "turned.jpg"
    path.write_bytes(jpeg_with_orientation(pixels, tag))
    angle, flip = orientation(path)
    stored = cv2.imread(str(path), cv2.IMREAD_IGNORE_ORIENTATION | cv2.IMREAD_COLOR)
    start = stored[:, ::-1] if flip else stored
    turned = np.rot90(start, round(angle / (np.pi / 2)))
    np.testing.assert_array_equal(turned, cv2.imread(str(path)))
    assert tag == 1 or not np.array_equal(stored, cv2.imread(str(path)))


@pytest.mark.parametrize("tag, turns", [(1, 0), (3, 2), (6, 1), (8, 3)])
def test_backgrounds_are_turned_clockwise_to_fill_the_frame(
    empty_scene, tmp_path, tag, turns
):
    """Tag 6: the camera was held so that the picture needs a quarter clockwise.

    That Blender turns clockwise and fits before turning was seen in its window.
    """
    path = tmp_path / "turned.jpg"
    noise = np.random.default_rng(0).integers(0, 255, (80, 120, 3), np.uint8)
    path.write_bytes(jpeg_with_orientation(noise, tag))
    photo = load("core.images.read").read_photo(path)
    data = bpy.data.cameras.new("camera")
    cameras.background(data, photo)
    slot = data.background_images[0]
    assert round(slot.rotation / (np.pi / 2)) % 4 == turns
    assert slot.scale == pytest.approx(1.5 if turns % 2 else 1.0)
