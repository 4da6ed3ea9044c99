"""What the tests of quad meshes share: faces of the prior, edges and borders."""

from types import SimpleNamespace

import numpy as np
from bsface.surface.bspline import BSplineSurface
from bsface.surface.template import load_template


def person(seed=None):
    """A face of random identity modes; the template without a seed."""
    template = load_template()
    surface = template.surface
    if seed is not None:
        modes = template.identity_modes
        weight = np.random.default_rng(seed).normal(size=len(modes)).clip(-2, 2)
        surface = BSplineSurface(
            surface.control_points + np.tensordot(weight, modes, 1)
        )
    return SimpleNamespace(surface=surface, template=template)


def directed_edges(quads):
    return np.concatenate([quads[:, [k, (k + 1) % 4]] for k in range(4)])


def borders(quads):
    """Loops of edges with a quad on one side only."""
    edges = directed_edges(quads)
    size = quads.max() + 1
    one_way = ~np.isin(edges @ (size, 1), edges @ (1, size))
    following = dict(edges[one_way].tolist())
    loops = []
    while following:
        start, at = next(iter(following.items()))
        following.pop(start)
        count = 1
        while at != start:
            at = following.pop(at)
            count += 1
        loops.append(count)
    return sorted(loops)
