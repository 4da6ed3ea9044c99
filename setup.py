"""The one part of the package's description that pyproject.toml cannot compute."""

import re
from pathlib import Path

from setuptools import setup

HERE = Path(__file__).resolve().parent


def long_description() -> str:
    """README.md with links that also lead somewhere outside of a checkout."""
    project = (HERE / "pyproject.toml").read_text("utf-8")
    (home,) = re.findall(r'^Source = "(.*)"$', project, re.MULTILINE)

    def absolute(link: re.Match) -> str:
        view = "raw" if link["picture"] else "blob"
        words = f"{link['picture']}[{link['text']}]"
        return f"{words}({home}/{view}/main/{link['target']})"

    return re.sub(
        r"(?P<picture>!?)\[(?P<text>[^\]]*)\]\((?!https?:|#)(?P<target>[^)\s]+)\)",
        absolute,
        (HERE / "README.md").read_text("utf-8"),
    )


setup(
    long_description=long_description(),
    long_description_content_type="text/markdown",
)
