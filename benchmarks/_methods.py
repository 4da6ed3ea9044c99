"""The rows of the accuracy table: name -> what makes a face of a set's photos."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, replace

import numpy as np
from _baseline import baseline
from _faces import Face, depth_face, given_face, surface_face
from _sets import GIVEN_TEMPLATE
from bsface.camera.camera import Camera
from bsface.camera.linear_pose import linear_pose
from bsface.errors import ReconstructionError
from bsface.prepare import make_problem
from bsface.problem import PhotoCollection
from bsface.reconstruct import solve
from bsface.result import Reconstruction
from bsface.settings import Settings
from bsface.solve.paper.as_printed import sample_photos
from bsface.surface.template import Template

#: Name -> words for the page. "default" is what a user gets who chooses nothing.
METHODS = {
    "template": "template alone, only aligned",
    "given-template": "template of ../shared/template, only aligned",
    "baseline": "the paper's comparison method [30]: photometric stereo, integrated",
    "motion": 'landmarks only, method="motion"',
    "paper": 'Algorithm 1 as printed, method="paper"',
    "imls": 'Algorithm 1 with robust ingredients, method="imls"',
    "default": "the default",
}


@dataclass(frozen=True)
class Outcome:
    """What a method made.

    Attributes
    ----------
    face : Face or None
        None when the method failed.
    seconds : float
        Without the landmarks, which all methods share.
    note : str
        Why it failed.
    result : Reconstruction or None
    used : int
        Number of photos that went in.
    """

    face: Face | None
    seconds: float = 0.0
    note: str = ""
    result: Reconstruction | None = None
    used: int = 0


def run(
    name: str, collection: PhotoCollection, template: Template, settings: Settings
) -> Outcome:
    """Run one row of the table; a failure is an outcome too.

    Parameters
    ----------
    name : str
        One of `METHODS`.
    gathered : Gathered
        Photos and landmarks of a set.
    template : Template
        With the settings' number of control points.
    settings : Settings
        Of the default; the other methods change ``method`` in it.
    """
    started = time.perf_counter()
    try:
        if name == "template":
            return Outcome(surface_face(template.surface, template))
        if name == "given-template":
            return Outcome(given_face(GIVEN_TEMPLATE, template))
        if name == "baseline":
            face = _baseline(collection, template)
            result = None
        else:
            if name != "default":
                settings = replace(settings, method=name)
            result = solve(make_problem(collection, template, settings))
            face = surface_face(result.surface, template)
    except (ReconstructionError, ValueError, np.linalg.LinAlgError) as error:
        return Outcome(None, time.perf_counter() - started, str(error))
    seconds = time.perf_counter() - started
    if not np.isfinite(face.points).all():
        return Outcome(None, seconds, "the surface is not finite")
    return Outcome(face, seconds, "", result, len(collection.photos))


def available(names: list[str] | None) -> list[str]:
    """The methods asked for, without those whose data is not there."""
    unknown = sorted(set(names or ()) - set(METHODS))
    if unknown:
        raise SystemExit(f"no method {', '.join(unknown)}: {', '.join(METHODS)}.")
    chosen = names or list(METHODS)
    if names is None and not GIVEN_TEMPLATE.is_file():
        chosen.remove("given-template")
    return chosen


def changed_settings(pairs: list[str]) -> Settings:
    """The default settings with some changed, ``NAME=VALUE`` each."""
    values = {}
    for pair in pairs:
        name, _, value = pair.partition("=")
        try:
            values[name] = json.loads(value)
        except json.JSONDecodeError:
            values[name] = value
    try:
        return Settings.from_dict(values)
    except (ValueError, TypeError) as error:
        raise SystemExit(str(error)) from None


def _baseline(collection: PhotoCollection, template: Template) -> Face:
    cameras = [
        frontalising_camera(collection, template, i)
        for i in range(len(collection.photos))
    ]

    def sample(uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return sample_photos(collection.photos, template.surface, cameras, uv)

    found = baseline(template.surface, sample, inside=template.inside)
    return depth_face(found, template)


def frontalising_camera(
    collection: PhotoCollection, template: Template, i: int
) -> Camera:
    """Pose of photo ``i`` from the template's landmarks alone, as in [30]."""
    photo, marks = collection.photos[i], collection.landmarks[i]
    which = template.schemes[marks.scheme]
    weight = marks.weight * template.landmark_reliable[which]
    middle = ((photo.size[0] - 1) / 2, (photo.size[1] - 1) / 2)
    pose = linear_pose(
        marks.points, template.landmark_xyz[which], weight, middle, photo.name
    )
    if not isinstance(pose, Camera):
        raise ReconstructionError(pose.reason)
    return pose
