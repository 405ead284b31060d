"""Good inputs made bad: what hypothesis draws for a parser of bytes, and for one of maps and lists."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from typing import Any

from hypothesis import strategies as st

# What parsers stumble over: beyond 64 bits, no number, no text, more brackets than a recursion follows.
TOKENS = (
    b"\0", b"\xff" * 8, b"\x80\0\0\0", b"\xed\xa0\x80", b"\\ud800", b"nan", b"-inf", b"1e999", b"9" * 30, b"9" * 5000,
    b"-1", b"\n", b"\r", b",", b'"', b"[" * 3000, b'{"a":' * 3000, b"\x91" * 1010, b"\x81\xa1a" * 1010, b"\xc1", b"../",
    b"&a ", b"*a", b"!!python/object:os.system ", b"<<: ",
)  # fmt: skip

Edit = tuple[int, int, bytes]  # of the length, in millionths; how many bytes go; what comes


def damaged(seeds: Sequence[bytes]) -> st.SearchStrategy[bytes]:
    """One of `seeds` with some places replaced, or bytes that have nothing to do with it."""
    piece = st.one_of(
        st.binary(max_size=8), st.sampled_from(TOKENS), st.sampled_from(seeds).map(lambda seed: seed[:99])
    )
    edits = st.lists(
        st.tuples(st.integers(0, 999_999), st.sampled_from((0, 0, 1, 4, 8, 100)), piece), min_size=1, max_size=6
    )
    return st.one_of(st.builds(_edited, st.sampled_from(seeds), edits), st.binary(min_size=1, max_size=200))


def _edited(seed: bytes, edits: list[Edit]) -> bytes:
    for at, gone, new in edits:
        place = at * (len(seed) + 1) // 1_000_000
        seed = seed[:place] + new + seed[place + gone :]
    return seed or b"\0"


# What may stand where something else is meant: other types, lists of other shapes, words that mean something elsewhere.
VALUES = (
    None, True, 0, -1, 16, 255, 1.5, 1e300, 10**30, 10**400, float("inf"), float("nan"), "", "x", "taxel",
    "hysteresis", "swapped_triangles", [], [[]], [1], [1, [2]], [[1], [2, 3]], [[1, 2], [3, 4]], ["a"], [None],
    [10**400], [[5, 0, 0]], [[5, 0], [6, 4]], {}, {"a": 1}, {"value": 1, "unit": "s"}, {"unit": "s"},
    {"value": [1, [2]], "std": 1, "unit": "s"},
)  # fmt: skip


def bent(documents: Sequence[Any]) -> st.SearchStrategy[Any]:
    """One of `documents`, plain maps and lists, with another value at some place."""
    places = [(document, path) for document in documents for path in _paths(document)]
    return st.builds(_put, st.sampled_from(places), st.sampled_from(VALUES))


def _paths(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield path
    keys = value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for key in keys:
        yield from _paths(value[key], (*path, key))


def _put(place: tuple[Any, tuple[Any, ...]], new: Any) -> Any:
    document, path = copy.deepcopy(place[0]), place[1]
    if not path:
        return new
    inside = document
    for key in path[:-1]:
        inside = inside[key]
    inside[path[-1]] = new
    return document
