"""JSON text of dataclasses, arrays and plain values, and JSON inside ``.npz`` files."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Kind = TypeVar("Kind", dict, list)


def to_json(value: object, indent: int | None = None, *, ascii: bool = False) -> str:
    """JSON text of dataclasses, arrays and plain values; NaN becomes null.

    With ``ascii`` all other characters are written as JSON's escapes.
    """
    return json.dumps(plain(value), indent=indent, ensure_ascii=ascii, sort_keys=False)


def plain(value: Any) -> Any:
    """The value as dictionaries, lists, texts and numbers."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value


def from_json(arrays: dict[str, NDArray], name: str, kind: type[Kind]) -> Kind:
    """The JSON value in a text array.

    Raises
    ------
    ValueError
        With the array's name, as the middle of a sentence.
    """
    text = arrays[name]
    if text.shape != () or text.dtype.kind != "U":
        raise ValueError(f"{name} is not a text")
    try:
        value = json.loads(str(text))
    except (ValueError, RecursionError):
        raise ValueError(f"{name} is not valid JSON") from None
    if not isinstance(value, kind):
        raise ValueError(f"{name} is not a {kind.__name__}")
    return value
