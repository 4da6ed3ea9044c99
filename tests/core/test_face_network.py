"""The network that describes faces, and the picture of a face that it is shown."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from bsface.errors import ReconstructionError
from bsface.identity import face_network
from bsface.identity.descriptor import (
    ANCHORS,
    PLACES,
    anchor_points,
    describe_face,
    face_crop,
)
from bsface.identity.face_network import FaceNetwork, read_weights
from bsface.images.folder import list_photos
from bsface.landmarks.candidates import CandidateReader
from bsface.landmarks.landmarks import Landmarks
from bsface.progress import never_cancelled
from bsface.settings import Settings
from bsface.surface.template import load_template
from hypothesis import given, settings
from hypothesis import strategies as st
from photo_folders import PHOTOS
from scipy.spatial.distance import cdist


@pytest.fixture(scope="module")
def network(models):
    return FaceNetwork(models.recognition)


def forward(picture, convolutions, last):
    """The network written out in NumPy, as dlib defines it."""

    def windows(x, side, stride):
        view = np.lib.stride_tricks.sliding_window_view(x, (side, side), (1, 2))
        return view[:, ::stride, ::stride]

    def convolved(x, layer):
        x = np.pad(x, ((0, 0), *[(layer.padding,) * 2] * 2))
        view = windows(x, layer.weight.shape[2], layer.stride)
        out = np.einsum("ihwab,oiab->ohw", view, layer.weight, optimize=True)
        return out + layer.bias[:, None, None]

    def grown(x, shape):
        return np.pad(x, [(0, b - a) for a, b in zip(x.shape, shape, strict=True)])

    x = ((picture - face_network.MEAN_RGB) / 256).transpose(2, 0, 1).astype(float)
    x = np.maximum(convolved(x, convolutions[0]), 0)
    x = windows(x, 3, 2).max(axis=(3, 4))
    for one, two in zip(convolutions[1::2], convolutions[2::2], strict=True):
        y = convolved(np.maximum(convolved(x, one), 0), two)
        if one.stride == 2:
            x = windows(x, 2, 2).mean(axis=(3, 4))
        shape = np.maximum(x.shape, y.shape)
        x = np.maximum(grown(x, shape) + grown(y, shape), 0)
    return x.mean(axis=(1, 2)) @ last


def test_opencv_computes_what_the_layers_say(models, network):
    """The model that OpenCV runs, against its definition written out."""
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (150, 150, 3)).astype(np.uint8)
    picture = cv2.GaussianBlur(picture, (0, 0), 5)
    layers = read_weights(models.recognition.read_bytes())
    both = [forward(view, *layers) for view in (picture, picture[:, ::-1])]
    found = network.describe(picture)
    np.testing.assert_allclose(found, np.mean(both, axis=0), atol=2e-5)
    assert np.linalg.norm(found) > 0.5


def test_a_mirror_image_has_the_same_descriptor(network):
    rng = np.random.default_rng(1)
    picture = rng.integers(0, 256, (150, 150, 3)).astype(np.uint8)
    np.testing.assert_allclose(
        network.describe(picture), network.describe(picture[:, ::-1]), atol=1e-12
    )


@pytest.mark.parametrize("part", [0, 10, 400, 30_000, 22_000_000])
def test_damaged_file_of_the_network_is_told(models, tmp_path, part):
    path = tmp_path / "network.dat"
    path.write_bytes(models.recognition.read_bytes()[:part])
    with pytest.raises(ReconstructionError, match=r"network\.dat is damaged"):
        FaceNetwork(path)


@given(st.binary(max_size=300))
@settings(deadline=None, max_examples=100)
def test_any_bytes_are_read_or_refused(data):
    with pytest.raises(ValueError):
        read_weights(b"\x05con_4\x01\x02" + data)


def test_face_is_cut_out_upright_whatever_its_place_and_turn():
    rng = np.random.default_rng(2)
    for _ in range(5):
        angle, size = rng.uniform(-3, 3), rng.uniform(40, 300)
        turn = np.array(
            [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        )
        shift = rng.uniform(0, 500, 2)
        crop = face_crop(size * PLACES @ turn.T + shift)
        # The square with its margin: twice the side from edge to edge.
        corner = crop.to_image(np.zeros(2), 1)
        opposite = crop.to_image(np.ones(2), 1)
        np.testing.assert_allclose(corner, size * turn @ (-0.25, -0.25) + shift)
        np.testing.assert_allclose(opposite, size * turn @ (1.25, 1.25) + shift)


@pytest.mark.parametrize("scheme", ["468", "68", "40"])
def test_all_schemes_have_the_anchors(scheme):
    rows = load_template().schemes[scheme]
    points = np.stack([rows, rows], axis=1).astype(float)
    marks = Landmarks("a", scheme, points, np.ones(len(rows)))
    assert anchor_points(marks)[:, 0].tolist() == list(ANCHORS)
    weight = np.ones(len(rows))
    weight[np.flatnonzero(np.asarray(rows) == ANCHORS[0])] = 0
    assert anchor_points(replace(marks, weight=weight)) is None


def test_photos_of_one_made_up_person_are_close(network):
    """Pose, light and expression vary; within the distance of one person."""
    reader = CandidateReader(load_template(), Settings(), {})
    faces = [
        reader.read(path, path.name, never_cancelled)[0]
        for path in list_photos(PHOTOS)[::5]
    ]
    rows = [describe_face(f.photo, f.landmarks, network) for f in faces]
    mean = cdist(rows, rows).sum(axis=1) / (len(rows) - 1)
    assert mean.max() < 0.5
