"""From photos to the problem that the methods solve: read, detect, check, identify.

Each photo is read once; the faces in it are found, measured and judged, and the photo
is cut down to them before the next one is read.  Which of several faces is the person
is decided at the end, when all photos have been seen, and so is which photos show
somebody else.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ._types import Array32
from .errors import FailureCode, PhotoFailure, ReconstructionError
from .identity.identify import identify
from .images.folder import is_video
from .images.mask_file import given_masks
from .images.sources import (
    Photos,
    check_names,
    ignored_names,
    is_name_of,
    photo_sources,
)
from .kinds import SWITCH, expect
from .landmarks.candidates import CandidateReader
from .landmarks.face_models import ModelFiles
from .landmarks.face_selection import Candidate
from .landmarks.frame_selection import read_frames
from .landmarks.landmarks import Landmarks
from .landmarks.large_photos import few_large
from .landmarks.observations import observe_landmarks
from .problem import Constraint, PhotoCollection, Problem
from .progress import Progress, Step
from .settings import NET_LIMITS, Settings
from .surface.alignment import head_frame
from .surface.bspline import BSplineSurface
from .surface.edited import edited_template
from .surface.prior import shape_prior
from .surface.template import Template, load_template

#: What it takes as the template.
TemplateLike = Template | BSplineSurface | str | os.PathLike


@dataclass(frozen=True)
class Inputs:
    """What a caller may give besides photos and settings.

    Attributes
    ----------
    template : Template, BSplineSurface, path of a template file, or None
    landmarks : mapping of photo name to Landmarks
        Win over files and over the detector.
    ignore : sequence of str
        Names of photos that are not to be used.
    constraint : Constraint or None
        Control points that stay.
    recursive : bool
        Whether a folder's sub-folders are read too.
    models : ModelFiles or None
        Files of the face networks.
    masks : mapping of photo name to (h, w) float32 array
        What is skin of the face: 1 is, 0 is not, 0.5 stays as it is measured. Win over
        mask files.
    """

    template: TemplateLike | None = None
    landmarks: Mapping[str, Landmarks] = field(default_factory=dict)
    ignore: Sequence[str] = ()
    constraint: Constraint | None = None
    recursive: bool = False
    models: ModelFiles | None = None
    masks: Mapping[str, Array32] = field(default_factory=dict)

    def __post_init__(self) -> None:
        expect(SWITCH, "true or false", recursive=self.recursive)
        object.__setattr__(self, "ignore", ignored_names(self.ignore))
        object.__setattr__(self, "masks", given_masks(self.masks))
        if not isinstance(self.landmarks, Mapping):
            raise TypeError(
                "landmarks must map photo names to Landmarks, not "
                f"{type(self.landmarks).__name__}; the scheme is a setting: "
                "settings={'landmarks': '68'}."
            )
        if not isinstance(self.constraint, Constraint | None):
            raise TypeError(
                "constraint must be a Constraint, not "
                f"{type(self.constraint).__name__}."
            )
        for name, marks in self.landmarks.items():
            if not isinstance(marks, Landmarks):
                raise TypeError(
                    f"landmarks must map photo names to Landmarks; {name!r} has "
                    f"{type(marks).__name__}."
                )


def prepare(
    photos: Photos,
    settings: Settings,
    inputs: Inputs | None = None,
    progress: Progress | None = None,
) -> Problem:
    """Read the photos and put together what the methods need.

    Raises
    ------
    ReconstructionError
        See `collect_photos`; and when the template is no template.
    """
    inputs = inputs or Inputs()
    template = as_template(inputs.template, settings)
    settings = replace(settings, control_points=template.surface.shape)
    collection = collect_photos(
        photos, settings, replace(inputs, template=template), progress
    )
    given = inputs.template
    target = given if isinstance(given, BSplineSurface) else None
    return make_problem(collection, template, settings, inputs.constraint, target)


def make_problem(
    collection: PhotoCollection,
    template: Template,
    settings: Settings,
    constraint: Constraint | None = None,
    target: BSplineSurface | None = None,
) -> Problem:
    """The problem from photos whose landmarks are known.

    Parameters
    ----------
    collection : PhotoCollection
    template : Template
        With the net of the settings.
    settings : Settings
    constraint : Constraint, optional
    target : BSplineSurface, optional
        Where the constrained points belong, in the frame of results; by default where
        the template has them.
    """
    if not collection.photos:
        raise ReconstructionError("No photo can be used; see the reasons per photo.")
    if constraint is not None:
        shape = template.surface.shape
        if np.shape(constraint.points) != shape:
            raise ValueError(
                f"The constraint has {np.shape(constraint.points)} points, but the "
                f"net of the template has {shape}."
            )
        if target is None:
            move = head_frame(template.surface, template, settings.eye_distance_mm)
            target = template.surface.transformed(move.scale, move.R, move.t)
    prior = shape_prior(
        template,
        settings.modes,
        settings.expression_modes,
        settings.smooth_mm,
        settings.smooth_length,
    )
    landmarks = observe_landmarks(collection.photos, collection.landmarks, template)
    return Problem(collection, template, prior, landmarks, settings, constraint, target)


def as_template(given: TemplateLike | None, settings: Settings) -> Template:
    """The template that is meant, with the net of the settings.

    A bare surface (an edited result) keeps its own net, and the landmarks and modes of
    the bundled template.
    """
    if isinstance(given, BSplineSurface):
        low, high = NET_LIMITS
        if min(given.shape) < low or max(given.shape) > high:
            m, n = given.shape
            raise ReconstructionError(
                f"The surface that was given as the template has {m} x {n} control "
                f"points; give one of {low} x {low} to {high} x {high}."
            )
        try:
            return edited_template(given, load_template())
        except ValueError as error:
            raise ReconstructionError(str(error)) from error
    if isinstance(given, Template):
        return given.resampled(settings.control_points)
    if given is not None and not isinstance(given, str | os.PathLike):
        raise TypeError(
            "template must be a Template, a BSplineSurface or the path of a template "
            f"file, not {type(given).__name__}."
        )
    try:
        return load_template(given).resampled(settings.control_points)
    except ValueError as error:
        raise ReconstructionError(str(error)) from error


def collect_photos(
    photos: Photos,
    settings: Settings | None = None,
    inputs: Inputs | None = None,
    progress: Progress | None = None,
) -> PhotoCollection:
    """Read photos, find the person's face in each and its landmarks.

    Parameters
    ----------
    photos : folder, video, or sequence of paths or (H, W, 3) arrays
    settings : Settings, optional
        Used are ``landmarks``, ``detector``, ``one_person`` and ``control_points``.
    inputs : Inputs, optional
    progress : callable, optional
        Called with a `Step` before and after each photo; its ``overall`` is the
        fraction of this function. May raise `Cancelled`.

    Raises
    ------
    ReconstructionError
        If there are no photos, no model files, no photo can be used, or no photo has
        a name of ``ignore``.
    """
    settings, inputs = settings or Settings(), inputs or Inputs()
    template = as_template(inputs.template, settings)
    sources, hints = photo_sources(photos, inputs.recursive)
    known = [name for name, _ in sources]
    check_names(inputs.ignore, known, "leave out")
    hints += _of_no_photo("landmarks", inputs.landmarks, known)
    hints += _of_no_photo("masks", inputs.masks, known)
    reader = CandidateReader(
        template, settings, inputs.landmarks, inputs.models, inputs.masks
    )
    total = len(sources)
    outcome: list[tuple[Candidate, ...] | PhotoFailure] = []
    for done, (name, source) in enumerate(sources):

        def check_cancelled(done: int = done, name: str = name) -> None:
            _tell(progress, done, total, f"looking at {name}")

        check_cancelled()
        if name in inputs.ignore:
            outcome.append(PhotoFailure(name, "ignored", f"{name} is set aside."))
        elif isinstance(source, Path) and is_video(source):
            frames = read_frames(
                reader,
                source,
                name,
                ignore=inputs.ignore,
                check_cancelled=check_cancelled,
            )
            outcome += [faces for _, faces in frames]
        else:
            outcome.append(reader.read(source, name, check_cancelled))
        outcome = few_large(outcome)
    outcome = few_large(outcome, slack=0)

    def compared() -> None:
        _tell(progress, total, total, "comparing the faces")

    chosen, warnings = identify(
        outcome,
        one_person=settings.one_person,
        models=inputs.models,
        check_cancelled=compared,
    )
    used = [item for item in chosen if isinstance(item, Candidate)]
    failures = tuple(item for item in chosen if isinstance(item, PhotoFailure))
    _tell(progress, total, total, f"{len(used)} of {len(chosen)} photos can be used")
    if not used:
        raise ReconstructionError(_nothing_usable(failures), failures)
    return PhotoCollection(
        photos=tuple(item.photo for item in used),
        landmarks=tuple(item.landmarks for item in used),
        failures=failures,
        identity_warnings=(*warnings, *_drawings(used), *_misplaced(used)),
        hints=hints,
        hashes=reader.hashes,
        originals=reader.originals,
    )


def _tell(progress: Progress | None, done: int, total: int, message: str) -> None:
    if progress is not None:
        progress(Step("landmarks", done, total, done / total, message))


def _of_no_photo(
    what: str, given: Mapping[str, object], known: Sequence[str]
) -> tuple[str, ...]:
    """What was given for photos that are not there: all of it is refused, some told.

    A table of a whole collection may go with some of its photos; a misspelt name must
    not pass without a word.
    """
    surplus = [name for name in given if not is_name_of(name, known)]
    if surplus and len(surplus) == len(given):
        check_names(surplus, known, f"have the given {what}")
    if not surplus:
        return ()
    named = ", ".join(surplus[:5]) + (" ..." if len(surplus) > 5 else "")
    return (f"No photo has the name of these given {what}: {named}.",)


def _drawings(used: Sequence[Candidate]) -> tuple[str, ...]:
    names = [face.photo.name for face in used if face.drawn]
    if not names:
        return ()
    it = "it" if len(names) == 1 else "them"
    return (
        f"{', '.join(names)} may be drawn, painted or strongly retouched, so that its "
        f"shading is not the face's; look at {it}, and ignore {it} if so.",
    )


def _misplaced(used: Sequence[Candidate]) -> tuple[str, ...]:
    names = [face.photo.name for face in used if face.misplaced]
    if not names:
        return ()
    return (
        f"The landmark files of {', '.join(names)} mark another place than the face "
        "that is seen; look whether they belong to other photos.",
    )


def _nothing_usable(failures: tuple[PhotoFailure, ...]) -> str:
    total, count = len(failures), Counter(failure.code for failure in failures)
    if total == 1:
        return f"The photo cannot be used: {failures[0].reason}"
    reasons = ", ".join(
        f"{n} {FailureCode(code).label}" for code, n in count.most_common()
    )
    if set(count) == {"ignored"}:
        return f"All {total} photos are set aside; leave some of them in."
    # That photos were left out is no news to who left them out.
    first = min(failures, key=lambda failure: failure.code == "ignored")
    return (
        f"None of the {total} photos can be used ({reasons}). The first: {first.reason}"
    )
