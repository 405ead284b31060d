"""Requests to a daemon and their replies: msgpack maps; a failed request has `error` in its reply.

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

_MOST_BYTES = 1 << 18  # a request has a few words, a reply some hundred


def encoding(schema: str) -> zenoh.Encoding:
    """Return Zenoh's encoding for a payload of `schema`."""
    return zenoh.Encoding("application/msgpack").with_schema(schema)


def pack(content: dict[str, Any]) -> bytes:
    """Encode a request or a reply."""
    payload: bytes = msgpack.packb(content)
    return payload


def unpack(payload: bytes, schema: str) -> dict[str, Any]:
    """Decode a payload of `schema`; raises WireError if it is not a map of plain values (untrusted.is_plain)."""
    try:
        content = msgpack.unpackb(payload, raw=False, max_ext_len=0) if len(payload) <= _MOST_BYTES else None
    except Exception as error:  # msgpack raises ValueError and half a dozen of its own
        raise WireError(f"{schema}: expected a msgpack map, found {len(payload)} bytes: {error}") from error
    if not isinstance(content, dict) or not is_plain(content):
        raise WireError(f"{schema}: expected a msgpack map of plain values with text as keys, found {quoted(content)}")
    return content
