"""The picture of a head: the face's texels as they are, no edge, plain skin around."""

import cv2
import numpy as np
import pytest
from bsface.drawing.pictures import write_png
from bsface.drawing.render import read_picture
from bsface.errors import ReconstructionError
from bsface.rig.base_head import SQUARE, base_head, face_region
from bsface.surface.template import load_template
from bsface.texture.head import FADE, FLAT, head_picture, head_texture

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
    made = head_picture(picture, load_template(), plain=(128, 128, 255))
    assert made.shape == (84, 84, 3)
    assert (made[0] == (128, 128, 255)).all()
    assert (made[42, 42] == 200).all()


def test_texture_files(tmp_path):
    picture = smooth_picture(64)
    template = load_template()
    path = write_png(tmp_path / "texture.png", picture)
    content = np.frombuffer(head_texture(path, template), np.uint8)
    made = cv2.imdecode(content, cv2.IMREAD_COLOR)[..., ::-1]
    np.testing.assert_array_equal(made, head_picture(picture, template))
    for kind, depth in ((np.uint8, 255), (np.uint16, 65535)):
        flat = np.round(np.full((64, 64, 3), FLAT) * (depth / 255)).astype(kind)
        path = write_png(tmp_path / "normal.png", flat)
        content = np.frombuffer(head_texture(path, template, FLAT), np.uint8)
        made = cv2.imdecode(content, cv2.IMREAD_UNCHANGED)[..., ::-1]
        assert made.dtype == kind and (made == flat[0, 0]).all()
    (tmp_path / "text.png").write_text("no picture")
    for name in ("text.png", "none.png", "."):
        with pytest.raises(ReconstructionError, match="give a PNG or JPEG"):
            head_texture(tmp_path / name, template)
