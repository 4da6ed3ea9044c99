"""The extension's zip for this machine, built once a session, and its installation."""

import functools
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MODULE = "bl_ext.user_default.bsface"


@functools.cache
def built() -> Path:
    """The zip, made by the script that a developer runs; it validates it too."""
    # conftest.py removes this folder at the end.
    output = Path(os.environ["BLENDER_USER_RESOURCES"]) / "dist"
    script = ROOT / "tools" / "build_extension.py"
    run = subprocess.run(
        [sys.executable, str(script), "--here", "--output", str(output)],
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    (path,) = output.glob("*.zip")
    return path


@functools.cache
def installed() -> str:
    """Install the zip into this session's Blender, enabled; name of the module."""
    import bpy

    bpy.ops.extensions.package_install_files(
        filepath=str(built()), repo="user_default", enable_on_install=True
    )
    assert MODULE in bpy.context.preferences.addons
    return MODULE
