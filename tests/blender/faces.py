"""A small made-up reconstruction with cameras, lights and photo files."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import cv2
import numpy as np
from blender.checkout import load
from fake_face import bare_reconstruction
from scipy.spatial.transform import Rotation

Camera = load("core.camera.camera").Camera
Landmarks = load("core.landmarks.landmarks").Landmarks

Outcome = load("bsface_addon.solving").Outcome

SIZE = (160, 200)
YAWS = (-30.0, 0.0, 25.0)


@dataclass(frozen=True)
class Report:
    name: str
    status: str
    reason: str = ""
    yaw: float = 0.0


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


def reconstruction(folder, kappa=1 / 900):
    """Three used photos and one left out."""
    paths = photo_files(folder)
    lights = np.zeros((len(paths), 9))
    lights[:, 0], lights[:, 3] = 0.5, 0.4
    lights[:, 1] = [-0.3, 0, 0.3]
    photos = tuple(SimpleNamespace(name=p.name, path=p, size=SIZE) for p in paths)
    return replace(
        bare_reconstruction(),
        photos=photos,
        cameras=tuple(pose(yaw, kappa) for yaw in YAWS),
        landmarks=tuple(
            Landmarks(p.name, "40", np.full((40, 2), 50.0), np.ones(40)) for p in photos
        ),
        photometric=SimpleNamespace(lights=lights),
        reports=(
            *(Report(p.name, "used", yaw=y) for p, y in zip(photos, YAWS, strict=True)),
            Report("cat.png", "no_face", "cat.png shows no face; remove it."),
        ),
        warnings=("The light hardly differs.",),
    )


class FakeSolver:
    """Answers without solving, with what it was given; keeps the requests.

    An answer that is an exception is raised.
    """

    def __init__(self, folder):
        self.requests = []
        self.answer = Outcome(reconstruction(folder))
        self.detection = None
        self.faces = ()

    def solve(self, request, progress=None):
        self.requests.append(request)
        return given(self.answer)

    def detect(self, request, progress=None):
        self.requests.append(request)
        return given(self.detection)

    def faces_in(self, path, name, scheme):
        return given(self.faces)


def given(answer):
    """The answer, raised if it is an exception."""
    if isinstance(answer, Exception):
        raise answer
    return answer
