"""The person's face in each photo, and which photos show somebody else.

All faces of all photos are described and compared: first the person's face is chosen
in each photo (`choice`), then photos of somebody else are set apart (`same_person`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial.distance import cdist

from .._types import Array
from ..errors import PhotoFailure, ReconstructionError
from ..images.photo import Photo
from ..landmarks.face_models import ModelFiles, find_models, intact
from ..landmarks.face_selection import Candidate
from ..landmarks.landmarks import Landmarks
from ..progress import CheckCancelled, never_cancelled
from .choice import Choice, choose
from .descriptor import describe_face
from .face_network import FaceNetwork
from .same_person import split_identities

Outcome = Sequence[tuple[Candidate, ...] | PhotoFailure]
Chosen = list[Candidate | PhotoFailure]
#: Descriptor of a face in a photo, or None if it cannot be had.
Describe = Callable[[Photo, Landmarks], Array | None]

SIMILAR = 0.25  # of the person's photos; a larger group may be the one that was meant


def identify(
    outcome: Outcome,
    *,
    one_person: bool = True,
    models: ModelFiles | None = None,
    describe: Describe | None = None,
    check_cancelled: CheckCancelled = never_cancelled,
) -> tuple[Chosen, tuple[str, ...]]:
    """One face per photo, the same person's in all of them.

    Landmarks that were placed by hand say that this face is meant: such a photo is
    never set apart, only doubted.

    Parameters
    ----------
    outcome : sequence of tuples of Candidate, or PhotoFailure
        The faces of each photo.
    one_person : bool
        Whether photos of somebody else become failures, and doubts are told.
    models : ModelFiles, optional
        By default those that are found.
    describe : callable, optional
        By default the face recognition network of the models.
    check_cancelled : callable, optional
        Called before each face that is described.

    Returns
    -------
    list of Candidate or PhotoFailure
        In the order given.
    tuple of str
        Identity warnings: sentences for the report.

    Raises
    ------
    ReconstructionError
        If a photo shows several faces and the face recognition model is missing.
    """
    photos = [(i, x) for i, x in enumerate(outcome) if not isinstance(x, PhotoFailure)]
    # Until they are compared the largest, which comes first.
    chosen = [x if isinstance(x, PhotoFailure) else x[0] for x in outcome]
    several = any(len(found) > 1 for _, found in photos)
    if not several and (not one_person or len(photos) < 2):
        return _usable(chosen), ()
    if describe is None:
        try:
            path = models.recognition if models else intact(find_models().recognition)
            network = FaceNetwork(path)
        except ReconstructionError as error:
            if several:
                raise
            told = f"Whether all photos show one person was not checked. {error}"
            return _usable(chosen), (told,)
        describe = partial(describe_face, network=network)
    faces, distance = _compared(photos, describe, check_cancelled)
    if not faces:
        return _usable(chosen), ()
    _, photo = np.unique([i for i, _ in faces], return_inverse=True)
    choice = choose(photo, distance, np.array([_size(face) for _, face in faces]))
    found = dict(photos)
    for k in choice.faces:
        i, face = faces[k]
        chosen[i] = _noted(face, found[i], len(choice.faces) > 1)
    warnings = _of_two_people(choice, [face.photo.name for _, face in faces])
    chosen = _usable(chosen)
    if one_person:
        # Faces of no use say nothing about the others.
        known = [k for k in choice.faces if isinstance(chosen[faces[k][0]], Candidate)]
        failures, doubts = _separate(
            [faces[k][1] for k in known], distance[np.ix_(known, known)]
        )
        warnings += doubts
        for k, failure in failures.items():
            chosen[faces[known[k]][0]] = failure
    return chosen, warnings


def _compared(
    photos: Sequence[tuple[int, tuple[Candidate, ...]]],
    describe: Describe,
    check_cancelled: CheckCancelled,
) -> tuple[list[tuple[int, Candidate]], Array]:
    """All faces that can be described, with their photos' numbers; the distances."""
    faces, rows = [], []
    for i, found in photos:
        for face in found:
            check_cancelled()
            descriptor = describe(face.photo, face.found or face.landmarks)
            if descriptor is not None:
                faces.append((i, face))
                rows.append(descriptor)
    return faces, cdist(rows, rows) if faces else np.zeros((0, 0))


def _usable(chosen: Chosen) -> Chosen:
    """Faces of no use become their failures."""
    return [
        x if isinstance(x, PhotoFailure) or x.failure is None else x.failure
        for x in chosen
    ]


def _size(face: Candidate) -> float:
    """Of the face, relative to the picture."""
    return face.fit.eye_distance / float(np.hypot(*face.photo.size))


def _noted(face: Candidate, others: tuple[Candidate, ...], compared: bool) -> Candidate:
    """The face with a note which of several it is; counted as one reads."""
    if len(others) < 2:
        return face
    x = [other.landmarks.points[:, 0].mean() for other in others]
    rank = 1 + sum(place < face.landmarks.points[:, 0].mean() for place in x)
    why = "most similar to the faces of the other photos" if compared else "the largest"
    note = f"face {rank} of {len(others)} from the left chosen: {why}"
    if face.landmarks.note:
        note += f"; {face.landmarks.note}"
    return replace(face, landmarks=replace(face.landmarks, note=note))


def _of_two_people(choice: Choice, names: Sequence[str]) -> tuple[str, ...]:
    if not len(choice.rival):
        return ()
    return (
        f"Two people are in {len(choice.rival)} of the photos, such as "
        f"{names[choice.rival[0]]}; the face is that of the person who is larger in "
        "them. To get the other one, choose that face by hand or crop the photos.",
    )


def _separate(
    faces: Sequence[Candidate], distance: Array
) -> tuple[dict[int, PhotoFailure], tuple[str, ...]]:
    """Failures for photos of somebody else, by their number, and sentences."""
    people = split_identities(
        distance,
        turn=np.array([face.fit.turn for face in faces]),
        score=np.array([face.landmarks.score for face in faces]),
        keep=np.array([face.landmarks.source == "hand" for face in faces], bool),
    )
    names = [face.photo.name for face in faces]
    failures, sentences = {}, []
    for group in people.others:
        for k in group:
            failures[int(k)] = _outlier(names[k])
        if len(group) > SIMILAR * len(people.person):
            sentences.append(
                "The photos show more than one person: the face is made from "
                f"{len(people.person)} of them and not from "
                f"{', '.join(names[k] for k in group)}; put these into a folder of "
                "their own to get the other face."
            )
    if 1 < len(people.doubtful) == len(names):
        sentences.append(
            f"No two of the photos {', '.join(names)} seem to show one person; look at "
            "them, and ignore those of somebody else."
        )
    elif len(people.doubtful):
        which, them = ("it", "the photo"), ("them", "these photos")
        it, ignored = which if len(people.doubtful) == 1 else them
        sentences.append(
            f"Somebody else may be in {', '.join(names[k] for k in people.doubtful)}; "
            f"look at {it}, and ignore {ignored} if so."
        )
    return failures, tuple(sentences)


def _outlier(name: str) -> PhotoFailure:
    return PhotoFailure(
        name,
        "other_person",
        f"{name} shows somebody else than most photos, or a covered face; if it is "
        "to be used, switch the setting one_person off.",
    )
