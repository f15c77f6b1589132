"""docs/openapi.yaml, and whether an answer is as it says."""

from pathlib import Path
from typing import Any

import yaml
from jsonschema import Draft202012Validator
from support.web_panel import WebAnswer

OPENAPI = yaml.safe_load((Path(__file__).parents[2] / "docs" / "openapi.yaml").read_text())


def fits(answer: WebAnswer, path: str, method: str) -> Any:
    """Return the document of an answer, after the schema of the answer has taken it."""
    described = OPENAPI["paths"][path][method]["responses"][str(answer.status)]
    while "$ref" in described:
        described = OPENAPI["components"]["responses"][described["$ref"].rpartition("/")[2]]
    schema = {**described["content"]["application/json"]["schema"], **OPENAPI}
    problems = [
        error.message for error in Draft202012Validator(schema).iter_errors(answer.document)
    ]
    assert problems == []
    return answer.document
