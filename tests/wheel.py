"""Whether the installed package works by itself; run by `python3 dev.py test`.

    python tests/wheel.py REFERENCE.npy       write the reference
    python -I tests/wheel.py REFERENCE.npy    an installed wheel, compared with it

Commands run in a folder of their own, on four of the example photos. The control
points have to be those of the reference to a millionth of a millimetre, whatever the
versions of NumPy, SciPy and OpenCV.
"""

from __future__ import annotations

import importlib
import json
import os
import pkgutil
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import bsface
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
CHOSEN = ("000.jpg", "005.jpg", "011.jpg", "020.jpg")
SMALL = ("--set=control_points=16,16", "--set=iterations=2")
#: Versions of OpenCV differ in the last digits of a blur, which moves control points by
#: about 1e-9 mm.
TOLERANCE_MM = 1e-6


def run(folder: Path, *words: str, **variables: str) -> subprocess.CompletedProcess:
    """The command in a folder outside the checkout."""
    return subprocess.run(
        [sys.executable, *(["-I"] if sys.flags.isolated else []), "-m", "bsface"]
        + list(words),
        cwd=folder,
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
    )


def control_points(folder: Path) -> np.ndarray:
    """Those of a small reconstruction by the command line, (16, 16, 3)."""
    for name in CHOSEN:
        shutil.copy(ROOT / "examples" / "photos" / name, folder)
    done = run(
        folder, ".", "-o", "out/face.npz", "-o", "out/face.step", "--json", *SMALL
    )
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    assert facts["photos"] == {"all": 4, "used": 4}
    assert all((folder / name).stat().st_size > 1000 for name in facts["files"])
    return bsface.load(folder / "out" / "face.npz").surface.control_points


def check_commands(folder: Path) -> None:
    """Version and models, there and missing."""
    version = run(folder, "--version")
    assert version.stdout.startswith(f"bsface {bsface.__version__} "), version
    assert run(folder, "models").returncode == 0
    nowhere = {"XDG_CACHE_HOME": str(folder), "BSFACE_MODELS": ""}
    if not (Path(bsface.__file__).parent / "data" / "models").is_dir():
        assert run(folder, "models", **nowhere).returncode == 1
        failed = run(folder, ".", "-o", "a.npz", **nowhere)
        assert failed.returncode == 1, failed
        assert "`bsface models fetch`" in failed.stderr, failed.stderr


def main() -> int:
    """Run the checks; returns the exit code."""
    reference = Path(sys.argv[1])
    for module in pkgutil.walk_packages(bsface.__path__, "bsface."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    with tempfile.TemporaryDirectory(prefix="bsface-wheel-") as name:
        points = control_points(Path(name))
        check_commands(Path(name))
        print(run(Path(name), "--version").stdout.strip(), flush=True)
    if not reference.exists():
        np.save(reference, points)
        return 0
    place = Path(bsface.__file__).parent
    assert place.resolve() != ROOT / "core", f"{place} is the checkout"
    off = float(np.abs(points - np.load(reference)).max())
    print(f"control points within {off:.1e} mm of the reference", flush=True)
    assert off < TOLERANCE_MM, off
    return 0


if __name__ == "__main__":
    sys.exit(main())
