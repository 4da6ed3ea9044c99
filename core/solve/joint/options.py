"""Weights and schedule of the joint refinement."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

from ...camera.prior import SPREAD
from ...problem import Problem
from ...settings import Settings

#: Factors on the finest blur and on the iterations, and grid, of each level.
SCHEDULE = ((3.75, 3, 40), (1.9, 2, 50), (1.0, 1, 75))
#: The highest degree of the light at all levels but the last.
COARSE_DEGREE = 4
#: Largest step after which a coarse level is done, mm.
SETTLED_MM = 0.3


class Level(NamedTuple):
    """One resolution of the coarse-to-fine schedule.

    Attributes
    ----------
    blur_mm : float
        Standard deviation of the Gaussian that smooths the photos, at the head.
    iterations : int
        At most.
    grid : int
        Samples on a side of the parameter square, before the skin is cut out.
    degree : int
        Of the spherical harmonics of the light.
    settled_mm : float
        Largest step after which the level is done; 0 = it takes all its iterations.
    """

    blur_mm: float
    iterations: int
    grid: int
    degree: int
    settled_mm: float = 0.0


@dataclass(frozen=True)
class JointOptions:
    """Weights of the joint refinement.

    Attributes
    ----------
    levels : tuple of Level
        From coarse to fine.
    noise : float
        Cauchy scale of intensities in a usual photo, relative to its median.
    independence : float
        Share of the samples that count as independent.
    shadows : bool
        Whether the face casts shadow on itself.
    grazing : float
        Cosine of the viewing angle below which nothing is read.
    light_ridge : float
        Relative ridge of the lights when they are solved for a known face.
    light_damping : float
        Precision of the step of a light coefficient.
    landmark_mm, landmark_weight : float
        Standard deviation of a landmark in one photo, and weight of the whole term.
    distance_mm, distance_spread : float
        Mean distance of the cameras, and standard deviation of its logarithm.
    expression_spread : float
        Standard deviation of an expression coefficient about the motion estimate.
    camera_damping : float
        Precision of the step of the other parameters of a camera.
    max_step_mm : float
        Steps of the surface that are larger are shortened to this.
    tolerance : float
        Relative residual of the conjugate gradients. Against 1e-7 the mean errors of
        twelve faces change by at most 0.01 % of the eye distance: the next steps take
        up what is left.
    """

    levels: tuple[Level, ...]
    noise: float = 0.06
    independence: float = 0.3
    shadows: bool = True
    grazing: float = 0.25
    light_ridge: float = 1e-3
    light_damping: float = 1.0
    landmark_mm: float = 1.5
    landmark_weight: float = 0.05
    distance_mm: float = 1200.0
    distance_spread: float = SPREAD
    expression_spread: float = 0.7
    camera_damping: float = 1e-6
    max_step_mm: float = 4.0
    tolerance: float = 1e-4

    @classmethod
    def of(cls, problem: Problem) -> JointOptions:
        """The options that a problem means, at the size of its template."""
        options = cls.from_settings(problem.settings)
        return replace(options, distance_mm=problem.distance_mm)

    @classmethod
    def from_settings(cls, settings: Settings) -> JointOptions:
        """The schedule and the weights that a user's settings ask for."""
        last = len(SCHEDULE) - 1
        levels = tuple(
            Level(
                blur_mm=blur * settings.finest_blur_mm,
                iterations=times * settings.iterations,
                grid=grid,
                degree=min(
                    settings.light_degree,
                    settings.light_degree if k == last else COARSE_DEGREE,
                ),
                settled_mm=0.0 if k == last else SETTLED_MM,
            )
            for k, (blur, times, grid) in enumerate(SCHEDULE)
        )
        return cls(
            levels=levels,
            noise=settings.intensity_noise,
            independence=settings.independence,
            shadows=settings.shadows,
            distance_mm=settings.distance_mm,
        )
