#!/usr/bin/env python3
"""The paper's Algorithm 1 state by state, with the ingredients in your hands.

python examples/09_algorithm_step_by_step.py [PHOTOS [OUT]]
"""

import bsface
from _arguments import start
from bsface.landmarks.observations import observe_landmarks
from bsface.prepare import collect_photos
from bsface.solve.joint.samples import sample_grid
from bsface.solve.paper.algorithm1 import Limits, algorithm1, paper_steps
from bsface.solve.paper.methods import sample_photos
from bsface.solve.paper.shading import ShadingParameters


def main(photos, out, settings=None):
    """Run the loops by hand; stopping is ceasing to iterate."""
    settings = settings or bsface.Settings()
    found = collect_photos(photos, settings)
    template = bsface.load_template().resampled(settings.control_points)
    landmarks = observe_landmarks(found.photos, found.landmarks, template)
    uv = sample_grid(template, 40)

    def sample(surface, cameras):
        """The matrix M of section 2.2.1, and which samples are visible."""
        return sample_photos(found.photos, surface, cameras, uv)

    steps = paper_steps(
        landmarks,
        template.surface.shape,
        uv,
        sample,
        zeta=settings.zeta,
        shading=ShadingParameters(lam=settings.lam),
    )
    states = []
    for state in algorithm1(template.surface, uv, steps, Limits(outer=1, motion=6)):
        figures = ", ".join(f"{k} {v:.3g}" for k, v in state.figures.items())
        print(
            f"pass {state.outer}, {state.stage} {state.inner}: "
            f"moved {state.change_mm:.2f} mm ({figures})"
        )
        states.append(state)
    return states


if __name__ == "__main__":
    start(main, __doc__)
