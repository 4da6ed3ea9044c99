"""The whole way, from photos to a face: what comes out, for every method.

Photos are drawn of a known face, with landmarks given, so that the truth is known and
no detector is needed.
"""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from bsface import reconstruct
from bsface.errors import FailureCode
from bsface.progress import STAGES
from bsface.surface.alignment import eye_centres
from drawn_person import MOTION, QUICK, TEMPLATE, error


def test_face_is_that_of_the_person(truth, drawn, result):
    photos, marks = drawn
    plain = error(TEMPLATE.surface, truth)
    motion = reconstruct(photos, MOTION, landmarks=marks)
    assert plain > 2
    assert error(motion.surface, truth) < 0.7 * plain
    assert error(result.surface, truth) < 0.6 * plain
    assert error(result.surface, truth) < error(motion.surface, truth)


def test_result_is_whole(result):
    n = 5
    assert result.surface.shape == result.template.surface.shape == (14, 15)
    assert len(result.photos) == len(result.landmarks) == len(result.cameras) == n
    assert [p.name for p in result.photos] == [m.photo for m in result.landmarks]
    light = result.photometric
    assert light.lights.shape[0] == light.weights.shape[0] == n
    assert light.albedo.shape == light.normals.shape == (len(light.uv), 3)
    parts = [getattr(light, k) for k in light.__dataclass_fields__]
    parts = [k for k in parts if isinstance(k, np.ndarray)]
    parts += [result.deviation, *(c.R for c in result.cameras)]
    for part in parts:
        assert np.isfinite(part).all()
    assert result.deviation.shape == (14, 15)
    assert (result.deviation >= 0).all()
    assert [r.name for r in result.reports] == [f"picture {k + 1}" for k in range(n)]
    for row in result.reports:
        assert row.status == "used"
        assert 0 < row.reprojection_pct < 5
        assert 0 <= row.weight <= 1
        assert abs(row.yaw) < 45 and abs(row.roll) < 20
    assert {row.stage for row in result.history} == {"motion", "refine"}
    assert result.settings == QUICK
    assert set(result.seconds) <= set(STAGES)


def test_frame_of_the_result(result):
    right, left = eye_centres(result.surface, result.template)
    np.testing.assert_allclose(right, [-31, 0, 0], atol=1e-6)
    np.testing.assert_allclose(left, [31, 0, 0], atol=1e-6)


def test_poses_of_the_report_are_those_of_the_photos(result):
    yaw = [row.yaw for row in result.reports]
    np.testing.assert_allclose(yaw, np.linspace(-28, 28, 5), atol=4)


def test_cameras_see_the_face_where_the_landmarks_are(result):
    uv = TEMPLATE.landmark_uv[TEMPLATE.schemes["68"]]
    inner = TEMPLATE.landmark_reliable[TEMPLATE.schemes["68"]]
    points = result.surface.evaluate(*uv.T)
    for camera, marks in zip(result.cameras, result.landmarks, strict=True):
        away = np.linalg.norm(camera.project(points) - marks.points, axis=1)
        assert np.median(away[inner]) < 0.06 * 62 * camera.s


def test_eye_distance_scales_everything(drawn, result):
    photos, marks = drawn
    other = reconstruct(photos, replace(QUICK, eye_distance_mm=6.2), landmarks=marks)
    np.testing.assert_allclose(
        10 * other.surface.control_points, result.surface.control_points, atol=1e-6
    )
    np.testing.assert_allclose(10 * other.deviation, result.deviation, atol=1e-9)
    np.testing.assert_allclose(
        other.cameras[0].distance_mm * 10, result.cameras[0].distance_mm
    )


@pytest.mark.parametrize(
    "change",
    [
        {"method": "imls", "outer_passes": 1},
        {"method": "paper", "outer_passes": 1},
        {"method": "motion"},
        {"method": "motion", "perspective": False, "expressions": False},
        {"light_degree": 1, "modes": 0.0, "expression_modes": 0.0},
    ],
)
def test_every_method_gives_a_finite_face(drawn, change):
    photos, marks = drawn
    found = reconstruct(photos[:4], replace(QUICK, **change), landmarks=marks)
    assert np.isfinite(found.surface.control_points).all()
    assert error(found.surface, TEMPLATE.surface) < 12
    assert (found.photometric is None) == (change.get("method") == "motion")
    orthographic = change.get("perspective") is False
    assert all((c.kappa == 0) >= orthographic for c in found.cameras)


def test_own_templates(drawn):
    """A bare surface keeps the landmarks of the bundled template."""
    photos, marks = drawn
    edited = TEMPLATE.surface.resampled((12, 13))
    one = reconstruct(photos[:3], MOTION, landmarks=marks, template=edited)
    assert one.surface.shape == (12, 13)
    two = reconstruct(
        photos[:3],
        replace(MOTION, control_points=(12, 13)),
        landmarks=marks,
        template=TEMPLATE,
    )
    np.testing.assert_allclose(
        one.surface.control_points, two.surface.control_points, atol=1e-9
    )


def test_ignored_photos_leave_no_trace(drawn):
    photos, marks = drawn
    found = reconstruct(photos, MOTION, landmarks=marks, ignore=["picture 5"])
    fewer = reconstruct(photos[:4], MOTION, landmarks=marks)
    assert found.reports[4].status == "ignored"
    assert found.reports[4].status in set(FailureCode)
    np.testing.assert_allclose(
        found.surface.control_points, fewer.surface.control_points, atol=1e-9
    )


def test_landmark_files_need_no_detector(tmp_path, drawn):
    """Photos and landmark files in a folder: the same face as from arrays."""
    photos, marks = drawn
    for index, (pixels, item) in enumerate(
        zip(photos[:3], marks.values(), strict=False)
    ):
        path = tmp_path / f"{index}.png"
        cv2.imwrite(str(path), pixels[..., ::-1])
        record = {"scheme": "68", "points": item.points.tolist()}
        path.with_suffix(".json").write_text(json.dumps(record))
    found = reconstruct(tmp_path, MOTION)
    expected = reconstruct(photos[:3], MOTION, landmarks=marks)
    np.testing.assert_allclose(
        found.surface.control_points, expected.surface.control_points, atol=1e-9
    )
