"""A small made-up reconstruction with cameras, lights and photo files."""

import cv2
import numpy as np
from blender.checkout import load
from fake_face import face_surface
from scipy.spatial.transform import Rotation

Camera = load("core.camera.camera").Camera
Landmarks = load("core.landmarks.landmarks").Landmarks
Photo = load("core.images.photo").Photo
PhotometricEvidence = load("core.photometry.lighting").PhotometricEvidence
BSplineSurface = load("core.surface.bspline").BSplineSurface
Settings = load("core.settings").Settings
load_template = load("core.surface.template").load_template
result = load("core.result")
Outcome = load("bsface_addon.solving").Outcome
surface_object = load("bsface_addon.surface_object")

SIZE = (160, 200)
YAWS = (-30.0, 0.0, 25.0)


def pose(yaw, kappa=1 / 900, size=SIZE):
    return Camera(
        R=Rotation.from_euler("yxz", [yaw, 5, -4], degrees=True).as_matrix(),
        s=0.9,
        t=np.array([6.0, -11.0]),
        kappa=kappa,
        principal=(np.array(size) - 1) / 2 + (3, -2),
    )


def photo_files(folder, size=SIZE):
    """Pictures of nothing, one a camera; their paths."""
    folder.mkdir(exist_ok=True)
    found = []
    for i in range(len(YAWS)):
        path = folder / f"{i}.png"
        picture = np.full((size[1], size[0], 3), 40 * i + 60, np.uint8)
        cv2.imwrite(str(path), picture)
        found.append(path)
    return found


def reconstruction(folder, kappa=1 / 900, mixtures=None):
    """Three used photos and one left out.

    Parameters
    ----------
    mixtures : (3, k) array, optional
        Expressions of the photos; by default they share one.
    """
    paths = photo_files(folder)
    count = len(paths)
    surface = BSplineSurface(face_surface().control_points)
    template = load_template().resampled(surface.shape)
    lights = np.zeros((count, 9))
    lights[:, 0], lights[:, 3] = 0.5, 0.4
    lights[:, 1] = np.linspace(-0.3, 0.3, count)
    uv = np.random.default_rng(0).uniform(0.2, 0.8, (20, 2))
    evidence = PhotometricEvidence(
        uv=uv,
        normals=surface.normals(*uv.T),
        albedo=np.full((20, 3), 0.5),
        lights=lights,
        weights=np.ones((count, 20)),
        residual=np.full((count, 20), 0.1),
        singular_values=np.array([3.0, 1.0, 0.5]),
    )
    pixels = np.full((SIZE[1], SIZE[0], 3), 100, np.uint8)
    photos = tuple(Photo(path.name, path, SIZE, pixels) for path in paths)
    used = [
        result.PhotoReport(photo.name, "used", yaw=yaw)
        for photo, yaw in zip(photos, YAWS, strict=True)
    ]
    left_out = "cat.png shows no face; remove it."
    if mixtures is None:
        mixtures = np.zeros((count, len(template.expression_modes)))
    return result.Reconstruction(
        surface=surface,
        template=template,
        photos=photos,
        landmarks=tuple(
            Landmarks(p.name, "40", np.full((40, 2), 50.0), np.ones(40)) for p in photos
        ),
        cameras=tuple(pose(yaw, kappa) for yaw in YAWS),
        photometric=evidence,
        reports=(*used, result.PhotoReport("cat.png", "no_face", left_out)),
        deviation=np.linspace(0.5, 1.5, surface.control_points[..., 0].size).reshape(
            surface.shape
        ),
        settings=Settings(control_points=surface.shape),
        expressions=mixtures,
        warnings=("The light hardly differs.",),
    )


def points(face, key=None):
    """Control points of a face in the scene, or of one of its shape keys."""
    return surface_object.read(face, key)


class FakeSolver:
    """Answers without solving, with what it was given; keeps the requests.

    An answer that is an exception is raised.
    """

    def __init__(self, folder):
        self.requests = []
        self.answer = Outcome.of(reconstruction(folder))
        self.detection = None
        self.faces = ()

    def solve(self, request, progress=None):
        self.requests.append(request)
        return given(self.answer)

    def detect(self, request, progress=None):
        self.requests.append(request)
        return given(self.detection)

    def forget(self):
        pass

    def faces_in(self, path, name, scheme):
        return given(self.faces)


def given(answer):
    """The answer, raised if it is an exception."""
    if isinstance(answer, Exception):
        raise answer
    return answer
