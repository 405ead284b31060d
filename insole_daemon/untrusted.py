"""What anybody may have sent: read without a crash, and quoted in a message without repeating all of it.

Parsers of JSON and msgpack follow a thousand brackets, Python's recursion does not; and a map of theirs may hold what
no schema of ours has: bytes, keys that are no text, infinities, numbers beyond 64 bits.
"""

from __future__ import annotations

import json
import math
import reprlib
from typing import Any

MAX_DEPTH = 20  # of maps and lists within each other; our messages need 5
_LONGEST_QUOTE = 60
_INT64 = range(-(2**63), 2**63)


def parse_json(text: str | bytes) -> Any:
    """What `text` says; ValueError where it is no JSON, whatever is wrong with it."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("maps and lists are nested too deep") from error


def quoted(value: object) -> str:
    """`value` as a message quotes it: the beginning of it, however large it is."""
    return f"{reprlib.repr(value):.{_LONGEST_QUOTE}}"


def is_plain(value: Any, depth: int = 0) -> bool:
    """Whether it is maps with text as keys, lists, text, true, false, null, and numbers, finite and of 64 bits."""
    if isinstance(value, dict):
        return depth < MAX_DEPTH and all(isinstance(k, str) and is_plain(v, depth + 1) for k, v in value.items())
    if isinstance(value, list):
        return depth < MAX_DEPTH and all(is_plain(each, depth + 1) for each in value)
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, int):
        return value in _INT64
    return value is None or isinstance(value, str)
