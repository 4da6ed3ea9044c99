"""The face as it is estimated so far, drawn over the 3D views while a job runs.

It is a drawing only: no data-block is made or changed, so nothing has to be undone.
The main thread shows estimates and takes them off; Blender calls `Overlay.draw` when
it redraws a view.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..core._types import Array, Array32
from ..core.surface.bspline import BSplineSurface, grid_parameters, grid_triangles
from .view_areas import redraw

if TYPE_CHECKING:
    from collections.abc import Callable

# Lines of the drawn net, across and down, and how far they are above the surface.
LINES = (40, 50)
LIFT_MM = 0.5
SKIN = np.array([0.85, 0.62, 0.5], np.float32)
OPACITY = 0.8
NET_COLOUR = (0.1, 0.08, 0.07, 0.35)
# What faces away from the viewer's side is this bright, what faces it is 1.
DARKEST = 0.25


@dataclass(frozen=True, eq=False)
class Estimate:
    """What is drawn.

    Attributes
    ----------
    control_points : (M, N, 3) array
        As the core reported them.
    frame : Matrix
        From the core's axes and millimetres to the scene.
    scene : int
        Blender's own number (`session_uid`) of the scene that it belongs to.
    points : (p, 3) float32 array
        The grid in the core's axes, mm; index ``iu * LINES[1] + iv``.
    lifted : (p, 3) float32 array
        The same just above the surface, for lines that nothing of it hides.
    colours : (p, 4) float32 array
        Of the points, lit from the front.
    """

    control_points: Array
    frame: Matrix
    scene: int
    points: Array32
    lifted: Array32
    colours: Array32

    @classmethod
    def of(cls, control_points: Array, frame: Matrix, scene: int) -> Estimate:
        """Sample the surface; about a millisecond."""
        surface = BSplineSurface(control_points)
        uv = grid_parameters(*LINES)
        points, normals = surface.evaluate(*uv), surface.normals(*uv)
        lifted = (points + LIFT_MM * normals).astype(np.float32)
        light = np.clip(normals[:, 2], 0, 1)
        colours = np.empty((len(light), 4), np.float32)
        colours[:, :3] = SKIN * (DARKEST + (1 - DARKEST) * light[:, None])
        colours[:, 3] = OPACITY
        points = points.astype(np.float32)
        return cls(control_points, frame, scene, points, lifted, colours)


class Overlay:
    """The estimate over the 3D views; there is at most one.

    Attributes
    ----------
    estimate : Estimate or None
        What is drawn now.
    """

    def __init__(self) -> None:
        self.estimate: Estimate | None = None
        self._handler: object = None
        self._draw: Callable[[], None] | None = None

    @property
    def is_drawn(self) -> bool:
        """Whether Blender calls `draw`."""
        return self._handler is not None

    def show(
        self, context: bpy.types.Context, control_points: Array, frame: Matrix
    ) -> bool:
        """Draw a face from now on; False where nothing is new.

        Parameters
        ----------
        control_points : (M, N, 3) array
            Millimetres, the core's axes.
        frame : Matrix
            From there to the scene.
        """
        now, scene = self.estimate, context.scene.session_uid
        if (
            now is not None
            and now.control_points is control_points
            and (now.frame, now.scene) == (frame, scene)
        ):
            return False
        self.estimate, self._draw = Estimate.of(control_points, frame, scene), None
        if not self.is_drawn:
            self._handler = bpy.types.SpaceView3D.draw_handler_add(
                self.draw, (), "WINDOW", "POST_VIEW"
            )
        redraw(context, "WINDOW")
        return True

    def clear(self, context: bpy.types.Context) -> None:
        """Draw nothing; fine where nothing is drawn."""
        self.estimate = self._draw = None
        if self.is_drawn:
            bpy.types.SpaceView3D.draw_handler_remove(self._handler, "WINDOW")
            self._handler = None
            redraw(context, "WINDOW")

    def draw(self) -> None:
        """Draw into the view that Blender draws now."""
        context, estimate = bpy.context, self.estimate
        if (
            estimate is None
            or context.scene.session_uid != estimate.scene
            or not context.space_data.overlay.show_overlays
        ):
            return
        if self._draw is None:
            self._draw = _batches(estimate)
        self._draw()


def extent(control_points: Array, frame: Matrix) -> tuple[Vector, float]:
    """Middle of a face in the scene, and how far its points are from there at most."""
    matrix = np.array(frame)
    points = control_points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    low, high = points.min(0), points.max(0)
    return Vector((low + high) / 2), float(np.linalg.norm(high - low) / 2)


def _batches(estimate: Estimate) -> Callable[[], None]:
    """The drawing of an estimate; needs the context of a view."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    skin = gpu.shader.from_builtin("SMOOTH_COLOR")
    lines = gpu.shader.from_builtin("UNIFORM_COLOR")
    index = np.arange(np.prod(LINES), dtype=np.int32).reshape(LINES)
    across = np.stack([index[:-1], index[1:]], -1).reshape(-1, 2)
    down = np.stack([index[:, :-1], index[:, 1:]], -1).reshape(-1, 2)
    triangles = grid_triangles(*LINES).astype(np.int32)
    filled = batch_for_shader(
        skin,
        "TRIS",
        {"pos": estimate.points, "color": estimate.colours},
        indices=triangles,
    )
    net = batch_for_shader(
        lines,
        "LINES",
        {"pos": estimate.lifted},
        indices=np.concatenate([across, down]),
    )

    def draw() -> None:
        with gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
            # Into the half of the depth that is nearer than all objects: the net is
            # over an object in the same place, and hides its own far side.
            nearer = Matrix.Diagonal((1, 1, 0.5, 1))
            nearer[2][3] = -0.5
            gpu.matrix.load_projection_matrix(
                nearer @ gpu.matrix.get_projection_matrix()
            )
            gpu.matrix.multiply_matrix(estimate.frame)
            gpu.state.blend_set("ALPHA")
            gpu.state.depth_test_set("LESS_EQUAL")
            gpu.state.depth_mask_set(True)
            filled.draw(skin)
            gpu.state.depth_mask_set(False)
            lines.uniform_float("color", NET_COLOUR)
            net.draw(lines)
            gpu.state.depth_test_set("NONE")
            gpu.state.blend_set("NONE")

    return draw
