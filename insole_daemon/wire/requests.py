"""Requests to a daemon and what it replies: msgpack maps, the reply's `error` where it did not do it.

A request is a Zenoh query on `insole/<rig>/<foot>/<verb>` with a payload {"do": …, further arguments}.
"""

from __future__ import annotations

from typing import Any

import msgpack
import zenoh

from ..errors import WireError
from ..untrusted import is_plain, quoted

REQUEST_SCHEMA = "insole.request/1"
REPLY_SCHEMA = "insole.reply/1"

_MOST_BYTES = 1 << 18  # a request says a few words, a reply some hundred


def encoding(schema: str) -> zenoh.Encoding:
    """Of a payload of `schema`."""
    return zenoh.Encoding("application/msgpack").with_schema(schema)


def pack(said: dict[str, Any]) -> bytes:
    """The payload that says it."""
    payload: bytes = msgpack.packb(said)
    return payload


def unpack(payload: bytes, schema: str) -> dict[str, Any]:
    """What a payload of `schema` says; raises WireError where it is no map of plain values (untrusted.is_plain)."""
    try:
        said = msgpack.unpackb(payload, raw=False, max_ext_len=0) if len(payload) <= _MOST_BYTES else None
    except Exception as error:  # msgpack raises ValueError and half a dozen of its own
        raise WireError(f"{schema}: expected a msgpack map, found {len(payload)} bytes: {error}") from error
    if not isinstance(said, dict) or not is_plain(said):
        raise WireError(f"{schema}: expected a msgpack map of plain values with text as keys, found {quoted(said)}")
    return said
