"""What the pages name exists: files, headings, functions, tests, commands, options."""

import ast
import importlib.util
import re
import sys
from functools import lru_cache
from pathlib import Path

import pytest
from bsface.cli import batch, export_face, info, models, reconstruct
from bsface.cli.arguments import parse_settings
from bsface.errors import FailureCode

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([ROOT / "README.md", *DOCS.glob("*.md")])
FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
PARSERS = {
    "": reconstruct.parser,
    "batch": batch.parser,
    "export": export_face.parser,
    "info": info.parser,
    "models": models.parser,
}

pages = pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)


def script(folder: str, name: str):
    """A script of the checkout as a module."""
    path = ROOT / folder / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"docs_{name}", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@lru_cache
def defined(path: Path) -> frozenset[str]:
    """Functions, classes and methods of a file."""
    names = set()
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        if isinstance(node, ast.ClassDef):
            names |= {
                f"{node.name}.{inner.name}"
                for inner in node.body
                if isinstance(inner, ast.FunctionDef)
            }
    return frozenset(names)


def anchors(page: Path) -> set[str]:
    """What the headings of a page are called in links."""
    heads = re.findall(r"^#+ (.*)$", FENCE.sub("", page.read_text("utf-8")), re.M)
    plain = (re.sub(r"[^\w\- ]", "", head.lower()) for head in heads)
    return {head.replace(" ", "-") for head in plain}


@pages
def test_links_lead_somewhere(page):
    text = FENCE.sub("", page.read_text("utf-8"))
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"https?:|mailto:", target):
            continue
        name, _, anchor = target.partition("#")
        path = page.parent / name if name else page
        if not path.exists() or (anchor and anchor not in anchors(path)):
            broken.append(target)
    assert not broken


@pages
def test_files_functions_and_tests_exist(page):
    text = page.read_text("utf-8")
    folders = "core|bsface_addon|tests|tools|benchmarks|examples|docs|requirements"
    missing = [
        name
        for name in re.findall(rf"`((?:{folders})/[\w/.]*)`", text)
        if not (ROOT / name).exists()
    ]
    missing += [
        f"{file}::{name}"
        for file, name in re.findall(r"`([\w/]+\.py)::([\w.]+)`", text)
        if not (ROOT / file).is_file() or name not in defined(ROOT / file)
    ]
    assert not missing


@pages
def test_commands_can_be_started(page):
    text = page.read_text("utf-8")
    command = r"(?:python3?|--python) ([\w./]+\.py)\b"
    missing = [n for n in re.findall(command, text) if not (ROOT / n).is_file()]
    verbs = script(".", "dev").VERBS
    missing += [v for v in re.findall(r"dev\.py (\w+)", text) if v not in verbs]
    modules = re.findall(r"python3? -m ([\w.]+)", text)
    missing += [m for m in modules if importlib.util.find_spec(m) is None]
    assert not missing


def calls_of_the_command_line():
    for page in PAGES:
        text = page.read_text("utf-8")
        for call in re.findall(r"^python -m bsface (.*)$", text, re.MULTILINE):
            yield page.name, call


def test_the_command_line_is_called_as_it_is():
    """Every call in the pages is understood by the parser that gets it."""
    calls = list(calls_of_the_command_line())
    assert len(calls) > 5
    for page, call in calls:
        words = call.split()
        verb = words[0] if words[0] in PARSERS else ""
        try:
            PARSERS[verb]().parse_args(words[1:] if verb else words)
        except SystemExit:
            pytest.fail(f"{page}: python -m bsface {call}")


def test_settings_page_is_that_of_the_dataclass():
    page = script("docs", "settings_page")
    now = (DOCS / "settings.md").read_text("utf-8")
    assert page.page(now) == now, "run: python docs/settings_page.py"


def test_settings_named_in_commands_exist():
    for _, call in calls_of_the_command_line():
        parse_settings(re.findall(r"--set (\S+)", call))


def test_every_failure_code_is_explained():
    """By the word that Blender's list shows for it."""
    text = (DOCS / "troubleshooting.md").read_text("utf-8")
    rows = [f"| {code.label} | `{code}` |" for code in FailureCode]
    assert not [row for row in rows if row not in text]


def test_python_blocks_compile():
    for page in PAGES:
        text = page.read_text("utf-8")
        for block in re.findall(r"^```python\n(.*?)^```", text, re.M | re.S):
            compile(block, page.name, "exec")
