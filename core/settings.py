"""Settings of a reconstruction: one default for each symbol that is a parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

METHODS = ("joint", "imls", "paper", "motion")
SCHEMES = ("468", "68", "40")

NUMBER = (int, float, np.integer, np.floating)
CHOICES: dict[str, tuple] = {
    "method": METHODS,
    "landmarks": SCHEMES,
    "light_degree": (1, 2, 3, 4, 5, 6),
}
SWITCHES = ("detector", "one_person", "perspective", "expressions", "shadows")
WHOLE = ("light_degree", "iterations", "outer_passes")

#: Control points along each side of the net.
NET_LIMITS = (8, 120)
# Inclusive limits of the numeric settings, for validation and for user interfaces.
LIMITS: dict[str, tuple[float, float]] = {
    "eye_distance_mm": (1.0, 1000.0),
    "distance_mm": (200.0, 100_000.0),
    "landmark_offset_mm": (0.1, 20.0),
    "landmark_noise_mm": (0.1, 20.0),
    "modes": (0.0, 5.0),
    "expression_modes": (0.0, 5.0),
    "smooth_mm": (0.05, 10.0),
    "smooth_length": (0.02, 1.0),
    "intensity_noise": (0.005, 1.0),
    "independence": (0.001, 1.0),
    "finest_blur_mm": (0.5, 5.0),
    "iterations": (1, 50),
    "outer_passes": (1, 20),
    "lam": (0.0, 1e6),
    "zeta": (1e-9, 1e6),
}


@dataclass(frozen=True)
class Settings:
    """What a reconstruction may be asked for; each default is measured in the docs.

    Parameters
    ----------
    method : str
        "joint": landmarks, then shading and motion in one system (default); "imls":
        Algorithm 1 with robust ingredients; "paper": Algorithm 1 as printed; "motion":
        landmarks only.
    control_points : (int, int)
        Size M x N of the net, each from 8 to 120.
    eye_distance_mm : float
        Distance between the eye centres of the result; photos have no scale.
    landmarks : str
        Scheme used: "468", "68" or "40" points.
    detector : bool
        Find landmarks in photos that have no landmark file.
    one_person : bool
        Leave out photos that surely show somebody else than most do; off: use them all.
    perspective : bool
        False: scaled orthography, the camera of section 2.3.1.
    distance_mm : float
        Typical distance between camera and head, for a face with 62 mm between the
        eyes and in proportion for others; each photo finds its own about it. A photo
        whose file names its focal length does not need it.
    expressions : bool
        Let every photo have its own expression; the result is the calmest one.
    landmark_offset_mm : float
        How far a landmark may lie from its place on the template, standard deviation.
    landmark_noise_mm : float
        Standard deviation of a landmark in one photo, besides the template's own.
    modes : float
        Factor on the standard deviations of the modes of identity, 0 = none.
    expression_modes : float
        Factor on the standard deviations of the modes of an expression that all photos
        share, 0 = none.
    smooth_mm : float
        Standard deviation of the displacement that the modes cannot express, mm.
    smooth_length : float
        Its correlation length, in parts of the parameter square.
    light_degree : int
        Of the spherical harmonics of each photo's light: 1 is the paper's model (four
        numbers), 2 suffices without shadows, 6 (49 numbers) follows hard light; at
        most 4 at the two coarse levels.
    shadows : bool
        Account for the shadows that the face casts on itself.
    intensity_noise : float
        Cauchy scale of intensities in a usual photo, relative to its median; photos
        with larger residuals have more.
    independence : float
        Share of the intensity samples that count as independent observations.
    finest_blur_mm : float
        Smoothing of the photos at the last level of the joint refinement.
    iterations : int
        Gauss-Newton steps at the last of its three levels; the coarse ones take up to
        two and three times as many until they settle.
    outer_passes : int
        Passes of Algorithm 1: of "paper", and times 2, 2 and 3 at the levels of "imls".
    lam : float
        ``lambda`` of Eq. 6 and 7, for "paper".
    zeta : float
        ``zeta`` of Eq. 8, for "paper".
    """

    method: str = "joint"
    control_points: tuple[int, int] = (42, 44)
    eye_distance_mm: float = 62.0
    landmarks: str = "468"
    detector: bool = True
    one_person: bool = True
    perspective: bool = True
    # 1.2 m in the template's frame, where it was measured.
    distance_mm: float = 1289.0
    expressions: bool = True
    landmark_offset_mm: float = 3.0
    landmark_noise_mm: float = 3.0
    modes: float = 1.0
    expression_modes: float = 0.7
    smooth_mm: float = 1.5
    smooth_length: float = 0.12
    light_degree: int = 6
    shadows: bool = True
    intensity_noise: float = 0.06
    independence: float = 0.3
    finest_blur_mm: float = 0.8
    iterations: int = 5
    outer_passes: int = 3
    lam: float = 10.0
    zeta: float = 1e-3

    def __post_init__(self) -> None:
        set_ = lambda name, value: object.__setattr__(self, name, value)  # noqa: E731
        set_("control_points", _net(self.control_points))
        if isinstance(self.landmarks, int) and abs(self.landmarks) < 1000:
            set_("landmarks", str(self.landmarks))
        for name, allowed in CHOICES.items():
            value = getattr(self, name)
            if not isinstance(value, str | int | np.integer | float) or (
                isinstance(value, bool) or value not in allowed
            ):
                raise ValueError(
                    f"{name} must be one of {', '.join(map(str, allowed))}, got "
                    f"{_short(value)}."
                )
        for name in SWITCHES:
            value = getattr(self, name)
            if not isinstance(value, (bool, np.bool_)):
                raise ValueError(f"{name} must be true or false, got {_short(value)}.")
            set_(name, bool(value))
        for name, (low, high) in LIMITS.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, NUMBER):
                raise ValueError(f"{name} must be a number, got {_short(value)}.")
            if not low <= value <= high:
                raise ValueError(
                    f"{name} must lie between {low:g} and {high:g}, got "
                    f"{_short(value)}."
                )
            set_(name, float(value))
        for name in WHOLE:
            value = getattr(self, name)
            if value != int(value):
                raise ValueError(f"{name} must be a whole number, got {value}.")
            set_(name, int(value))

    def distance_from(self, eye_distance: float) -> float:
        """Typical distance of the cameras from a face of this eye distance, mm."""
        return self.distance_mm * eye_distance / Settings.eye_distance_mm

    def to_dict(self) -> dict[str, Any]:
        """Plain values, ready for JSON."""
        return {**asdict(self), "control_points": list(self.control_points)}

    @classmethod
    def of(
        cls,
        given: Settings | Mapping[str, Any] | None,
        changes: Mapping[str, Any] | None = None,
    ) -> Settings:
        """Settings from what a caller may give, with single ones changed."""
        if isinstance(given, Settings):
            given = given.to_dict()
        if given is not None and not isinstance(given, Mapping):
            raise TypeError(
                f"settings must be Settings or a mapping, not {type(given).__name__}."
            )
        return cls.from_dict({**(given or {}), **(changes or {})})

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Settings:
        """Settings from plain values; unknown names are refused by name."""
        if not isinstance(values, Mapping):
            raise ValueError(f"Settings are names with values, got {_short(values)}.")
        known = {f.name for f in fields(cls)}
        unknown = sorted(_printable(str(name)) for name in set(values) - known)
        if unknown:
            raise ValueError(
                f"There is no setting {', '.join(unknown)}; the settings are "
                f"{', '.join(sorted(known))}."
            )
        return cls(**values)


def _net(value: Any) -> tuple[int, int]:
    """Size of the control net, checked."""
    numbers = list(value) if isinstance(value, (tuple, list, np.ndarray)) else []
    low, high = NET_LIMITS
    fits = len(numbers) == 2 and all(
        isinstance(x, NUMBER)
        and not isinstance(x, bool)
        and low <= x <= high
        and x % 1 == 0
        for x in numbers
    )
    if not fits:
        raise ValueError(
            f"control_points must be two whole numbers from {low} to {high}, got "
            f"{_short(value)}."
        )
    return int(numbers[0]), int(numbers[1])


def _printable(text: str) -> str:
    """The text on one short line, in characters that every terminal can be sent."""
    text = text.encode("utf-8", "backslashreplace").decode("utf-8")
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."


def _short(value: Any) -> str:
    """The value as the end of a sentence, whatever it is."""
    try:
        text = f"{value:g}" if isinstance(value, float) else repr(value)
    except ValueError:  # whole numbers of thousands of digits
        text = "a huge number"
    return _printable(text)
