"""The picture of a head: the face's texels as they are, no edge, plain skin around."""

import cv2
import numpy as np
import pytest
from bsface.drawing.pictures import write_png
from bsface.drawing.surface_grid import read_picture
from bsface.errors import ReconstructionError
from bsface.rig.base_head import SQUARE, base_head, face_region
from bsface.rig.head import SURE
from bsface.surface.template import load_template
from bsface.texture.detail import tangent_normals, tangents_of
from bsface.texture.head import FADE, FLAT, STILL, head_picture, head_texture
from fake_face import displaced_normals

SKIN = (190, 150, 120)


def uv_grid(side):
    at = (np.arange(side) + 0.5) / side
    return np.stack(np.meshgrid(at, at), axis=-1)


def smooth_picture(side=96):
    """Colours that tell u (red) and v (green)."""
    u, v = np.moveaxis(uv_grid(side), -1, 0)
    colours = np.stack([40 + 160 * u, 60 + 120 * v, np.full_like(u, 90)], axis=-1)
    return np.round(colours).astype(np.uint8)


def test_inner_texels_are_those_of_the_face():
    picture = smooth_picture()
    made = head_picture(picture, load_template())
    assert made.shape == (144, 144, 3) and made.dtype == np.uint8
    left, top = (round(x * 144) for x in SQUARE[:2])
    inner = face_region(uv_grid(96)) <= FADE[0]
    square = made[top : top + 96, left : left + 96]
    np.testing.assert_array_equal(square[inner], picture[inner])


def test_every_vertex_of_the_face_finds_its_colour():
    """The layout of the mesh and that of the picture are one."""
    picture = smooth_picture(192)
    made = head_picture(picture, load_template())
    base = base_head()
    sure = np.flatnonzero(face_region(base.uv) < 0.65)
    here = read_picture(made, base.place[sure])
    there = read_picture(picture, base.uv[sure])
    assert np.abs(here - there).max() < 1.5


def test_plain_skin_stays_plain_and_has_no_edge():
    picture = np.full((64, 64, 3), SKIN, np.uint8)
    picture[20:26, 20:44] = 20  # eyes and brows are no skin of the rest
    made = head_picture(picture, load_template())
    region = face_region(uv_grid(64))
    left, top = (round(x * 96) for x in SQUARE[:2])
    rest = np.ones((96, 96), bool)
    rest[top : top + 64, left : left + 64] = region > 0.6
    assert np.abs(made[rest].astype(int) - SKIN).max() <= 12
    assert np.abs(made[0].astype(int) - SKIN).max() <= 3


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_an_uneven_face_goes_over_into_its_own_skin_without_a_step(kind):
    most = np.iinfo(kind).max
    u, v = np.moveaxis(uv_grid(128), -1, 0)
    shade = 0.35 + 0.4 * u
    picture = np.round(most * np.stack([shade] * 3, axis=-1)).astype(kind)
    # Hair above the outline.
    picture[face_region(uv_grid(128)) > 0.995] = 0
    made = head_picture(picture, load_template()).astype(float) / most
    step = max(np.abs(np.diff(made, axis=k)).max() for k in (0, 1))
    assert step < 0.02, "an edge"
    assert made.min() > 0.3, "hair runs into the skin"
    # Beside the face each side goes on as the face ends there.
    row = made[len(made) // 2, :, 0]
    assert row[20] + 0.05 < row[-20]


def test_given_plain_colour_and_other_shapes():
    picture = np.full((30, 50, 4), 200, np.uint8)
    made = head_picture(picture, load_template(), FLAT)
    assert made.shape == (84, 84, 3)
    assert (made[0] == (128, 128, 255)).all()
    assert (made[42, 42] == 200).all()


@pytest.mark.parametrize("density", ["low", "medium"])
def test_the_face_is_moved_and_scaled_but_not_turned_in_the_head(density):
    """What keeps a tangent frame of (u, v) the one of the head's picture."""
    base = base_head(density)
    inner = face_region(base.uv) <= FADE[1]
    left, top, side = SQUARE
    expected = base.uv[inner] * side + (left, top)
    np.testing.assert_allclose(base.place[inner], expected, atol=1e-6)


def mesh_tangents(points, quads, uv):
    """Unit tangent along u and normal at the vertices, by the triangles of a mesh."""
    corners = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    a, b = (points[corners[:, k]] - points[corners[:, 0]] for k in (1, 2))
    p, q = (uv[corners[:, k]] - uv[corners[:, 0]] for k in (1, 2))
    area = p[:, :1] * q[:, 1:] - p[:, 1:] * q[:, :1]
    along = (a * q[:, 1:] - b * p[:, 1:]) * np.sign(area)
    total = np.zeros((2, *points.shape))
    for k in range(3):
        np.add.at(total[0], corners[:, k], along)
        np.add.at(total[1], corners[:, k], np.cross(a, b))
    t, n = total / np.maximum(np.linalg.norm(total, axis=2, keepdims=True), 1e-12)
    t = t - (t * n).sum(axis=1, keepdims=True) * n
    return t / np.maximum(np.linalg.norm(t, axis=1, keepdims=True), 1e-12), n


def test_a_normal_map_bends_the_head_as_it_bends_the_face():
    """Waves of a known surface, shaded by the head's own UVs and tangents."""
    template = load_template()
    surface, base = template.surface, base_head("high")

    def waves(u, v):
        return 0.8 * np.sin(2 * np.pi * 9 * u) * np.sin(2 * np.pi * 7 * v)

    height = waves(*np.moveaxis(uv_grid(512), -1, 0)).astype(np.float32)
    map_of_face = tangent_normals(height, tangents_of(surface, 512))
    picture = np.round((map_of_face + 1) / 2 * 65535).astype(np.uint16)
    laid = head_picture(picture, template, FLAT) / 65535 * 2 - 1
    region = face_region(base.uv)
    # Within the face's square of skin, and away from lids and lips.
    edge = np.concatenate([*base.lids, base.lip_upper, base.lip_lower])
    away = np.linalg.norm(base.uv[:, None] - base.uv[edge[::4]], axis=2).min(axis=1)
    seen = np.flatnonzero((region < min(SURE, FADE[0])) & (away > 0.03))
    points = np.where(region[:, None] <= 1, 0.0, base.points)
    here = np.flatnonzero(region <= 1)
    points[here] = surface.evaluate(*base.uv[here].T)
    # As the mesh writes them: v up.
    tangent, normal = mesh_tangents(points, base.quads, base.place * (1, -1))
    x, y, z = read_picture(laid, base.place[seen]).T[..., None]
    up = np.cross(normal[seen], tangent[seen])
    bent = x * tangent[seen] + y * up + z * normal[seen]
    bent /= np.linalg.norm(bent, axis=1, keepdims=True)
    true = displaced_normals(surface, waves, *base.uv[seen].T)

    def degrees(found):
        cosine = np.clip((found * true).sum(axis=1), -1, 1)
        return np.degrees(np.arccos(cosine))

    assert np.median(degrees(normal[seen])) > 7
    assert np.median(degrees(bent)) < 0.5


def test_texture_files(tmp_path):
    picture = smooth_picture(64)
    template = load_template()
    path = write_png(tmp_path / "texture.png", picture)
    content = np.frombuffer(head_texture(path, template), np.uint8)
    made = cv2.imdecode(content, cv2.IMREAD_COLOR)[..., ::-1]
    np.testing.assert_array_equal(made, head_picture(picture, template))
    for flat, plain in (
        (np.full((64, 64, 3), (128, 128, 255), np.uint8), FLAT),
        (np.full((64, 64, 3), (32768, 32768, 65535), np.uint16), FLAT),
        (np.full((64, 64), 32768, np.uint16), STILL),
    ):
        path = write_png(tmp_path / "flat.png", flat)
        content = np.frombuffer(head_texture(path, template, plain), np.uint8)
        made = cv2.imdecode(content, cv2.IMREAD_UNCHANGED)
        assert made.dtype == flat.dtype and made.ndim == flat.ndim
        assert (made[..., ::-1] == flat[0, 0]).all()
    (tmp_path / "text.png").write_text("no picture")
    for name in ("text.png", "none.png", "."):
        with pytest.raises(ReconstructionError, match="give a PNG or JPEG"):
            head_texture(tmp_path / name, template)
