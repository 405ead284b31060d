"""`insole watch`: print any key, as text or as JSON lines."""

from __future__ import annotations

import dataclasses
import json
import sys
from typing import Annotated, Any

import typer

from ..config import DEFAULT_ENDPOINT
from ..wire.keys import ROOT
from .options import Connect, ZenohFile, name_next, on_end
from .tables import fold


def watch(
    key: Annotated[str, typer.Argument(help="Key expression, for example 'insole/*/left/wrench'.")] = f"{ROOT}/**",
    connect: Connect = DEFAULT_ENDPOINT,
    zenoh_config: ZenohFile = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object a line, arrays as lists.")] = False,
    count: Annotated[int | None, typer.Option(min=1, help="End after so many messages.")] = None,
) -> None:
    """Print the messages published on a key.

    Unknown kinds of messages are left out; payloads that do not match their key are counted on stderr.
    """
    from ..wire.client import Client

    with Client(connect, config_file=zenoh_config) as insole:
        messages = insole.messages(key)
        on_end(messages.close)
        for number, message in enumerate(messages, 1):
            line = _json(message) if as_json else _text(message)
            if sys.stdout.isatty() and not as_json:  # programs read one message per line
                line = fold(line, 4)
            sys.stdout.write(line + "\n")
            sys.stdout.flush()
            if number == count:
                break
        if messages.refused:
            print(f"insole: {messages.refused} payloads did not match their key and were left out", file=sys.stderr)
    name_next("insole record walk-1 --remote")


def _json(message: Any) -> str:
    """Return one JSON object; values in a map that JSON does not have are written as text."""
    return json.dumps({"schema": message.SCHEMA} | _plain(message), default=repr, skipkeys=True)


def _plain(message: Any) -> dict[str, Any]:
    """Return the fields for JSON: arrays as lists, NaN and infinity as null."""
    import numpy as np

    plain = {}
    for field in dataclasses.fields(message):
        value = getattr(message, field.name)
        if isinstance(value, np.ndarray):
            value = _list(value) if value.dtype.kind == "f" else value.tolist()
        plain[field.name] = value
    return plain


def _list(array: Any) -> Any:
    """Return nested lists with null for NaN and infinity, which JSON does not have."""
    import numpy as np

    plain = array.astype(object)
    plain[~np.isfinite(array)] = None
    return plain.tolist()


def _text(message: Any) -> str:
    """Return the fields on one line; an array as its shape and range."""
    import numpy as np

    words = [message.SCHEMA]
    for field in dataclasses.fields(message):
        value = getattr(message, field.name)
        if isinstance(value, np.ndarray):
            finite = value[np.isfinite(value)]
            span = f"{finite.min():g}..{finite.max():g}" if finite.size else "none"
            value = f"{'x'.join(map(str, value.shape))}[{span}]"
        elif isinstance(value, float):
            value = f"{value:.4g}"
        words.append(f"{field.name}={value}")
    return " ".join(words)
