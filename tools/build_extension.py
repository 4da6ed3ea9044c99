"""Build the Blender extension: one zip per platform and Python, into dist/.

A zip holds the add-on, the core, the wheels of SciPy, OpenCV and the readers of HEIC
and AVIF for one platform and one Python, the face models, and the pages of the
documentation for people at Blender, so that nothing is downloaded after the
installation. NumPy is Blender's own. Blender 4.5 to 5.0 have Python 3.11, 5.1 and later
3.13; a zip for both would break in some versions, hence two.

    python tools/build_extension.py                                 all of them
    python tools/build_extension.py --platform linux-x64 --python 3.11
    python tools/build_extension.py --here            the one for this machine

It runs in an environment with the package `bpy` (`python3 dev.py build` sees to
that), whose own `blender_ext.py` packs and validates. The downloaded wheels stay
in the user's cache.
"""

import argparse
import importlib.util
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

from bsface.errors import ReconstructionError  # pyright: ignore[reportMissingImports]
from bsface.landmarks.face_models import user_cache  # pyright: ignore[reportMissingImports]
from bsface.landmarks.model_fetching import fetch_models  # pyright: ignore[reportMissingImports]
from build_pages import write_pages

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("scipy", "opencv-python-headless", "pi-heif", "pillow")
# What goes into a zip; everything else of the checkout stays out.
CONTENT = ("__init__.py", "blender_manifest.toml", "LICENSE", "core", "bsface_addon")
# Platform in Blender's words -> wheel tags, the newest acceptable ones. A macOS
# tag admits older systems too; 13 is what OpenCV's wheels ask for, and it keeps
# SciPy's second macOS wheel (14 and later only) out.
PLATFORMS = {
    "linux-x64": (
        "manylinux_2_28_x86_64",
        "manylinux_2_27_x86_64",
        "manylinux2014_x86_64",
    ),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_13_0_arm64",),
    "macos-x64": ("macosx_13_0_x86_64",),
}
# Python -> first Blender version with it, first version without it.
PYTHONS = {"3.11": ("4.5.0", "5.1.0"), "3.13": ("5.1.0", None)}
# Blender 5 does not exist for Intel Macs.
NO_BLENDER = {("macos-x64", "3.13")}


class BuildError(Exception):
    """A zip could not be built; the message is one sentence with a remedy."""


@dataclass(frozen=True)
class Target:
    """One zip: a platform in Blender's words and a Python such as "3.11"."""

    platform: str
    python: str

    @property
    def tag(self) -> str:
        return f"{self.platform}-cp{self.python.replace('.', '')}"


def all_targets() -> tuple[Target, ...]:
    """Every pair of platform and Python for which a Blender exists."""
    pairs = [(p, v) for v in PYTHONS for p in PLATFORMS if (p, v) not in NO_BLENDER]
    return tuple(Target(*pair) for pair in pairs)


def target_here() -> Target:
    """Target of the machine and the Python that run this."""
    system = {"Linux": "linux", "Windows": "windows", "Darwin": "macos"}
    machine = {"x86_64": "x64", "AMD64": "x64", "arm64": "arm64", "aarch64": "arm64"}
    name = (
        system.get(platform.system(), "?") + "-" + machine.get(platform.machine(), "?")
    )
    target = Target(name, "{}.{}".format(*sys.version_info))
    if target not in all_targets():
        raise BuildError(f"there is no Blender for {target.tag}: name another target.")
    return target


def wheels(target: Target, cache: Path | None = None) -> tuple[Path, ...]:
    """Wheels of a target, downloaded where the cache has not got them."""
    folder = (user_cache() / "wheels" if cache is None else cache) / target.tag
    pins = _pins()
    patterns = [f"{name.replace('-', '_')}-{pins[name]}-*.whl" for name in PACKAGES]
    if not all(list(folder.glob(pattern)) for pattern in patterns):
        folder.mkdir(parents=True, exist_ok=True)
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps"]
        command += ["--disable-pip-version-check", "--only-binary=:all:"]
        command += ["--implementation=cp", f"--python-version={target.python}"]
        command += [f"--platform={tag}" for tag in PLATFORMS[target.platform]]
        # pip moves a finished file into place, so that an interrupted download
        # leaves no half wheel.
        command += ["--dest", str(folder)]
        command += [f"{name}=={pins[name]}" for name in PACKAGES]
        run = subprocess.run(command, capture_output=True, text=True)
        if run.returncode != 0:
            last = (run.stderr.strip().splitlines() or ["pip said nothing"])[-1]
            raise BuildError(
                f"the wheels for {target.tag} could not be downloaded ({last}); check "
                "the connection to the package index."
            )
    found = [list(folder.glob(pattern)) for pattern in patterns]
    if any(len(group) != 1 for group in found):
        raise BuildError(f"{folder} holds more than one wheel a package: empty it.")
    return tuple(group[0] for group in found)


def stage(target: Target, folder: Path) -> None:
    """Put everything that belongs into the zip of a target into a folder."""
    ignore = shutil.ignore_patterns("__pycache__", "*.pyc", ".*", "*.tflite", "*.dat")
    for name in CONTENT:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=ignore)
        else:
            shutil.copy(source, folder / name)
    models = folder / "core" / "data" / "models"
    models.mkdir(parents=True, exist_ok=True)
    for path in fetch_models().iterdir():
        shutil.copy(path, models / path.name)
    write_pages(folder / "manual")
    (folder / "wheels").mkdir()
    names = []
    for wheel in wheels(target):
        shutil.copy(wheel, folder / "wheels" / wheel.name)
        names.append(f"./wheels/{wheel.name}")
    manifest = folder / "blender_manifest.toml"
    text = manifest_for(target, manifest.read_text("utf-8"), names)
    manifest.write_text(text, "utf-8")


def manifest_for(target: Target, text: str, wheel_names: list[str]) -> str:
    """Manifest of the repository with the wheels, platform and versions added."""
    first, end = PYTHONS[target.python]
    lines = [f'blender_version_min = "{first}"']
    if end is not None:
        lines.append(f'blender_version_max = "{end}"')
    lines.append(f'platforms = ["{target.platform}"]')
    lines += ["wheels = [", *(f'    "{name}",' for name in wheel_names), "]"]
    text, count = re.subn(
        r"^blender_version_min = .*$", "\n".join(lines), text, flags=re.MULTILINE
    )
    assert count == 1, "blender_manifest.toml has one blender_version_min"
    assert tomllib.loads(text)["wheels"] == wheel_names
    return text


def build(target: Target, output: Path) -> Path:
    """Build and validate the zip of a target; returns its path in `output`."""
    version = tomllib.loads((ROOT / "blender_manifest.toml").read_text("utf-8"))[
        "version"
    ]
    path = output / f"bsface-{version}-{target.tag}.zip"
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="bsface-") as temporary:
        folder = Path(temporary) / "bsface"
        folder.mkdir()
        stage(target, folder)
        partial = path.with_suffix(".partial.zip")
        _blender_ext("build", "--source-dir", folder, "--output-filepath", partial)
        _blender_ext("validate", partial)
        partial.replace(path)
    return path


def _blender_ext(*arguments) -> None:
    script = _blender_ext_script()
    command = [sys.executable, str(script), *map(str, arguments)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300)
    if run.returncode != 0:
        raise BuildError(f"Blender's {arguments[0]} refuses:\n{run.stdout}{run.stderr}")


def _blender_ext_script() -> Path:
    """Blender's own packer inside the bpy wheel, found without importing bpy."""
    spec = importlib.util.find_spec("bpy")
    if spec is not None and spec.origin is not None:
        for parent in Path(spec.origin).parents[:5]:
            pattern = "scripts/addons_core/bl_pkg/cli/blender_ext.py"
            for found in (*parent.glob(pattern), *parent.glob(f"*/{pattern}")):
                return found
    raise BuildError("this Python has no bpy package: run `python3 dev.py build`.")


def _pins() -> dict[str, str]:
    text = (ROOT / "requirements" / "run.txt").read_text("utf-8")
    return dict(re.findall(r"^([\w-]+)==([\w.]+)", text, flags=re.MULTILINE))


def main() -> int:
    """Run the script; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--platform", choices=PLATFORMS)
    parser.add_argument("--python", choices=PYTHONS)
    parser.add_argument("--here", action="store_true", help="only for this machine")
    parser.add_argument("--output", type=Path, default=ROOT / "dist")
    arguments = parser.parse_args()
    try:
        chosen = [
            target
            for target in ([target_here()] if arguments.here else all_targets())
            if arguments.platform in (None, target.platform)
            and arguments.python in (None, target.python)
        ]
        if not chosen:
            raise BuildError("there is no Blender for that platform and Python.")
        for target in chosen:
            path = build(target, arguments.output)
            print(f"{path}  {path.stat().st_size / 1e6:.0f} MB", flush=True)
    except (BuildError, ReconstructionError) as error:
        print(f"build_extension: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
