"""The HTTP interface as a page, from docs/openapi.yaml."""

from collections.abc import Iterator, Mapping
from typing import Any

import yaml

Node = Mapping[str, Any]


def page_of(text: str) -> str:
    """Return a page in Markdown: each route, then each form of a body."""
    document = yaml.safe_load(text)
    lines = ["# Routes and bodies", "", document["info"]["description"], ""]
    for path, methods in document["paths"].items():
        for method, route in methods.items():
            lines += _route(f"{method.upper()} {path}", route, document["components"]["responses"])
    for name, shape in document["components"]["schemas"].items():
        lines += [f"## {name}", "", *_shape(shape), ""]
    return "\n".join(lines)


def _route(title: str, route: Node, responses: Node) -> Iterator[str]:
    yield from (f"## {title}", "", f"{route['summary']}.", "")
    if "requestBody" in route:
        yield from (f"Body: {_body(route['requestBody'])}", "")
    yield from ("| status | what it means | body |", "|---|---|---|")
    for status, answer in route["responses"].items():
        whole = responses[_last(answer)] if "$ref" in answer else answer
        yield f"| {status} | {whole['description']} | {_body(whole)} |"
    yield ""


def _body(part: Node) -> str:
    bodies = part.get("content", {}).items()
    return ", ".join(f"`{kind}`: {_kind(content['schema'])}" for kind, content in bodies)


def _shape(shape: Node) -> Iterator[str]:
    if "properties" not in shape:
        yield _kind(shape)
        return
    yield from ("| key | kind | |", "|---|---|---|")
    for key, value in shape["properties"].items():
        needed = "always" if key in shape.get("required", ()) else ""
        told = " ".join(part for part in (needed, value.get("description", "")) if part)
        yield f"| `{key}` | {_kind(value)} | {told} |"


def _kind(shape: Node) -> str:
    """Return what a value is, in a few words; a form of its own is a link."""
    if "$ref" in shape:
        return f"[{_last(shape)}](#{_last(shape).lower()})"
    if words := shape.get("enum", [shape["const"]] if "const" in shape else []):
        return ", ".join(f"`{word}`" for word in words)
    for several in ("oneOf", "anyOf"):
        if several in shape:
            return " or ".join(_kind(one) for one in shape[several])
    if "items" in shape:
        return f"list of {_kind(shape['items'])}"
    if isinstance(shape.get("additionalProperties"), dict):
        return f"map of {_kind(shape['additionalProperties'])}"
    kinds = shape.get("type", "anything")
    return kinds if isinstance(kinds, str) else " or ".join(kinds)


def _last(reference: Node) -> str:
    return str(reference["$ref"]).rpartition("/")[2]
