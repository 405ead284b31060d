"""Handling of untrusted data: reading it without a crash, and quoting it in a message in shortened form.

Parsers of JSON and msgpack accept a thousand nested brackets, Python's recursion does not. Their maps may contain
values that our schemas do not have: bytes, keys that are not text, infinities, numbers beyond 64 bits.
"""

from __future__ import annotations

import json
import math
import reprlib
from typing import Any

MAX_DEPTH = 20  # of nested maps and lists; our messages need 5
_LONGEST_QUOTE = 60
_INT64 = range(-(2**63), 2**63)


def parse_json(text: str | bytes) -> Any:
    """Return the JSON value of `text`; ValueError for any invalid JSON."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("maps and lists are nested too deep") from error


def quoted(value: object) -> str:
    """Return the beginning of `value` for a message, however large it is."""
    return f"{reprlib.repr(value):.{_LONGEST_QUOTE}}"


def is_plain(value: Any, depth: int = 0) -> bool:
    """Return whether `value` consists of maps with text keys, lists, text, booleans, null and finite 64-bit numbers."""
    if isinstance(value, dict):
        return depth < MAX_DEPTH and all(isinstance(k, str) and is_plain(v, depth + 1) for k, v in value.items())
    if isinstance(value, list):
        return depth < MAX_DEPTH and all(is_plain(item, depth + 1) for item in value)
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, int):
        return value in _INT64
    return value is None or isinstance(value, str)
