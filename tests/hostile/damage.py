"""Good inputs made bad: what hypothesis draws for a parser of bytes."""

from __future__ import annotations

from collections.abc import Sequence

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
