"""Fixtures that the tests of the joint method share."""

import pytest
from bsface.surface.prior import shape_prior
from few_modes import few_modes
from joint_waves import PHOTOS, SHAPE, Residual, cameras, first_step, plane, wave


@pytest.fixture(scope="module")
def template():
    return few_modes(SHAPE, identity=3, expression=1)


@pytest.fixture(scope="module")
def prior(template):
    return shape_prior(template, 1.0, 0.5, 1.0, 0.2)


@pytest.fixture(scope="module", params=["plane", "template", "expressions"])
def case(request, template, prior):
    """A plane, the template, or the template with another expression in each photo."""
    surface = plane() if request.param == "plane" else template.surface
    own = 1.5 if request.param == "expressions" else 0.0
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    one = first_step(template, prior, surface, views, pictures, own)
    return request.param, one, Residual(one, surface, pictures), surface
