"""A chart of the input delays: a bar to the median, a thin one to the 99th percentile."""

from collections.abc import Sequence
from xml.sax.saxutils import escape

from bench.measure import Result

_ROW = 34
_LEFT, _WIDTH, _RIGHT, _TOP = 190, 520, 120, 46
_TITLE = "Input change to MQTT message in ms: median (wide), 99 % (thin), expected median (line)"
_TEXT = 'font-family="sans-serif" font-size="13" fill="#333"'


def chart(results: Sequence[Result]) -> str:
    """An SVG with a row for each case whose inputs changed on a paced line."""
    rows = [result for result in results if result.inputs and result.limit_cycle]
    most = max((result.inputs.p99 for result in rows if result.inputs), default=1.0)
    height = _TOP + _ROW * len(rows) + 10
    total = _LEFT + _WIDTH + _RIGHT
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {total} {height}">',
        f'<rect width="{total}" height="{height}" fill="#fff"/>',
        f'<text x="10" y="20" {_TEXT}>{_TITLE}</text>',
    ]
    for number, result in enumerate(rows):
        parts += _row(result, _TOP + number * _ROW, _WIDTH / most)
    return "\n".join([*parts, "</svg>"]) + "\n"


def _row(result: Result, y: int, scale: float) -> list[str]:
    assert result.inputs is not None
    median, end = result.inputs.p50 * scale, result.inputs.p99 * scale
    expected = _LEFT + result.inputs_expected * scale
    name = escape(result.case)
    figures = f"{result.inputs.p50:.0f} / {result.inputs.p99:.0f}"
    return [
        f'<text x="{_LEFT - 8}" y="{y + 16}" text-anchor="end" {_TEXT}>{name}</text>',
        f'<rect x="{_LEFT}" y="{y + 9}" width="{end:.1f}" height="4" fill="#9bb8d3"/>',
        f'<rect x="{_LEFT}" y="{y + 2}" width="{median:.1f}" height="18" fill="#2f6fa7"/>',
        f'<path d="M{expected:.1f} {y - 2}v26" stroke="#c0392b" stroke-width="2"/>',
        f'<text x="{_LEFT + end + 8:.1f}" y="{y + 16}" {_TEXT}>{figures}</text>',
    ]
