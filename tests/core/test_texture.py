"""Textures of drawn photos whose skin and light are known."""

from dataclasses import replace

import _texture_check as texture_check
import cv2
import numpy as np
import pytest
from bsface.errors import ReconstructionError
from bsface.formats.clipping import signed_distance
from bsface.images.colour import srgb_table, to_picture
from bsface.images.photo import Photo
from bsface.photometry import harmonics
from bsface.photometry.skin import SkinMask
from bsface.surface.bspline import BSplineSurface
from bsface.surface.template import load_template
from bsface.texture import bake as texture
from bsface.texture import views as texture_views
from bsface.texture.blend import explained
from bsface.texture.choice import with_photos
from bsface.texture.light import PhotoLights, estimate_lights, open_sky
from fake_face import (
    bare_reconstruction,
    ellipse_outline,
    face_surface,
    painted_reconstruction,
    skin_pattern,
)

SIZE = 256


@pytest.fixture(scope="module")
def painted():
    return painted_reconstruction()


@pytest.fixture(scope="module")
def baked(painted):
    return texture.bake_texture(painted, SIZE)


def texel_uv(size):
    at = texture_views.texel_centres(size)
    return np.stack(np.meshgrid(at, at), axis=-1)


def well_inside(size):
    outline = 0.5 + 0.75 * (ellipse_outline() - 0.5)
    uv = texel_uv(size)
    return signed_distance(outline, uv.reshape(-1, 2))[0].reshape(size, size) > 0


def relative_error(found, place):
    """Median relative error of a texture up to one factor a channel."""
    truth = skin_pattern(texel_uv(len(found)))[place]
    found = found[place]
    gain = np.median(found / truth, axis=0)
    return np.median(np.abs(found / gain - truth) / truth)


def test_srgb_curve_is_its_own_inverse_and_ends_where_it_should():
    values = np.arange(2**16)
    assert np.array_equal(to_picture(srgb_table("<u2"), 16), values)
    assert np.array_equal(to_picture([0.0, 1.0, 2.0]), [0, 255, 255])
    assert to_picture([1.0], 16).dtype == np.uint16
    with pytest.raises(ValueError, match="8 or 16"):
        to_picture([1.0], 12)


def test_the_texture_is_made_of_the_skin_that_the_face_was_made_of(painted):
    dark = SkinMask(np.zeros((5, 5), np.float32), (0.0, 0.0, 5 / 200))
    count = len(painted.photos)
    with pytest.raises(ReconstructionError, match="show no skin"):
        texture.bake_texture(replace(painted, skin=(dark,) * count), SIZE)
    light = replace(dark, values=np.ones((5, 5), np.float32))
    masks = (light, *(dark,) * (count - 1))
    found = texture.bake_texture(replace(painted, skin=masks), SIZE, detail=False)
    assert found.skin == masks and found.photos_seen.max() == 1


def test_surface_maps_agree_with_the_surface():
    surface = face_surface()
    maps = texture_views.surface_maps(surface, 37)
    uv = texel_uv(37)
    np.testing.assert_allclose(
        maps.points, surface.evaluate(uv[..., 0], uv[..., 1]), atol=1e-10
    )
    np.testing.assert_allclose(
        maps.normals, surface.normals(uv[..., 0], uv[..., 1]), atol=1e-10
    )


def test_resizing_keeps_positions_up_to_the_border():
    for rows in (None, slice(10, 20)):
        found = texture_views.resized(texel_uv(16).astype(np.float32), 50, rows)
        # remap interpolates in steps of 1/32 texel.
        np.testing.assert_allclose(found, texel_uv(50)[rows or slice(50)], atol=2e-3)


def test_view_knows_where_and_whether_a_texel_is_seen(painted):
    surface = painted.surface
    maps = texture_views.surface_maps(surface, 64)
    turned = texture_views.view_photo(maps, painted.photos[0], painted.cameras[0])
    np.testing.assert_allclose(
        turned.xy, painted.cameras[0].project(maps.points), atol=1e-3
    )
    toward = painted.cameras[0].toward(maps.points)
    facing = (toward * maps.normals).sum(axis=2)
    assert (turned.weight[facing < 0.1] == 0).all()
    assert (turned.weight[well_inside(64) & (facing > 0.7)] > 0).all()


def test_lights_of_a_known_albedo_are_recovered():
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(900, 3)) * (0.5, 0.5, 0.2) + (0, 0, 1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    albedo = rng.uniform(0.35, 0.65, (900, 3))
    lights = np.zeros((12, 9, 3))
    lights[:, 0] = rng.uniform(0.7, 1.3, (12, 3))
    lights[:, 1:4] = rng.normal(0, 0.2, (12, 3, 3))
    value = np.einsum("pk,ikc->ipc", harmonics.basis(normals), lights) * albedo
    # A tenth of each photo is in shadow.
    value[rng.random(value.shape[:2]) < 0.1] *= 0.2
    basis = harmonics.basis(normals)
    front = basis.mean(axis=0)
    _, found = estimate_lights(value, np.ones(value.shape[:2]), basis, front, 12)
    ratio = found / albedo
    ratio /= np.median(ratio, axis=0)
    assert np.median(np.abs(ratio - 1)) < 0.02


def test_shading_never_goes_to_zero():
    light = np.zeros((1, 9, 3))
    light[0, 0], light[0, 1] = 0.5, 2.0
    basis = harmonics.basis(np.array([[-1.0, 0, 0], [0, 0, 1.0]]))
    assert (PhotoLights(light, basis[1]).shading(0, basis) > 0.01).all()


def test_light_of_a_bulging_face_is_that_of_its_normals():
    """Nothing of it casts shadow, but for grazing light that depth maps cut off."""
    u, v = np.meshgrid(np.linspace(-1, 1, 12), np.linspace(1, -1, 12), indexing="ij")
    dome = BSplineSurface(np.stack([60 * u, 60 * v, -15 * (u**2 + v**2)], axis=-1))
    basis, front = open_sky(dome).maps(64)
    even = basis[..., 0] / front[0]
    assert even.max() < 1.01 and even.min() > 0.8 and np.median(even) > 0.9
    # harmonics of degree 1 shade by the normal: the fourth by its x
    x = texture_views.surface_maps(dome, 64).normals[..., 0]
    assert abs(np.corrcoef(basis[..., 3].ravel(), x.ravel())[0, 1]) > 0.99


def test_a_pit_gets_less_light_than_what_is_around_it():
    u, v = np.meshgrid(np.linspace(-1, 1, 24), np.linspace(1, -1, 24), indexing="ij")
    depth = 30 * np.exp(-(u**2 + v**2) / 0.03)
    surface = BSplineSurface(np.stack([60 * u, 60 * v, -depth], -1))
    basis, _ = open_sky(surface).maps(64)
    even = basis[..., 0]
    assert even[32, 32] < 0.8 * even[32, 4]


def test_each_photo_is_seen_on_the_face_with_its_own_expression(painted):
    template = load_template()
    count = len(painted.photos)
    mixture = np.zeros((count, 1))
    mixture[1] = 2.0
    fields = {**painted.__dict__, "surface": template.surface, "template": template}
    mixed = type(painted)(**{**fields, "expressions": mixture})
    faces = texture_views.faces_of(mixed)
    moved = template.surface.control_points + 2 * template.expression_modes[0]
    np.testing.assert_allclose(faces[1].control_points, moved, atol=1e-9)
    views = list(texture_views.view_photos(mixed, 32))
    for i in (0, 1):
        xy = views[i].xy
        points = texture_views.surface_maps(faces[i], 32).points
        pixels = painted.photos[i].to_window(painted.cameras[i].project(points))
        np.testing.assert_allclose(xy, pixels, atol=1e-3)


def test_albedo_is_the_painted_skin_without_its_light(painted, baked):
    place = well_inside(SIZE) & baked.measured
    assert place.sum() > 0.95 * well_inside(SIZE).sum()
    ours = relative_error(baked.albedo, place)
    plain = relative_error(texture_check.plain_average(painted, SIZE), place)
    assert ours < 0.02
    assert ours < 0.3 * plain


def test_relit_albedo_explains_the_photos_better_than_the_average(painted, baked):
    errors = texture_check.rerender_errors(painted, baked)
    assert np.median(errors["albedo"]) < 0.8 * np.median(errors["plain"])


def test_an_occluder_in_some_photos_leaves_no_ghost(painted, baked):
    photos = list(painted.photos)
    for index in (1, 4):
        pixels = photos[index].pixels.copy()
        cv2.rectangle(pixels, (70, 80), (120, 130), (20, 60, 220), -1)
        photos[index] = Photo(photos[index].name, None, photos[index].size, pixels)
    covered = type(painted)(**{**painted.__dict__, "photos": tuple(photos)})
    found = texture.bake_texture(covered, SIZE)
    place = well_inside(SIZE)
    change = np.abs(found.albedo - baked.albedo)[place].mean(axis=1)
    naive = [texture_check.plain_average(r, SIZE) for r in (covered, painted)]
    ghost = np.abs(naive[0] - naive[1])[place].mean(axis=1)
    assert change.mean() < 0.4 * ghost.mean()
    assert np.percentile(change, 99) < 0.5 * np.percentile(ghost, 99)


def test_a_photo_whose_colours_no_light_explains_does_not_count():
    rng = np.random.default_rng(0)
    base = rng.uniform(0.2, 0.8, (32, 32, 3)).astype(np.float32)
    delit = base * rng.normal(1, 0.05, (7, 32, 32, 1)).astype(np.float32)
    delit[3, 8:] = delit[3, 8:, :, ::-1] * (0.3, 1.8, 0.4)
    weight = rng.uniform(0.1, 1, (7, 32, 32)).astype(np.float32)
    found = explained(delit, weight, base)
    assert found[3] == 0
    assert (np.delete(found, 3) == 1).all()


def test_exposure_and_colour_cast_of_a_photo_leave_no_seam(painted, baked):
    photos = list(painted.photos)
    linear = photos[2].linear() * (0.5, 0.6, 0.8)
    photos[2] = Photo(photos[2].name, None, photos[2].size, to_picture(linear))
    changed = type(painted)(**{**painted.__dict__, "photos": tuple(photos)})
    found = texture.bake_texture(changed, SIZE)
    place = well_inside(SIZE)
    ratio = (found.albedo / np.maximum(baked.albedo, 1e-3))[place]
    ratio /= np.median(ratio, axis=0)
    assert np.percentile(np.abs(ratio - 1), 95) < 0.06


def test_places_that_no_photo_sees_are_filled_and_marked(painted):
    frontal = type(painted)(
        **{
            **painted.__dict__,
            "photos": painted.photos[:2],
            "cameras": painted.cameras[:2],
            "expressions": painted.expressions[:2],
            "landmarks": painted.landmarks[:2],
        }
    )
    found = texture.bake_texture(frontal, 128)
    assert not found.measured.all() and found.measured.any()
    assert np.isfinite(found.albedo).all() and (found.albedo >= 0).all()
    filled = found.albedo[~found.measured]
    assert (filled.mean(axis=1) > 0.05).mean() > 0.95


def test_a_photo_alone_is_not_compared_with_itself(painted, baked):
    assert np.isfinite(baked.residual).any()
    alone = texture.bake_texture(with_photos(painted, [0]), SIZE)
    assert alone.measured.any() and np.isnan(alone.residual).all()


def test_written_texture_has_its_rows_and_its_mask(tmp_path, baked):
    path = texture.write_texture(tmp_path / "a.png", baked.albedo, 16, baked.measured)
    back = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert back.dtype == np.uint16 and back.shape == (SIZE, SIZE, 4)
    assert np.array_equal(back[..., :3], to_picture(baked.albedo, 16)[..., ::-1])
    assert np.array_equal(back[..., 3] > 0, baked.measured)


def test_unusable_requests_are_refused(painted):
    with pytest.raises(ReconstructionError, match="needs the photos"):
        texture.bake_texture(bare_reconstruction())
    with pytest.raises(ValueError, match="64 to 8192"):
        texture.bake_texture(painted, 10)


FINE = np.full((4, 4, 3), 0.5, np.float32)


@pytest.mark.parametrize(
    "linear, words",
    [
        (np.where(np.eye(4, dtype=bool)[..., None], np.nan, FINE), "must be finite"),
        (np.full((4, 4, 3), np.inf), "must be finite"),
        (
            (255 * FINE).astype(np.uint8),
            r"intensities in \[0, 1\] as floats, not uint8",
        ),
        (np.zeros((4, 4, 3), int), "as floats, not int64"),
        (np.zeros((0, 0, 3)), r"\(S, S, 3\) array"),
        (np.zeros((4, 5, 3)), r"\(S, S, 3\) array"),
        (np.zeros((4, 4)), r"\(S, S, 3\) array"),
    ],
)
def test_what_is_no_linear_picture_is_not_written(tmp_path, linear, words):
    with pytest.raises(ValueError, match=words):
        texture.write_texture(tmp_path / "a.png", linear)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("depth", [7, 12, 0, True, "8", 8.0])
def test_depths_are_8_and_16(tmp_path, depth):
    with pytest.raises((TypeError, ValueError), match="depth must be 8 or 16 bits"):
        texture.write_texture(tmp_path / "a.png", FINE, depth)


@pytest.mark.parametrize("name", ["a.jpg", "a.exr", "a"])
def test_a_picture_is_named_after_its_format(tmp_path, name):
    with pytest.raises(ValueError, match=r"give it a name in \.png"):
        texture.write_texture(tmp_path / name, FINE)
    assert texture.write_texture(tmp_path / "A.PNG", FINE).is_file()
