"""The house rules that a reader relies on: what core needs, which way imports go."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CORE = ROOT / "core"
ADDON = ROOT / "bsface_addon"

# A module may import from its own package and from those below. Everything may import
# the modules of the ground: what all packages use.
GROUND = {
    "_types",
    "_start",
    "errors",
    "files",
    "gram",
    "json_text",
    "kinds",
    "npz_arrays",
    "process_state",
    "progress",
    "settings",
    "threads",
    "versions",
}
PACKAGES = [
    "surface",
    "camera",
    "images",
    "landmarks",
    "photometry",
    "identity",
    "problem",
    "prepare",
    "solve",
    "result",
    "finish",
    "rig",
    "scale",
    "drawing",
    "texture",
    "compare",
    "formats",
    "report",
    "reconstruct",
    "track",
    "batch",
    "cli",
]
# The two methods by which a result writes and shows itself.
UPWARD = {("result", "formats.face_file"), ("result", "drawing.pictures")}
UPWARD |= {("result", "drawing.render")}
# May import everything: what a user starts with.
ENTRANCES = {"__init__", "__main__"}


def modules() -> dict[str, Path]:
    """Dotted name below core/ -> file; a package is named as its folder."""
    found = {}
    for path in sorted(CORE.rglob("*.py")):
        parts = list(path.relative_to(CORE).with_suffix("").parts)
        if len(parts) > 1 and parts[-1] == "__init__":
            parts.pop()
        found[".".join(parts)] = path
    return found


def imported(name: str, path: Path):
    """Dotted names below core/ that a module imports relatively."""
    package = name.split(".")
    if path.name != "__init__.py" or name == "__init__":
        package = package[:-1]
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if not isinstance(node, ast.ImportFrom) or node.level == 0:
            continue
        base = package[: len(package) - (node.level - 1)]
        if node.module:
            yield ".".join([*base, node.module])
        else:
            yield from (".".join([*base, alias.name]) for alias in node.names)


def absolute_imports(path: Path):
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module.split(".")[0]


def level(name: str) -> int:
    """0 for the ground, 1 for surface, ..."""
    first = name.split(".")[0]
    if first in GROUND:
        return 0
    assert first in PACKAGES, f"core/{first} has no place: name it in this test"
    return 1 + PACKAGES.index(first)


@pytest.mark.parametrize("name", [n for n in modules() if n not in ENTRANCES])
def test_imports_point_down(name):
    above = [
        other
        for other in imported(name, modules()[name])
        if (name, other) not in UPWARD
        and (other in ENTRANCES or level(other) > level(name))
    ]
    assert not above, f"core/{name} imports {above} from a package above its own"


@pytest.mark.parametrize("path", modules().values(), ids=modules().keys())
def test_core_imports_its_own_parts_relatively_and_never_blender(path):
    """core is `bsface` when installed and a subpackage in Blender's extension."""
    forbidden = {"bsface", "core", "bsface_addon", "bpy", "bmesh", "mathutils"}
    assert not forbidden & set(absolute_imports(path))


@pytest.mark.parametrize(
    "path", sorted(ADDON.rglob("*.py")), ids=lambda p: str(p.relative_to(ADDON))
)
def test_addon_imports_its_own_parts_relatively(path):
    assert not {"bsface", "core", "bsface_addon"} & set(absolute_imports(path))


@pytest.mark.parametrize("name", [n for n in modules() if n != "__main__"])
def test_library_does_not_print(name):
    tree = ast.parse(modules()[name].read_text("utf-8"))
    calls = [node.func for node in ast.walk(tree) if isinstance(node, ast.Call)]
    printed = [f.lineno for f in calls if isinstance(f, ast.Name) and f.id == "print"]
    assert not printed, f"core/{name} prints in lines {printed}; log instead"


def functions(path: Path):
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.FunctionDef):
            yield node


@pytest.mark.parametrize("path", modules().values(), ids=modules().keys())
def test_parameter_lists_are_short(path):
    """Six positional parameters at most; what is more has a name at the call."""
    long = []
    for node in functions(path):
        names = [a.arg for a in (*node.args.posonlyargs, *node.args.args)]
        if len([name for name in names if name not in ("self", "cls")]) > 6:
            long.append(node.name)
    assert not long


@pytest.mark.parametrize("path", modules().values(), ids=modules().keys())
def test_public_functions_return_no_long_tuples(path):
    """More than three values have names: a dataclass or a named tuple."""
    long = []
    for node in functions(path):
        found = node.returns
        if not isinstance(found, ast.Subscript) or node.name.startswith("_"):
            continue
        values = getattr(found.slice, "elts", ())
        if getattr(found.value, "id", "") == "tuple" and len(values) > 3:
            long.append(node.name)
    assert not long


def test_core_imports_without_blender_and_without_the_extras():
    program = """
import importlib, pkgutil, sys
blocked = {"bpy", "bmesh", "mathutils", "rhino3dm", "dask", "distributed",
           "matplotlib", "PIL", "pi_heif"}
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in blocked:
            raise ImportError(name + " is blocked")
sys.meta_path.insert(0, Blocker())
import bsface
names = [m.name for m in pkgutil.walk_packages(bsface.__path__, "bsface.")]
for name in names:
    importlib.import_module(name)
assert len(names) > 5, names
"""
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=300
    )
    assert run.returncode == 0, run.stderr


def test_every_package_of_core_is_installed():
    """pyproject.toml lists the packages by hand; one left out breaks an install."""
    import tomllib

    config = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    listed = set(config["tool"]["setuptools"]["packages"])
    present = {
        ".".join(["bsface", *path.parent.relative_to(CORE).parts])
        for path in CORE.rglob("__init__.py")
    }
    assert listed == present


def test_checkout_imports_without_blender():
    """The root package is lazy: reading it must not need bpy."""
    if not ROOT.name.isidentifier():
        pytest.skip(f"the checkout's folder {ROOT.name!r} is not a Python name")
    program = "import sys; import {0}; assert 'bpy' not in sys.modules"
    run = subprocess.run(
        [sys.executable, "-c", program.format(ROOT.name)],
        cwd=ROOT.parent,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert run.returncode == 0, run.stderr
