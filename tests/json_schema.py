"""The part of JSON Schema (draft 2020-12) that docs/result.schema.json uses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

RESULT_SCHEMA = json.loads(
    (Path(__file__).resolve().parents[1] / "docs/result.schema.json").read_text("utf-8")
)
_KINDS = {
    "object": dict,
    "array": list,
    "string": str,
    "integer": int,
    "number": (int, float),
    "boolean": bool,
    "null": type(None),
}
_KNOWN = {
    "$schema",
    "$id",
    "$defs",
    "$ref",
    "title",
    "description",
    "type",
    "const",
    "enum",
    "properties",
    "required",
    "additionalProperties",
    "items",
    "minItems",
    "maxItems",
    "minimum",
    "oneOf",
}


def problems(value: Any, schema: dict, root: dict | None = None, at: str = "$"):
    """What is wrong with a value, as a list of texts; empty if it is valid."""
    root = schema if root is None else root
    unknown = set(schema) - _KNOWN
    if unknown:
        raise NotImplementedError(f"{at}: {unknown}")
    if "$ref" in schema:
        target = root["$defs"][schema["$ref"].removeprefix("#/$defs/")]
        return problems(value, target, root, at)
    if "oneOf" in schema:
        found = [problems(value, one, root, at) for one in schema["oneOf"]]
        if sum(not wrong for wrong in found) == 1:
            return []
        return [f"{at} fits not exactly one of: {found}"]
    if "const" in schema and value != schema["const"]:
        return [f"{at} is {value!r}, not {schema['const']!r}"]
    if "enum" in schema and value not in schema["enum"]:
        return [f"{at} is {value!r}, none of {schema['enum']}"]
    kinds = schema.get("type", [])
    kinds = [kinds] if isinstance(kinds, str) else kinds
    if kinds and not any(_is(value, kind) for kind in kinds):
        return [f"{at} is {value!r}, not of type {kinds}"]
    if isinstance(value, int | float) and value < schema.get("minimum", value):
        return [f"{at} is {value!r}, below {schema['minimum']}"]
    if isinstance(value, dict):
        return _of_object(value, schema, root, at)
    if isinstance(value, list):
        return _of_array(value, schema, root, at)
    return []


def _is(value: Any, kind: str) -> bool:
    if isinstance(value, bool):
        return kind == "boolean"
    return isinstance(value, _KINDS[kind])


def _of_object(value: dict, schema: dict, root: dict, at: str) -> list[str]:
    wrong = [f"{at}.{key} is missing" for key in schema.get("required", ())]
    wrong = [text for text in wrong if text.split()[0][len(at) + 1 :] not in value]
    inner = schema.get("properties", {})
    rest = schema.get("additionalProperties", True)
    for key, item in value.items():
        if key in inner:
            wrong += problems(item, inner[key], root, f"{at}.{key}")
        elif rest is False:
            wrong.append(f"{at}.{key} is not known")
        elif rest is not True:
            wrong += problems(item, rest, root, f"{at}.{key}")
    return wrong


def _of_array(value: list, schema: dict, root: dict, at: str) -> list[str]:
    if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", 10**9):
        return [f"{at} has {len(value)} items"]
    wrong = []
    for index, item in enumerate(value):
        wrong += problems(item, schema.get("items", {}), root, f"{at}[{index}]")
    return wrong
