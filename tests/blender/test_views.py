"""What the 3D views show: nothing in the way, maps as they are, the view given back."""

import bpy
import numpy as np
import pytest
from blender import faces
from blender.checkout import load

scene = load("bsface_addon.scene")
selection = load("bsface_addon.selection")
editor = load("bsface_addon.landmark_editor")
cameras = load("bsface_addon.cameras")
view_areas = load("bsface_addon.view_areas")
photo_expression = load("bsface_addon.photo_expression")
Outcome = load("bsface_addon.solving").Outcome
showing = load("bsface_addon.showing")
coordinates = load("bsface_addon.coordinates")
surface_object = load("bsface_addon.surface_object")


def cube(size):
    bpy.ops.mesh.primitive_cube_add(size=size)
    return bpy.context.object


def test_only_what_surrounds_the_face_is_hidden(face):
    around, small = cube(2.0), cube(0.001)
    beside = cube(2.0)
    beside.location.x = 5
    selection.select_only(bpy.context, face)
    # What belongs to the face does not count.
    bpy.ops.bsface.surface_to_mesh(density="LOW", keys=False)
    bpy.context.view_layer.update()
    assert showing.surrounding(bpy.context, face) == [around]
    bpy.ops.bsface.surroundings_hide()
    assert around.hide_get() and not (small.hide_get() or beside.hide_get())
    assert not around.hide_viewport
    assert showing.surrounding(bpy.context, face) == []


def solid_views():
    return [
        area.spaces.active.shading
        for area in bpy.context.window.screen.areas
        if area.type == "VIEW_3D"
    ]


def test_maps_without_light_and_back(face):
    views = solid_views()
    if not views:
        pytest.skip("this build of Blender has no 3D view")
    for shading in views:
        shading.type, shading.light = "SOLID", "MATCAP"
        matcap = shading.studio_light
    for kind in ("NORMALS", "NORMALS"):
        bpy.ops.bsface.surface_map(kind=kind)
        assert {s.light for s in views} == {"FLAT"}
        assert {s.color_type for s in views} == {"TEXTURE"}
    material = load("bsface_addon.material")
    outline = load("bsface_addon.face_file").outline(face)
    grey = load("bsface_addon.maps").painted(np.full((4, 4, 3), 128, np.uint8), outline)
    material.store_map(face, "SKIN", grey)
    bpy.ops.bsface.surface_map(kind="SKIN")
    assert {(s.light, s.studio_light) for s in views} == {("STUDIO", "paint.sl")}
    bpy.ops.bsface.surface_map(kind="PLAIN")
    assert {(s.light, s.studio_light) for s in views} == {("MATCAP", matcap)}
    # A light that was chosen while a map is shown is the user's.
    bpy.ops.bsface.surface_map(kind="NORMALS")
    for shading in views:
        shading.light, shading.studio_light = "STUDIO", "rim.sl"
    bpy.ops.bsface.surface_map(kind="SKIN")
    bpy.ops.bsface.surface_map(kind="PLAIN")
    assert {(s.light, s.studio_light) for s in views} == {("STUDIO", "rim.sl")}


def test_the_landmark_editor_gives_the_view_back(face):
    views = list(view_areas.views(bpy.context))
    if not views:
        pytest.skip("this build of Blender has no 3D view")
    for view in views:
        view.view_perspective = "PERSP"
        view.view_distance, view.view_location = 3.0, (1, 2, 3)
        view.view_rotation = (0.5, 0.5, 0.5, 0.5)
    bpy.ops.bsface.landmarks_edit()
    for view in views:
        assert view.view_perspective == "CAMERA"
        # As Blender does when it draws through the camera.
        view.view_rotation, view.view_distance = (1, 0, 0, 0), 7.0
    bpy.ops.bsface.landmarks_done()
    for view in views:
        assert view.view_perspective == "PERSP"
        assert view.view_distance == pytest.approx(3)
        assert list(view.view_location) == pytest.approx([1, 2, 3])
        assert list(view.view_rotation) == pytest.approx([0.5] * 4)


def test_leaving_the_cameras_gives_view_camera_and_frame_back(face):
    own = bpy.data.objects.new("own", bpy.data.cameras.new("own"))
    context, render = bpy.context, bpy.context.scene.render
    context.scene.collection.objects.link(own)
    context.scene.camera = own
    render.resolution_x, render.resolution_y, render.pixel_aspect_x = 640, 360, 2.0
    views = list(view_areas.views(context))
    for view in views:
        view.view_perspective = "ORTHO"
        view.view_distance, view.view_rotation = 3.0, (0.5, 0.5, 0.5, 0.5)
    for _ in range(2):
        bpy.ops.bsface.view_photo()
        assert render.pixel_aspect_x == 1
        for view in views:
            assert view.view_perspective == "CAMERA"
            view.view_rotation, view.view_distance = (1, 0, 0, 0), 7.0
    bpy.ops.bsface.landmarks_edit()
    bpy.ops.bsface.landmarks_done()
    assert context.scene.camera in cameras.of_face(face)
    bpy.ops.bsface.view_leave()
    assert context.scene.camera == own
    size = (render.resolution_x, render.resolution_y, render.pixel_aspect_x)
    assert size == (640, 360, 2.0)
    for view in views:
        assert view.view_perspective == "ORTHO"
        assert view.view_distance == pytest.approx(3)
        assert list(view.view_rotation) == pytest.approx([0.5] * 4)
    # Nothing is remembered now: leaving again changes nothing.
    bpy.ops.bsface.view_leave()
    assert context.scene.camera == own


def test_a_new_run_keeps_what_was_switched_and_looked_through(face):
    bpy.ops.bsface.view_photo(direction="NAMED", photo="1.png")
    bpy.ops.bsface.light_show()
    bpy.ops.bsface.view_front(front=True)
    bpy.ops.bsface.view_show(show=False)
    face.hide_set(True)
    bpy.ops.bsface.reconstruct()
    found = cameras.of_face(face)
    assert bpy.context.scene.camera == found[1]
    # Of the cameras that are hidden the one that is looked through shows its photo.
    assert [view.hide_viewport for view in found] == [True, False, True]
    assert found[0].data.background_images[0].display_depth == "FRONT"
    suns = load("bsface_addon.lights").of_face(face)
    assert [sun.hide_viewport for sun in suns] == [True, False, True]
    assert face.visible_get() and face.select_get()


def test_removing_the_face_leaves_its_cameras(face):
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y = 640, 360
    bpy.ops.bsface.view_photo()
    bpy.ops.bsface.face_remove()
    assert (render.resolution_x, render.resolution_y) == (640, 360)
    for view in view_areas.views(bpy.context):
        assert view.view_perspective == "PERSP"


@pytest.fixture
def mixed(addon, tmp_path):
    """A face whose first photo is calm and whose others are not; their surfaces."""
    template = load("core.surface.template").load_template()
    count = len(template.expression_modes)
    mixtures = np.random.default_rng(0).normal(size=(3, count))
    mixtures[0] = 0
    result = faces.reconstruction(tmp_path / "photos", mixtures=mixtures)
    face = scene.place(bpy.context, Outcome.of(result), "Ann")
    known_face = load("core.solve.known_face").known_face
    known = known_face(result.surface, template.resampled(result.surface.shape))
    return face, [known.with_expression(e) for e in mixtures]


def drawn(face, steps):
    """The surface as Blender shows it, on a grid."""
    surface_object.set_resolution(face, steps)
    found = face.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    local = np.array([vertex.co for vertex in found.vertices])
    return coordinates.from_local(face, local)


def test_a_photo_shows_its_own_expression_and_the_calm_face_comes_back(mixed):
    face, surfaces = mixed
    neutral = surface_object.read(face)
    for name, surface in zip(("0.png", "1.png", "2.png"), surfaces, strict=True):
        bpy.ops.bsface.view_photo(direction="NAMED", photo=name)
        m, n = surface_object.shape(face)
        expected = surface.grid(2 * m, 2 * n).reshape(-1, 3)
        np.testing.assert_allclose(drawn(face, 2), expected, atol=1e-3)
        np.testing.assert_array_equal(surface_object.read(face), neutral)
    bpy.ops.bsface.view_leave()
    assert face.data.shape_keys is None
    np.testing.assert_array_equal(surface_object.read(face), neutral)


def test_the_net_can_be_edited_through_a_camera(mixed):
    face, _ = mixed
    neutral = surface_object.read(face)
    bpy.ops.bsface.view_photo(direction="NAMED", photo="2.png")
    bpy.ops.bsface.surface_net()
    bpy.ops.curve.select_all(action="SELECT")
    bpy.ops.transform.translate(value=(0, 0, 0.004))
    bpy.ops.bsface.view_photo(direction="NAMED", photo="1.png")
    assert face.mode == "EDIT"
    bpy.ops.bsface.view_leave()
    bpy.ops.bsface.surface_net()
    # Blender's z is the face's y; the photo's key is off, what was edited stays.
    moved = surface_object.read(face) - neutral
    np.testing.assert_allclose(moved, np.full_like(neutral, (0, 4, 0)), atol=1e-3)
    assert face.data.shape_keys.key_blocks[photo_expression.KEY].value == 0
    bpy.ops.bsface.surface_resample(control_points_u=12, control_points_v=12)
    assert face.data.shape_keys is None


def test_a_run_over_photos_that_agree_forgets_the_expressions(mixed, tmp_path):
    face, _ = mixed
    bpy.ops.bsface.view_photo(direction="NAMED", photo="2.png")
    result = faces.reconstruction(tmp_path / "photos")
    scene.place(bpy.context, Outcome.of(result), "", face=face)
    assert face.data.shape_keys is None and photo_expression.STORED not in face


def test_a_click_on_a_row_goes_to_its_camera(face):
    state = bpy.context.scene.bsface
    state.active_photo = 2
    assert bpy.context.scene.camera[cameras.PHOTO_KEY] == "2.png"
    bpy.ops.bsface.view_leave()
    # The active row moves up, and nobody has clicked.
    bpy.ops.bsface.photos_remove(photo="2.png")
    assert state.active_photo == 1 and bpy.context.scene.camera is None


def test_undo_takes_the_views_back_too(face):
    views = list(view_areas.views(bpy.context))
    for view in views:
        view.view_perspective = "PERSP"
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.bsface.view_photo("EXEC_DEFAULT", True)
    assert all(view.view_perspective == "CAMERA" for view in views)
    bpy.ops.ed.undo()
    assert bpy.context.scene.camera is None
    views = list(view_areas.views(bpy.context))
    assert all(view.view_perspective == "PERSP" for view in views)


def test_opacity_is_that_of_photos_in_front(face):
    state = bpy.context.scene.bsface
    slot = cameras.of_face(face)[0].data.background_images[0]
    state.photo_opacity = 0.3
    assert slot.alpha == 1.0 and not cameras.in_front(face)
    bpy.ops.bsface.view_front(front=True)
    assert slot.alpha == pytest.approx(0.3) and cameras.in_front(face)
    state.photo_opacity = 0.8
    assert slot.alpha == pytest.approx(0.8)
    bpy.ops.bsface.reconstruct()
    slot = cameras.of_face(face)[0].data.background_images[0]
    assert slot.alpha == pytest.approx(0.8)
