"""Normal map and displacement of drawn photos whose relief and lights are known."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from bsface.texture import detail as texture_detail
from bsface.texture.bake import bake_texture
from bsface.texture.detail import (
    Detail,
    displacement_picture,
    normal_picture,
    tangent_normals,
    write_displacement,
    write_normals,
)
from bsface.texture.detail_measurement import slope_equations
from bsface.texture.height import SlopeEvidence, solve_height
from bsface.texture.views import surface_maps, texel_centres
from fake_face import displaced_normals, face_surface, painted_reconstruction

SIZE = 256
DOME = slice(112, 144)


def ripples(u, v):
    """Waves of about 10 x 10 mm, too short for the net of 16 x 18."""
    return 0.25 * np.sin(2 * np.pi * 14 * u) * np.sin(2 * np.pi * 18 * v)


def texels(size):
    at = texel_centres(size)
    return np.meshgrid(at, at)


def in_space(normals, surface):
    """A tangent-space map as normals of the head's axes, by the definition."""
    size = len(normals)
    u, v = texels(size)
    n = surface_maps(surface, size).normals
    tangent = surface.evaluate(u, v, du=1)
    tangent -= (tangent * n).sum(axis=2, keepdims=True) * n
    tangent /= np.linalg.norm(tangent, axis=2, keepdims=True)
    x, y, z = np.moveaxis(normals.astype(float), -1, 0)[..., None]
    return x * tangent + y * np.cross(n, tangent) + z * n


def degrees(a, b):
    return np.rad2deg(np.arccos(np.clip((a * b).sum(axis=-1), -1, 1)))


def middle(size):
    part = slice(round(0.3 * size), round(0.7 * size))
    return part, part


@pytest.fixture(scope="module")
def rippled():
    return painted_reconstruction(10, height=ripples)


@pytest.fixture(scope="module")
def found(rippled):
    return bake_texture(rippled, SIZE).detail


def test_slopes_and_noise_of_known_lights_are_recovered():
    rng = np.random.default_rng(0)
    h = rng.normal(size=(2, 12, 20, 30))
    slopes = rng.normal(size=(20, 30, 2))
    d = rng.normal(size=(20, 30)) + np.einsum("anrs,rsa->nrs", h, slopes)
    d += rng.normal(0, 0.01, d.shape)
    d[rng.random(d.shape) < 0.05] -= 1.0  # cast shadows
    A, b, noise = slope_equations(d, h, np.ones(d.shape), rounds=20)
    solved = np.linalg.solve(A, b[..., None])[..., 0]
    assert np.median(np.abs(solved - slopes)) < 0.01
    assert 0.5 < np.sqrt(np.median(noise)) / 0.01 < 2


def test_photos_of_one_light_and_too_few_photos_tell_nothing():
    rng = np.random.default_rng(0)
    d = rng.normal(size=(8, 6, 6))
    alike = np.broadcast_to(rng.normal(size=(2, 1, 6, 6)), (2, 8, 6, 6))
    A, b, _ = slope_equations(d, alike, np.ones(d.shape))
    np.testing.assert_allclose(A, 0, atol=1e-12)
    np.testing.assert_allclose(b, 0, atol=1e-12)
    for count in (1, 2, 3, 4):
        h = rng.normal(size=(2, count, 6, 6))
        noise = slope_equations(d[:count], h, np.ones((count, 6, 6)))[2]
        assert np.isinf(noise).all()


def test_height_has_the_slopes_that_are_given():
    u, v = texels(64)
    z = 0.3 * np.cos(8 * np.pi * u) * np.cos(6 * np.pi * v)
    z_v, z_u = (64 * g for g in np.gradient(z))
    A = np.broadcast_to(np.eye(2, dtype=np.float32) * 1e4, (64, 64, 2, 2))
    b = 1e4 * np.stack([z_u, z_v], axis=-1).astype(np.float32)
    one = np.ones((64, 64), np.float32)
    solved = solve_height(SlopeEvidence(A, b, one), (100.0, 100.0), lambda: None)
    assert np.abs(solved - z)[2:-2, 2:-2].max() < 0.03
    # Without evidence, and beside it, the field is flat.
    empty = SlopeEvidence.empty(64)
    assert not solve_height(empty, (100.0, 100.0), lambda: None).any()
    left = np.where(u[..., None] < 0.5, b, 0)
    half = np.where(u[..., None, None] < 0.5, A, 0)
    solved = solve_height(SlopeEvidence(half, left, one), (100.0, 100.0), lambda: None)
    assert np.abs(np.diff(solved[:, 48:])).max() < 0.1 * np.abs(np.diff(z)).max()


def test_relief_of_the_photos_is_found(rippled, found):
    u, v = texels(found.size)
    true = displaced_normals(rippled.surface, ripples, u, v)
    part = middle(found.size)
    ours = in_space(found.normals, rippled.surface)
    flat = surface_maps(rippled.surface, found.size).normals
    before, after = degrees(flat, true)[part], degrees(ours, true)[part]
    assert after.mean() < 0.6 * before.mean()
    height = ripples(u, v)[part]
    assert np.corrcoef(found.displacement[part].ravel(), height.ravel())[0, 1] > 0.8


def test_skin_without_relief_gives_a_flat_map(found):
    plain = bake_texture(painted_reconstruction(10), SIZE).detail
    part = middle(SIZE)
    assert plain.displacement[part].std() < 0.2 * found.displacement[part].std()


def test_waves_that_the_net_can_hold_stay_out_of_the_map():
    def broad(u, v):
        return 1.5 * np.sin(2 * np.pi * 2 * u) * np.sin(2 * np.pi * 2.5 * v)

    face = painted_reconstruction(10, height=broad)
    left = bake_texture(face, SIZE).detail.displacement
    u, v = texels(SIZE)
    assert left[middle(SIZE)].std() < 0.08 * broad(u, v)[middle(SIZE)].std()


def test_one_photo_gives_a_flat_map(rippled):
    one = {
        name: getattr(rippled, name)[4:5]
        for name in ("photos", "cameras", "landmarks", "expressions")
    }
    alone = bake_texture(replace(rippled, **one), SIZE).detail
    assert not alone.displacement.any()
    assert (normal_picture(alone) == (128, 128, 255)).all()


def test_eyes_and_nostrils_have_no_detail(rippled, found):
    u, v = texels(SIZE)
    skin = rippled.template.is_skin(np.stack([u, v], axis=-1))
    assert (~skin[middle(SIZE)]).sum() > 100
    assert not found.displacement[~skin].any()
    assert (found.normals[cv2.erode((~skin).astype(np.uint8), np.ones((3, 3))) > 0]
            == (0, 0, 1)).all()  # fmt: skip


def test_tangent_space_is_that_of_the_displaced_surface():
    surface = face_surface()
    u, v = texels(SIZE)
    tangents = texture_detail.tangents_of(surface, SIZE)
    normals = tangent_normals(ripples(u, v).astype(np.float32), tangents)
    true = displaced_normals(surface, ripples, u, v)
    inner = slice(4, -4), slice(4, -4)
    assert degrees(in_space(normals, surface), true)[inner].max() < 1.5


def dome():
    """A detail with one bump of 1 mm in the middle of a flat patch."""
    u, v = texels(SIZE)
    height = np.exp(-((u - 0.5) ** 2 + (v - 0.5) ** 2) / 0.004)
    tangents = texture_detail.tangents_of(face_surface(nose=0), SIZE)
    height = height.astype(np.float32)
    return Detail(height, tangent_normals(height, tangents))


def test_green_is_up_and_red_is_right(tmp_path):
    path = write_normals(tmp_path / "n.png", dome())
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1].astype(int)
    above, below = picture[DOME.start : 128, DOME], picture[128 : DOME.stop, DOME]
    assert above[..., 1].mean() > 132 and below[..., 1].mean() < 124
    right, left = picture[DOME, 128 : DOME.stop], picture[DOME, DOME.start : 128]
    assert right[..., 0].mean() > 132 and left[..., 0].mean() < 124
    assert tuple(picture[2, 2]) == (128, 128, 255)


def test_displacement_picture_holds_millimetres(tmp_path):
    path = write_displacement(tmp_path / "d.png", dome())
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert picture.dtype == np.uint16 and picture.shape == (SIZE, SIZE)
    back = (picture / 65535 - 0.5) * 2 * texture_detail.WHITE_MM
    np.testing.assert_allclose(back, dome().displacement, atol=2e-5)
    assert displacement_picture(dome())[0, 0] == 32768


@pytest.mark.parametrize(
    "displacement, normals",
    [
        ([[0.0]], [[[0.0, 0.0, 1.0]]]),
        (np.full((4, 4), np.nan), np.full((4, 4, 3), np.nan)),
        (np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3), np.uint8)),
        (np.zeros((0, 0)), np.zeros((0, 0, 3))),
        (np.zeros((4, 5)), np.zeros((4, 4))),
    ],
)
def test_what_is_no_relief_is_not_written(tmp_path, displacement, normals):
    wrong = Detail(displacement, normals)
    with pytest.raises((TypeError, ValueError), match=r"detail\.normals must be"):
        write_normals(tmp_path / "n.png", wrong)
    with pytest.raises((TypeError, ValueError), match=r"detail\.displacement must be"):
        write_displacement(tmp_path / "d.png", wrong)
    with pytest.raises(ValueError, match=r"give it a name in \.png"):
        write_normals(tmp_path / "n.jpg", dome())
    with pytest.raises(ValueError, match=r"give it a name in \.png"):
        write_displacement(tmp_path / "d.tif", dome())
    assert not list(tmp_path.iterdir())
