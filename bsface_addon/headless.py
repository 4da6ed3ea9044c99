"""The add-on without a window: a script, and the command ``blender --command bsface``.

Four ways to the same `main`::

    blender --background --python bsface_addon/headless.py -- PHOTOS OUT.blend
    python bsface_addon/headless.py -- PHOTOS OUT.blend       (Python with bpy)
    blender --command bsface PHOTOS -o OUT.blend              (installed extension)
    blender --command bsface info OUT.blend

Exit codes: 0 done, 1 the job failed (one sentence on stderr says why), 2 wrong
usage, 130 interrupted.  No option begins with ``--c``: Blender's Cycles add-on reads
the same arguments and stops at those.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from pathlib import Path

FAILED, INTERRUPTED = 1, 130
COMMAND = "bsface"


def main(given):
    """Run one command.

    Parameters
    ----------
    given : list of str
        Without the program's name; a missing verb is ``reconstruct``.

    Returns
    -------
    int
        The exit code.
    """
    from ..core.cli.stopping import stoppable
    from ..core.errors import ReconstructionError
    from . import arguments
    from .verbs import VERBS

    given = list(given)
    if not given or given[0] not in (*VERBS, "-h", "--help"):
        given.insert(0, "reconstruct")
    try:
        options = arguments.parser().parse_args(given)
    except SystemExit as error:
        return int(error.code or 0)
    with stoppable():
        try:
            facts = VERBS[options.verb](options)
        except ReconstructionError as error:
            _say_failure(options, str(error))
            return FAILED
        except ImportError as error:
            from . import messages

            _say_failure(options, messages.MISSING.format(missing=error.name or error))
            return FAILED
        except Exception as error:
            from ..core.errors import out_of_memory
            from . import messages

            if not out_of_memory(error):
                raise
            _say_failure(options, messages.NO_MEMORY + ".")
            return FAILED
        except KeyboardInterrupt:
            print(f"{COMMAND}: interrupted", file=sys.stderr, flush=True)
            return INTERRUPTED
    if options.json:
        from ..core.json_text import to_json

        print(to_json({"ok": True, **facts}), flush=True)
    return 0


def _say_failure(options, sentence):
    if options.json:
        from ..core.report.facts import failure_facts

        print(json.dumps(failure_facts(sentence), ensure_ascii=False))
    print(f"{COMMAND}: {sentence}", file=sys.stderr, flush=True)


_handle = None


def register():
    """Make ``blender --command bsface`` known."""
    global _handle
    import bpy

    _handle = bpy.utils.register_cli_command(COMMAND, main)


def unregister():
    global _handle
    import bpy

    if _handle is not None:
        bpy.utils.unregister_cli_command(_handle)
        _handle = None


def _as_script():
    """Run from this file's path: load the extension's folder as a package."""
    import importlib.util

    root = Path(__file__).resolve().parents[1]
    spec = importlib.util.spec_from_file_location(
        "bsface_script", root / "__init__.py", submodule_search_locations=[str(root)]
    )
    sys.modules["bsface_script"] = importlib.util.module_from_spec(spec)
    module = importlib.import_module("bsface_script.bsface_addon.headless")
    import bpy

    if "--" in sys.argv:
        given = sys.argv[sys.argv.index("--") + 1 :]
    else:
        # Inside Blender all arguments before "--" are Blender's own.
        given = [] if bpy.app.binary_path else sys.argv[1:]
    try:
        code = module.main(given)
    except Exception:
        # A fault of ours: the trace is for the report.
        traceback.print_exc()
        code = FAILED
    sys.stdout.flush()
    sys.stderr.flush()
    if not bpy.app.binary_path:
        # Python with the module bpy, which has hung at the interpreter's end.
        os._exit(code)
    if code:
        sys.exit(code)


if __name__ == "__main__":
    _as_script()
