"""Landmark sets: what they are, and reading and writing them as files.

Two kinds of file are read from beside a photo, with the photo's name and the
ending changed:

``.pts``
    The 68 points of the iBUG order in the format of its annotations: a line
    ``version: 1``, a line ``n_points: 68``, then ``{``, one ``x y`` a line,
    ``}``. In this format the centre of the first pixel is (1, 1), so 1 is
    subtracted on reading and added on writing.
``.json``
    ``{"scheme": "468" | "68" | "40", "points": [[x, y], ...],
    "weights": [...], "image_size": [width, height]}``; the last two are
    optional. Pixel centres at integers, the first is (0, 0).

Both speak of the photo as it is seen, that is after its EXIF turn.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..files import file_beside, write_text
from ..kinds import expect, expect_paths, expect_whole

SCHEME_SIZES = {"468": 468, "68": 68, "40": 40}
LANDMARK_ENDINGS = (".pts", ".json")
MAX_FILE_BYTES = 1_000_000
MAX_WEIGHT = 100.0


class LandmarkFileError(ValueError):
    """A landmark file is wrong; ``str()`` is one sentence with the file's name."""


class NotLandmarksError(LandmarkFileError):
    """A ``.json`` file that does not even claim to hold landmarks."""


@dataclass(frozen=True, eq=False)
class Landmarks:
    """The landmarks of the face in one photo.

    Parameters
    ----------
    photo : str
        Name of the photo.
    scheme : str
        ``"468"``, ``"68"`` or ``"40"``: which points of the template these are.
    points : (f, 2) array
        Pixels of the turned original, pixel centres at integers.
    weight : (f,) array
        0 = unknown, 1 = as good as the detector gets, up to `MAX_WEIGHT` for points
        that were placed by hand.
    source : str
        ``"detected"``, ``"file"`` or ``"hand"``.
    score : float
        The network's probability that this is a face; 1 for files.
    faces : int
        Number of faces seen in the photo.
    note : str
        For the report, such as which of several faces was chosen.
    """

    photo: str
    scheme: str
    points: np.ndarray
    weight: np.ndarray
    source: str = "detected"
    score: float = 1.0
    faces: int = 1
    note: str = ""

    def __post_init__(self) -> None:
        size = SCHEME_SIZES.get(self.scheme)
        if size is None:
            raise ValueError(
                f"unknown landmark scheme {self.scheme!r}; "
                f"known are {', '.join(SCHEME_SIZES)}"
            )
        for name in ("points", "weight"):
            value = np.asarray(getattr(self, name))
            if value.dtype.kind not in "fiu":
                raise ValueError(f"landmarks are real numbers, not {value.dtype}")
            object.__setattr__(self, name, value.astype(float, copy=False))
        if np.shape(self.points) != (size, 2) or np.shape(self.weight) != (size,):
            raise ValueError(
                f"the scheme {self.scheme} wants {size} points (x, y) and weights, "
                f"not {np.shape(self.points)} and {np.shape(self.weight)}"
            )

    def subset(self, scheme: str, indices: np.ndarray) -> Landmarks:
        """The points of a smaller scheme, given where they stand in this one.

        Raises
        ------
        ValueError
            When the indices are no whole numbers of points that are there.
        """
        indices = np.asarray(indices)
        if indices.ndim != 1 or indices.dtype.kind not in "iu":
            raise ValueError("indices must be a list of whole numbers.")
        if ((indices < 0) | (indices >= len(self.points))).any():
            raise ValueError(f"indices must be from 0 to {len(self.points) - 1}.")
        return replace(
            self,
            scheme=scheme,
            points=self.points[indices],
            weight=self.weight[indices],
        )


def landmark_file_beside(photo: str | os.PathLike) -> Path | None:
    """The landmark file of a photo: same folder, same name, ``.pts`` or ``.json``.

    The ending may be in capitals.
    """
    found = (file_beside(photo, ending) for ending in LANDMARK_ENDINGS)
    return next(filter(None, found), None)


def read_landmarks(
    path: str | os.PathLike,
    photo: str | None = None,
    size: tuple[int, int] | None = None,
) -> Landmarks:
    """Landmarks from a ``.pts`` or ``.json`` file.

    Parameters
    ----------
    path : path
    photo : str, optional
        Name of the photo; by default the file's own name.
    size : (int, int), optional
        Width and height of the photo; a ``.json`` file that was made for
        another size is then refused.

    Raises
    ------
    LandmarkFileError
        If the file cannot be read, or its content is not landmarks;
        `NotLandmarksError` for ``.json`` files of another kind.
    """
    expect_paths(path=path)
    expect(str | None, "the name of a photo", photo=photo)
    size = _picture_size(size, "size")
    path = Path(path)
    try:
        if path.exists() and not path.is_file():
            raise _bad(path, "is no regular file")  # to open a pipe waits for ever
        if path.stat().st_size > MAX_FILE_BYTES:
            raise _bad(path, "is too large for a landmark file")
        text = path.read_bytes().decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "it is not text"
        raise _bad(path, f"cannot be read ({why[:1].lower() + why[1:]})") from None
    if path.suffix.lower() == ".json":
        scheme, points, weight = _parse_json(path, text, size)
    else:
        scheme, points, weight = _parse_pts(path, text)
    return Landmarks(photo or path.name, scheme, points, weight, source="file")


def write_landmarks(
    path: str | os.PathLike,
    landmarks: Landmarks,
    image_size: tuple[int, int] | None = None,
) -> None:
    """Write a ``.pts`` (scheme 68 only, without weights) or ``.json`` file.

    The file appears whole or not at all.

    Raises
    ------
    ValueError
        The file's ending, or one that cannot hold these landmarks; `LandmarkFileError`
        for what `read_landmarks` would refuse.
    ReconstructionError
        The file cannot be written.
    """
    expect_paths(path=path)
    expect(Landmarks, "Landmarks", landmarks=landmarks)
    image_size = _picture_size(image_size, "image_size")
    path = Path(path)
    fault = _fault_of_points(landmarks.points) or _fault_of_weights(landmarks.weight)
    if fault:
        raise LandmarkFileError(
            f"{path.name} cannot be written: the set {fault}; correct the landmarks."
        )
    if path.suffix.lower() == ".json":
        record = {
            "scheme": landmarks.scheme,
            "points": landmarks.points.tolist(),
            "weights": landmarks.weight.tolist(),
        }
        if image_size is not None:
            record["image_size"] = list(image_size)
        text = json.dumps(record)
    elif path.suffix.lower() == ".pts":
        if landmarks.scheme != "68":
            raise ValueError(
                f".pts files hold the scheme 68, not {landmarks.scheme}; "
                "write a .json file."
            )
        rows = "\n".join(f"{x!r} {y!r}" for x, y in (landmarks.points + 1).tolist())
        text = f"version: 1\nn_points: 68\n{{\n{rows}\n}}\n"
    else:
        raise ValueError(f"{path.name}: landmark files end in .pts or .json.")
    write_text(path, text)


def _picture_size(given: Sequence[int] | None, name: str) -> tuple[int, int] | None:
    """Width and height as they are compared and stored."""
    if given is None:
        return None
    if not isinstance(given, Sequence | np.ndarray) or len(given) != 2:
        raise TypeError(f"{name} must be the width and height of a picture.")
    width, height = given
    expect_whole(1, 1_000_000, width=width, height=height)
    return int(width), int(height)


def _bad(path: Path, what: str) -> LandmarkFileError:
    return LandmarkFileError(f"{path.name} {what}; correct or remove it.")


def _parse_pts(path: Path, text: str) -> tuple[str, np.ndarray, np.ndarray]:
    before, brace, rest = text.partition("{")
    body, end, _ = rest.partition("}")
    if not brace or not end:
        raise _bad(path, "is not a .pts file (no list in braces)")
    claimed = None
    for line in before.splitlines():
        key, _, value = line.partition(":")
        if key.strip().lower() == "n_points":
            try:
                claimed = int(value)
            except ValueError:
                raise _bad(path, f"says n_points: {value.strip()[:20]!r}") from None
    rows = [line.replace(",", " ").split() for line in body.splitlines()]
    rows = [row for row in rows if row]
    try:
        values = [[float(x), float(y)] for x, y in rows]
    except ValueError:
        raise _bad(path, "has a line that is not two numbers") from None
    if claimed is not None and claimed != len(values):
        raise _bad(path, f"announces {claimed} points and holds {len(values)}")
    if len(values) != 68:
        raise _bad(path, f"holds {len(values)} points, a .pts file must hold 68")
    points = np.array(values) - 1.0
    return "68", _checked(path, points), np.ones(68)


def _parse_json(
    path: Path, text: str, size: tuple[int, int] | None
) -> tuple[str, np.ndarray, np.ndarray]:
    try:
        record = json.loads(text)
    except (ValueError, RecursionError):
        raise _bad(path, "is not valid JSON") from None
    if not isinstance(record, dict) or not {"points", "scheme"} & record.keys():
        # Programs lay other .json files beside photos.
        raise NotLandmarksError(f"{path.name} is not a landmark file.")
    if "points" not in record:
        raise _bad(path, 'holds no "points"')
    scheme = record.get("scheme")
    if isinstance(scheme, int):
        scheme = str(scheme)
    if not isinstance(scheme, str) or scheme not in SCHEME_SIZES:
        raise _bad(
            path, f'must name one of the schemes {", ".join(SCHEME_SIZES)} as "scheme"'
        )
    count = SCHEME_SIZES[scheme]
    points = _numbers(path, record["points"], "points")
    if points.ndim != 2 or points.shape[1] != 2:
        raise _bad(path, 'must list "points" as pairs [x, y]')
    if len(points) != count:
        raise _bad(
            path, f"holds {len(points)} points, the scheme {scheme} wants {count}"
        )
    weight = np.ones(count)
    if record.get("weights") is not None:
        weight = _numbers(path, record["weights"], "weights")
        if weight.shape != (count,):
            raise _bad(path, f"must hold {count} weights or none")
        fault = _fault_of_weights(weight)
        if fault:
            raise _bad(path, fault)
    made_for = record.get("image_size")
    if size is not None and made_for is not None and list(size) != made_for:
        raise _bad(
            path,
            f"was made for a picture of {str(made_for)[:40]} pixels, "
            f"this one has {size[0]} x {size[1]}",
        )
    return scheme, _checked(path, points), weight


def _numbers(path: Path, value: object, what: str) -> np.ndarray:
    try:
        array = np.array(value)
        if array.dtype == bool or not np.issubdtype(array.dtype, np.number):
            raise ValueError
        return array.astype(float)
    except (ValueError, TypeError, OverflowError):
        raise _bad(path, f'holds something else than numbers in "{what}"') from None


def _checked(path: Path, points: np.ndarray) -> np.ndarray:
    fault = _fault_of_points(points)
    if fault:
        raise _bad(path, fault)
    return points


def _fault_of_points(points: np.ndarray) -> str:
    """What is wrong with points, as the middle of a sentence; "" if nothing."""
    if not np.isfinite(points).all():
        return "holds a coordinate that is not a finite number"
    if np.abs(points).max() > 1e6:
        return "holds coordinates that no picture has"
    return ""


def _fault_of_weights(weight: np.ndarray) -> str:
    """What is wrong with weights; see `_fault_of_points`."""
    fits = np.isfinite(weight) & (weight >= 0) & (weight <= MAX_WEIGHT)
    if not fits.all():
        return f"holds weights outside [0, {MAX_WEIGHT:g}]"
    return "" if weight.any() else "gives every point the weight 0"
