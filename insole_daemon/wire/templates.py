"""Templates of cycle messages: the bytes that are the same in every cycle, and the places of the others.

The compiled kernel fills a template in; the result equals `Message.encode` to the byte. A template is a sequence of
pieces: a length (2 bytes), that many bytes of the message, and one byte with the code of the value that follows.
"""

from __future__ import annotations

from typing import Any, Final

import msgpack
import numpy as np

from .messages import Message, Models, Raw, wire_fields

_END: Final = 0
_OF_WRENCH: Final = (
    "f_z_n", "m_x_nm", "m_y_nm", "cop_x_m", "cop_y_m", "f_z_std_n", "m_x_std_nm", "m_y_std_nm", "contact_area_m2",
    "valid_fraction",
)  # fmt: skip
_VARIABLE: Final = (
    "seq", "t_ns", "t_published_ns", "counts", "status", "triangle_t_ns", "age_ms", "missing", "valid", "late",
    "repeated", "pressure_pa", "dynamic_t_ns", "dynamic_pressure_pa", "beyond",
    *_OF_WRENCH, *(f"dynamic_{field}" for field in _OF_WRENCH), "beyond_fraction",
)  # fmt: skip
_CODES: Final = {field: code for code, field in enumerate(_VARIABLE, 1)}  # as kernel.c has them


def template(message: type[Message], constants: dict[str, Any], publishes_dynamic: bool) -> bytes:
    """Return the template of `message`; `constants` has the fields that are the same in every cycle.

    With `publishes_dynamic`, a pressure and a wrench are those of the dynamic model.
    """
    fields = wire_fields(message)
    pieces = b""
    fixed = msgpack.Packer().pack_map_header(len(fields))
    for field in fields:
        fixed += msgpack.packb(field)
        if field in constants:
            value = constants[field]
            fixed += msgpack.packb(value.tobytes() if isinstance(value, np.ndarray) else value)
        else:
            pieces += _piece(fixed, _code(message, field, publishes_dynamic))
            fixed = b""
    return pieces + _piece(fixed, _END)


def _code(message: type[Message], field: str, publishes_dynamic: bool) -> int:
    """Return the code of a field that varies; taxels are valid by both models or by none."""
    if message is Models:
        field = field.removeprefix("static_").replace("dynamic_valid", "valid")
    elif message is not Raw and publishes_dynamic:
        field = f"dynamic_{field}" if f"dynamic_{field}" in _CODES else field
    return _CODES[field]


def _piece(fixed: bytes, code: int) -> bytes:
    return len(fixed).to_bytes(2, "little") + fixed + bytes([code])
