"""A known face found again: exact landmarks, known pictures, and held-out photos."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bsface import (
    BSplineSurface,
    Cancelled,
    ReconstructionError,
    Settings,
    load,
    reconstruct,
)
from bsface.camera.camera import Camera
from bsface.camera.prior import CameraPrior
from bsface.errors import PhotoFailure
from bsface.landmarks.face_models import find_models
from bsface.landmarks.landmarks import Landmarks
from bsface.landmarks.observations import LandmarkObservations
from bsface.solve.known_face import (
    KnownFace,
    PhotoLandmarks,
    PoseExpression,
    SourcePhotos,
    estimate_pose_expression,
    known_face,
)
from bsface.solve.known_face_shading import refine_pose_expression, skin_samples
from bsface.solve.motion import MotionOptions
from bsface.surface.template import load_template
from bsface.track import track
from fake_face import painted_reconstruction, person_folder, skin_pattern
from scipy.spatial.transform import Rotation

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "photos"
TEMPLATE = load_template()
INDEX = np.flatnonzero(TEMPLATE.landmark_reliable)
QUICK = Settings(control_points=(14, 15), detector=False, method="motion")


def angle(A, B) -> float:
    """Between two rotations, degrees."""
    return float(np.degrees(Rotation.from_matrix(A.T @ B).magnitude()))


def cameras(count, seed=0):
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        angles = rng.uniform(-1, 1, 3) * (30, 15, 10)
        R = Rotation.from_euler("yxz", angles, degrees=True).as_matrix()
        kappa = 1 / rng.uniform(900, 1500)
        found.append(Camera(R, 2.0, rng.uniform(-9, 9, 2), kappa, np.full(2, 199.5)))
    return found


@pytest.fixture(scope="module")
def person():
    """A face that differs from the template, its landmarks, and 8 views of them."""
    rng = np.random.default_rng(5)
    k = rng.normal(size=len(TEMPLATE.identity_modes))
    b = TEMPLATE.surface.control_points
    surface = BSplineSurface(b + np.tensordot(k, TEMPLATE.identity_modes, 1))
    uv = TEMPLATE.landmark_uv[INDEX].T
    raised = TEMPLATE.landmark_xyz[INDEX] - TEMPLATE.surface.evaluate(*uv)
    marks = surface.evaluate(*uv) + raised
    # a detector places landmarks a little elsewhere on every face
    marks = marks + rng.normal(0, 1.5, marks.shape)
    return surface, marks


def observed(pixels, views):
    pixels = np.stack(pixels)
    centres = np.array([camera.principal for camera in views])
    uv = TEMPLATE.landmark_uv[INDEX]
    return LandmarkObservations(pixels, np.ones(pixels.shape[:2]), INDEX, uv, centres)


def seen_by(camera, points, weight=None):
    """The landmarks of a photo that this camera takes."""
    weight = np.ones(len(points)) if weight is None else weight
    return PhotoLandmarks(camera.project(points), weight, camera.principal)


# --- landmarks -----------------------------------------------------------------------


def test_landmarks_of_the_person_are_learnt(person):
    surface, marks = person
    views = cameras(8)
    source = SourcePhotos(views, observed([c.project(marks) for c in views], views))
    options = MotionOptions(offset_mm=3.0, noise_mm=0.3)
    plain = known_face(surface, TEMPLATE, options)
    learnt = known_face(surface, TEMPLATE, options, source)
    front = (learnt.normals @ (0, 0, 1)) > 0.7
    away = lambda known: np.linalg.norm(known.landmarks_xyz - marks, axis=1)[front]  # noqa: E731
    assert np.median(away(plain)) > 2
    assert np.median(away(learnt)) < 0.5


def test_landmarks_are_learnt_from_photos_that_differ_in_expression(person):
    surface, marks = person
    views = cameras(8)
    options = MotionOptions(offset_mm=3.0, noise_mm=0.3)
    offsets = known_face(surface, TEMPLATE).offsets
    mixtures = np.random.default_rng(2).normal(0, 1.5, (8, offsets.shape[2]))
    pixels = [
        c.project(marks + offsets @ e) for c, e in zip(views, mixtures, strict=True)
    ]
    seen = observed(pixels, views)
    blind = known_face(surface, TEMPLATE, options, SourcePhotos(views, seen))
    source = SourcePhotos(views, seen, mixtures)
    learnt = known_face(surface, TEMPLATE, options, source)
    front = (learnt.normals @ (0, 0, 1)) > 0.7
    away = lambda known: np.linalg.norm(known.landmarks_xyz - marks, axis=1)[front]  # noqa: E731
    assert np.median(away(learnt)) < 0.5 < np.median(away(blind))


def test_exact_landmarks_give_the_camera(person):
    """Starting from the linear pose, of an orthographic camera."""
    surface, marks = person
    known = exact(surface, marks)
    for camera in cameras(4, seed=7):
        pose = estimate_pose_expression(known, seen_by(camera, marks))
        assert isinstance(pose, PoseExpression)
        assert angle(pose.camera.R, camera.R) < 0.3
        assert abs(np.log(pose.camera.s / camera.s)) < 0.01
        assert np.abs(pose.expression).max() < 0.3
        assert pose.residual_mm < 0.1


def exact(surface, marks) -> KnownFace:
    known = known_face(surface, TEMPLATE, MotionOptions(noise_mm=0.1))
    return replace(known, landmarks_xyz=marks)


def test_expression_is_seen(person):
    """The surface with the expression is nearer to the truth than the known one."""
    surface, marks = person
    known = exact(surface, marks)
    rng = np.random.default_rng(1)
    e = rng.normal(0, 1.2, known.offsets.shape[2])
    truth = known.with_expression(e)
    (camera,) = cameras(1, seed=2)
    pose = estimate_pose_expression(known, seen_by(camera, marks + known.offsets @ e))
    uv = TEMPLATE.landmark_uv[INDEX].T
    goal = truth.evaluate(*uv)
    before = np.linalg.norm(surface.evaluate(*uv) - goal, axis=1).mean()
    found = known.with_expression(pose.expression).evaluate(*uv)
    after = np.linalg.norm(found - goal, axis=1).mean()
    assert after < 0.4 * before


def test_a_known_focal_length_gives_the_distance(person):
    surface, marks = person
    known = exact(surface, marks)
    (camera,) = cameras(1, seed=3)
    near = replace(camera, kappa=1 / 400)
    few = (np.arange(len(marks)) % 20 == 0).astype(float)
    seen = seen_by(near, marks, few)
    seen.pixels[:] += np.random.default_rng(6).normal(0, 3, seen.pixels.shape)
    unknown = estimate_pose_expression(known, seen)
    told = estimate_pose_expression(known, replace(seen, focal_px=near.focal_px))
    assert abs(np.log(told.camera.distance_mm / 400)) < 0.05
    assert abs(np.log(unknown.camera.distance_mm / 400)) > 0.1


def test_few_wrong_landmarks_do_not_matter(person):
    surface, marks = person
    known = exact(surface, marks)
    (camera,) = cameras(1, seed=3)
    seen = seen_by(camera, marks)
    seen.pixels[::12] += (40, -60)
    pose = estimate_pose_expression(known, seen)
    assert angle(pose.camera.R, camera.R) < 1.0


def test_larger_face_is_seen_the_same(person):
    """Twice the size in millimetres: the same rotation, half the scale."""
    surface, marks = person
    double = BSplineSurface(2 * surface.control_points)
    (camera,) = cameras(1, seed=4)
    poses = [
        estimate_pose_expression(
            known_face(face, TEMPLATE), seen_by(camera, marks), CameraPrior(distance)
        )
        for face, distance in ((surface, 1200.0), (double, 2400.0))
    ]
    assert angle(poses[0].camera.R, poses[1].camera.R) < 0.02
    assert poses[0].camera.s == pytest.approx(2 * poses[1].camera.s, rel=1e-3)
    assert np.allclose(poses[0].expression, poses[1].expression, atol=1e-2)


def test_too_few_landmarks_are_a_failure(person):
    surface, marks = person
    known = exact(surface, marks)
    weight = np.zeros(len(marks))
    weight[:3] = 1
    seen = PhotoLandmarks(np.zeros((len(marks), 2)), weight, np.zeros(2), "a.jpg")
    found = estimate_pose_expression(known, seen)
    assert isinstance(found, PhotoFailure)
    assert found.reason.startswith("a.jpg: only 3 landmarks")


# --- intensities ---------------------------------------------------------------------


def test_intensities_correct_the_pose():
    """A drawn photo, and a start that is some degrees and millimetres off."""
    face = painted_reconstruction(count=3, side=220)
    at = np.stack(np.meshgrid(*2 * [np.linspace(0.12, 0.88, 60)]), -1).reshape(-1, 2)
    index = np.arange(30)
    uv = face.template.landmark_uv[:30]
    known = KnownFace(
        surface=face.surface,
        index=index,
        landmarks_xyz=face.surface.evaluate(*uv.T),
        normals=face.surface.normals(*uv.T),
        offsets=np.zeros((30, 3, 0)),
        modes=np.zeros((0, *face.surface.control_points.shape)),
        sigma=np.full(30, 3.0),
    )
    albedo = skin_pattern(at) @ (0.2126, 0.7152, 0.0722)
    points = skin_samples(known, at, albedo / np.median(albedo))
    for photo, truth in zip(face.photos, face.cameras, strict=True):
        step = np.array([0.04, -0.05, 0.03, 0.02, 1.5, -1.0, 0.0])
        start = PoseExpression(truth.moved(step), np.zeros(0), 1.0, 0)
        seen = seen_by(start.camera, known.landmarks_xyz)
        pose = refine_pose_expression(known, points, start, photo, seen)
        assert angle(start.camera.R, truth.R) > 3.9
        assert angle(pose.camera.R, truth.R) < 1.0
        moved = pose.camera.project(known.landmarks_xyz) - truth.project(
            known.landmarks_xyz
        )
        assert np.abs(moved).max() / truth.s < 1.0  # mm


def test_photo_that_misses_the_face_keeps_the_start():
    face = painted_reconstruction(count=1, side=60)
    known = known_face(TEMPLATE.surface, TEMPLATE)
    at = np.stack(np.meshgrid(*2 * [np.linspace(0.2, 0.8, 20)]), -1).reshape(-1, 2)
    points = skin_samples(known, at, np.ones(len(at)))
    away = Camera(np.eye(3), 1.0, np.full(2, 5000.0))
    start = PoseExpression(away, np.zeros(len(known.modes)), 1.0, 3)
    seen = seen_by(away, known.landmarks_xyz)
    found = refine_pose_expression(known, points, start, face.photos[0], seen)
    assert found is start


# --- the whole way -------------------------------------------------------------------


@pytest.fixture(scope="module")
def known_folder(tmp_path_factory):
    """A face from four drawn photos, and a folder with three others of it."""
    folder = tmp_path_factory.mktemp("track")
    face = reconstruct(person_folder(folder / "known", count=4), QUICK)
    person_folder(folder / "new", count=3, seed=9)
    return face, folder / "new"


def test_folder(known_folder):
    face, new = known_folder
    steps = []
    found = track(new, face, progress=steps.append)
    assert [p.name for p in found.photos] == ["0.png", "1.png", "2.png"]
    assert found.failures == ()
    assert steps[-1].overall == 1.0
    for photo in found.photos:
        assert photo.surface.shape == face.surface.shape
        assert photo.residual_mm < 1.5
        assert np.isfinite(photo.expression).all()
        # the drawn person always has the same expression
        away = photo.surface.control_points - face.surface.control_points
        assert np.linalg.norm(away, axis=2).mean() < 1.5


def test_saved_face_serves_as_well(known_folder, tmp_path):
    face, new = known_folder
    saved = load(face.save(tmp_path / "face.npz"))
    here, there = track(new, face), track(new, saved)
    for a, b in zip(here.photos, there.photos, strict=True):
        assert np.allclose(a.camera.R, b.camera.R, atol=1e-9)
        assert np.allclose(a.expression, b.expression, atol=1e-9)


def test_mixed_expressions_survive_the_file(known_folder, tmp_path):
    """A face of photos that differ in expression: tracked from its file as it was."""
    face, new = known_folder
    e = np.random.default_rng(3).normal(0, 1.5, face.expressions.shape)
    mixed = replace(face, expressions=e)
    saved = load(mixed.save(tmp_path / "mixed.npz"))
    here, there, other = track(new, mixed), track(new, saved), track(new, face)
    for a, b, c in zip(here.photos, there.photos, other.photos, strict=True):
        assert np.allclose(a.camera.R, b.camera.R, atol=1e-9)
        assert np.allclose(a.expression, b.expression, atol=1e-9)
        assert not np.allclose(a.expression, c.expression, atol=1e-3)


def test_single_photo_and_given_landmarks(known_folder):
    face, new = known_folder
    one = track(new / "1.png", face)
    assert [p.name for p in one.photos] == ["1.png"]
    points = one.photos[0].camera.project(TEMPLATE.landmark_xyz)
    marks = {"1.png": Landmarks("1.png", "468", points, np.ones(468), source="hand")}
    again = track([new / "1.png"], face, landmarks=marks)
    assert angle(again.photos[0].camera.R, one.photos[0].camera.R) < 2


def test_photos_of_no_use(known_folder, tmp_path):
    face, new = known_folder
    (tmp_path / "a.png").write_bytes(b"no picture")
    mixed = track([tmp_path / "a.png", new / "0.png"], face)
    assert [p.name for p in mixed.photos] == ["0.png"]
    assert [f.code for f in mixed.failures] == ["unreadable"]
    with pytest.raises(ReconstructionError, match="The photo cannot be used"):
        track(tmp_path / "a.png", face)
    with pytest.raises(ReconstructionError):
        track(tmp_path / "none", face)


def test_cancelling(known_folder):
    face, new = known_folder

    def stop(step):
        raise Cancelled

    with pytest.raises(Cancelled):
        track(new, face, progress=stop)


def test_held_out_examples():
    """Photos of the examples that the face was not made of."""
    try:
        find_models()
    except ReconstructionError as gone:
        pytest.skip(f"the model files are not installed: {gone}")
    paths = [EXAMPLES / f"{k:03d}.jpg" for k in (0, 5, 11, 20, 26, 30)]
    settings = Settings(control_points=(16, 16), iterations=2, shadows=False)
    face = reconstruct(paths[:4], settings)
    everything = reconstruct(paths, settings)
    found = track(paths[4:], face)
    assert [p.name for p in found.photos] == [p.name for p in paths[4:]]
    for photo, other in zip(found.photos, everything.cameras[4:], strict=True):
        # as if the photo had taken part in the reconstruction
        assert angle(photo.camera.R, other.R) < 5
        away = np.linalg.norm(
            photo.camera.project(TEMPLATE.landmark_xyz)
            - other.project(TEMPLATE.landmark_xyz),
            axis=1,
        )
        assert np.median(away) / photo.camera.s < 3  # mm


@pytest.mark.parametrize(
    "photos, kind, words",
    [
        (np.array(5), TypeError, "photos must be a folder"),
        (np.zeros((40, 40)), ReconstructionError, r"One picture of shape \(40, 40\)"),
    ],
)
def test_arrays_that_are_no_photos_are_refused_in_a_sentence(photos, kind, words):
    face = painted_reconstruction(count=2, side=48)
    with pytest.raises(kind, match=words):
        track(photos, face, {"detector": False})
