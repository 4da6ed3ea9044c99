"""The bundled template with a small net and few modes, for small systems."""

from dataclasses import replace

from bsface.surface.template import Template, load_template


def few_modes(shape: tuple[int, int], identity: int, expression: int) -> Template:
    """The template with the first identity and expression modes, on another net."""
    base = load_template()
    few = replace(
        base,
        identity_modes=base.identity_modes[:identity],
        expression_modes=base.expression_modes[:expression],
    )
    return few.resampled(shape)
