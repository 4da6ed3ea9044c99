"""``python -m bsface PHOTOS -o face.npz``: the job without Blender.

    python -m bsface PHOTOS -o OUT [--report PAGE.html] [--set NAME=VALUE ...]
    python -m bsface batch PEOPLE OUT [--workers 2] [--write FILE ...]
    python -m bsface export FACE.npz -o OUT [--tolerance MM]
    python -m bsface info FACE.npz [--json]
    python -m bsface models [fetch]

The ending of ``OUT`` is the format: ``.npz``, ``.step``, ``.igs``, ``.3dm``, ``.obj``,
``.nurbs.obj``, ``.ply``, ``.glb``, ``.stl`` or ``.3mf``; give ``-o`` more than once for
several.
Exit codes: 0 done, 1 the job failed, 2 the call is wrong, 130 interrupted.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence

from .cli import batch, export_face, info, models
from .cli import reconstruct as reconstruct_photos
from .cli.stopping import stoppable
from .cli.terminal import say
from .reconstruct import reconstruct
from .result import Reconstruction

COMMANDS: dict[str, Callable[[Sequence[str]], int]] = {
    "batch": batch.main,
    "export": export_face.main,
    "info": info.main,
    "models": models.main,
}


def main(
    argv: Sequence[str] | None = None,
    run: Callable[..., Reconstruction] = reconstruct,
) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        The words; by default those of the process.
    run : callable, optional
        What makes the face, with the arguments of `reconstruct`.

    Returns
    -------
    int
        The exit code.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    try:
        with stoppable():
            try:
                if words and words[0] in COMMANDS:
                    return COMMANDS[words[0]](words[1:])
                return reconstruct_photos.main(words, run)
            except KeyboardInterrupt:
                say("interrupted")
                return 130
    except FileNotFoundError:
        if _folder_is_there():
            raise
        say("The present folder was removed; change to another one (cd).")
        return 1


def _folder_is_there() -> bool:
    """Whether the folder that the process stands in still has a name."""
    try:
        return bool(os.getcwd())
    except FileNotFoundError:
        return False


if __name__ == "__main__":
    sys.exit(main())
