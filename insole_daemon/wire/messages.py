"""The messages: msgpack maps whose arrays travel as little-endian bytes.

`protocol/` specifies the same for other languages, one JSON schema a message; a test keeps the two in step.
A field that may be unknown is null on the wire and None here; NaN never travels outside arrays.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from types import UnionType
from typing import Annotated, Any, ClassVar, Literal, Self, Union, get_args, get_origin, get_type_hints

import msgpack
import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from ..errors import WireError
from ..untrusted import is_plain, quoted

Foot = Literal["left", "right"]
MOST_BYTES = 1 << 20  # of a payload: calibration and meta of an insole with much provenance have a tenth of it
MOST_TRIANGLES = 14 * 16  # of a rig: addresses 1 to 14; no other axis is longer
ModelName = Literal["static", "dynamic"]


@dataclass(frozen=True, slots=True)
class Array:
    """Type and shape of an array on the wire; an axis is a number or the name of an integer field."""

    dtype: str
    shape: tuple[int | str, ...]


PerTriangle = Annotated[NDArray[np.float32], Array("<f4", ("n_triangles",))]
PerTaxel = Annotated[NDArray[np.float32], Array("<f4", ("n_triangles", 12))]
MarkPerTriangle = Annotated[NDArray[np.uint8], Array("|u1", ("n_triangles",))]
MarkPerTaxel = Annotated[NDArray[np.uint8], Array("|u1", ("n_triangles", 12))]


class Message:
    """What every message can do; the fields are those of its dataclass."""

    SCHEMA: ClassVar[str]
    foot: Foot

    def encode(self) -> bytes:
        """Encode this message as a payload."""
        return self.encode_values(tuple([getattr(self, name) for name in wire_fields(type(self))]))

    @classmethod
    def encode_values(cls, values: tuple[Any, ...]) -> bytes:
        """Encode the message with these values of the transmitted fields, in their order."""
        heads = _heads(cls)
        if kernel is not None and heads is not None:
            packed: bytes = kernel.pack(heads, values)
            return packed
        payload: bytes = msgpack.packb({
            name: _to_wire(value) for name, value in zip(wire_fields(cls), values, strict=True)
        })  # fmt: skip
        return payload

    @classmethod
    def decode(cls, payload: bytes, encoding: str | None = None) -> Self:
        """Decode a message; raises WireError if `payload` does not match the schema.

        `encoding` is Zenoh's; by it, another version of the message is recognised.
        """
        expected = f"application/msgpack;{cls.SCHEMA}"
        if encoding is not None and encoding != expected:
            raise WireError(
                f"expected a message {expected!r}, found {encoding!r}: "
                "the sender speaks another version; install the same insole-daemon on both sides"
            )
        if len(payload) > MOST_BYTES:
            raise WireError(f"{cls.SCHEMA}: expected at most {MOST_BYTES} bytes, found {len(payload)}")
        try:
            content = msgpack.unpackb(payload, raw=False, max_ext_len=0)
        except Exception as error:  # msgpack raises ValueError and half a dozen of its own
            raise WireError(f"{cls.SCHEMA}: expected a msgpack map, found {len(payload)} bytes: {error}") from error
        if not isinstance(content, dict):
            raise WireError(f"{cls.SCHEMA}: expected a msgpack map, found {type(content).__name__}")
        fields = wire_fields(cls)
        if content.keys() != fields.keys():
            raise WireError(
                f"{cls.SCHEMA}: expected the keys {sorted(fields)}, "
                f"missing {sorted(fields.keys() - content.keys())}, "
                f"unknown {quoted(sorted(map(str, content.keys() - fields.keys())))}"
            )
        return cls(**{name: _from_wire(cls, name, hint, content) for name, hint in fields.items()})


@dataclass(frozen=True, slots=True, eq=False)
class Raw(Message):
    """Every cycle: the counts as the boards sent them."""

    SCHEMA = "insole.raw/1"
    foot: Foot
    seq: int  # counts the cycles published since started_ns
    started_ns: int  # when the daemon started, CLOCK_REALTIME: another value is another count
    t_ns: int  # kernel receive time of the newest half, CLOCK_REALTIME
    t_published_ns: int
    n_triangles: int
    counts: MarkPerTaxel
    status: Annotated[NDArray[np.uint16], Array("<u2", ("n_triangles",))]  # status word of half B
    triangle_t_ns: Annotated[NDArray[np.int64], Array("<i8", ("n_triangles",))]  # older half; 0: never received
    age_ms: PerTriangle  # age of the older half when the cycle closed; NaN: never received
    missing: MarkPerTriangle  # 1: a half was expected in this cycle and did not come
    valid: MarkPerTaxel
    late: bool  # closed by time, with halves missing
    repeated: bool  # nothing has arrived since the cycle before
    lost: int = field(default=0, metadata={"local": True})  # cycles that did not reach this client before this one


@dataclass(frozen=True, slots=True, eq=False)
class Pressure(Message):
    """Every cycle: the pressure map."""

    SCHEMA = "insole.pressure/2"
    foot: Foot
    seq: int
    started_ns: int
    t_ns: int  # of the load: as in raw, less the delay of all triangles by the model
    t_published_ns: int
    n_triangles: int
    pressure_pa: PerTaxel  # NaN: thermal pad, or not in the calibration
    valid: MarkPerTaxel  # 0: not to be read as pressure
    age_ms: PerTriangle
    missing: MarkPerTriangle
    repeated: bool
    model: ModelName  # that the pressure is of
    beyond: MarkPerTaxel  # 1: beyond the range of the effects of the dynamic model
    lost: int = field(default=0, metadata={"local": True})


@dataclass(frozen=True, slots=True, eq=False)
class Wrench(Message):
    """Every cycle: what the ground does to the foot, about the insole's origin."""

    SCHEMA = "insole.wrench/2"
    foot: Foot
    seq: int
    started_ns: int
    t_ns: int  # as in pressure
    t_published_ns: int
    n_triangles: int
    f_z_n: float | None  # None: no taxel is valid
    m_x_nm: float | None
    m_y_nm: float | None
    cop_x_m: float | None  # None: below the contact force stated in meta
    cop_y_m: float | None
    f_z_std_n: float | None  # None: the calibration carries no uncertainty, and no taxel is missing
    m_x_std_nm: float | None
    m_y_std_nm: float | None
    contact_area_m2: float
    valid_fraction: float
    valid: MarkPerTaxel
    age_ms: PerTriangle
    missing: MarkPerTriangle
    repeated: bool
    model: ModelName  # whose pressure is summed
    beyond_fraction: float  # share of the valid taxels beyond the range of the effects of the dynamic model
    lost: int = field(default=0, metadata={"local": True})


@dataclass(frozen=True, slots=True, eq=False)
class Models(Message):
    """Every cycle of a foot whose calibration has effects: what it is without them and with them."""

    SCHEMA = "insole.models/1"
    foot: Foot
    seq: int
    started_ns: int
    t_published_ns: int
    n_triangles: int
    model: ModelName  # the one in pressure and wrench
    static_t_ns: int  # as in raw
    static_f_z_n: float | None
    static_m_x_nm: float | None
    static_m_y_nm: float | None
    static_cop_x_m: float | None
    static_cop_y_m: float | None
    static_pressure_pa: PerTaxel
    static_valid: MarkPerTaxel
    dynamic_t_ns: int  # of the load
    dynamic_f_z_n: float | None
    dynamic_m_x_nm: float | None
    dynamic_m_y_nm: float | None
    dynamic_cop_x_m: float | None
    dynamic_cop_y_m: float | None
    dynamic_pressure_pa: PerTaxel
    dynamic_valid: MarkPerTaxel
    beyond: MarkPerTaxel
    repeated: bool
    lost: int = field(default=0, metadata={"local": True})


@dataclass(frozen=True, slots=True, eq=False)
class Health(Message):
    """Once a second: what runs and what is wrong."""

    SCHEMA = "insole.health/4"
    foot: Foot
    t_ns: int
    uptime_s: float
    state: Literal["ok", "degraded", "no data"]
    cycles: dict[str, int]  # published, late, repeated, skipped, superseded and missed halves, extrapolated, beyond
    publish_rate_hz: float  # over the last second
    quality: dict[str, Any]  # of the last 10 s: cycles expected, received, skipped, repeated, late, share, verdict
    latency_ms: dict[str, float | None]  # newest half → put, over the last second: p50, p99, max
    boards: list[dict[str, Any]]
    faults: list[dict[str, Any]]  # present ones: kind, board, triangle, taxel, since
    bus: dict[str, Any]  # frames, overflows, error frames by kind, clock steps, state of every interface
    refused: dict[str, Any]  # frames that carried no half of a configured triangle, by reason
    asked: dict[str, int]  # requests and reloads, done and refused; commands to boards, sent and refused


@dataclass(frozen=True, slots=True, eq=False)
class Event(Message):
    """When something happens."""

    SCHEMA = "insole.event/2"
    foot: Foot
    t_ns: int  # when it was noticed; of a step, when it happened
    kind: str
    text: str
    boards: list[int]
    triangle: int | None = None  # of the only board; None: the event does not concern one triangle
    taxel: int | None = None
    figures: dict[str, float | None] = field(default_factory=dict)  # of a step; unit in the name, None: not known


@dataclass(frozen=True, slots=True, eq=False)
class Meta(Message):
    """What one must know to read the cycle messages; on request, and cached for late joiners."""

    SCHEMA = "insole.meta/2"
    foot: Foot
    rig: str
    version: str  # of the daemon
    started_ns: int
    n_triangles: int
    triangles: list[dict[str, Any]]  # board, triangle, patch, in the order of every array
    boards: list[dict[str, Any]]  # as configured
    xy_m: Annotated[NDArray[np.float32], Array("<f4", ("n_triangles", 12, 2))]
    taxel_area_m2: float
    area_meaning: str | None
    layout: str  # the file, or a description of the built-in one
    layout_builtin: bool  # an approximation that knows nothing of this insole
    calibration: str  # the file, or a description of the built-in one
    calibration_builtin: bool  # a default that knows nothing of this insole
    zero_source: str  # the file, or why there is none
    zero: dict[str, Any] | None  # all of it, as in insole-zero/1: its baselines are in use
    model: ModelName  # the one in pressure and wrench
    effects: list[dict[str, Any]]  # of the calibration: the effect, its place, why it is not undone or null
    late_ms: PerTriangle  # by how much the load of the dynamic model is older than its frames
    activation_threshold_count: float  # 0: off
    min_force_n: float
    min_pressure_pa: float
    rate_hz: float
    slack_ms: float
    stale_after_ms: float


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationInUse(Message):
    """The static curve as it is applied; on request, and cached for late joiners."""

    SCHEMA = "insole.calibration/1"
    foot: Foot
    n_triangles: int
    n_coefficients: int
    source: str
    builtin: bool
    baseline_count: Annotated[NDArray[np.float64], Array("<f8", ("n_triangles", 12))]
    coefficients_pa: Annotated[NDArray[np.float64], Array("<f8", ("n_triangles", 12, "n_coefficients"))]
    usable: MarkPerTaxel
    provenance: dict[str, Any]


BY_KEY: dict[str, type[Message]] = {
    "raw": Raw,
    "pressure": Pressure,
    "wrench": Wrench,
    "models": Models,
    "health": Health,
    "event": Event,
    "meta": Meta,
    "calibration": CalibrationInUse,
}

_FIELDS: dict[type[Message], dict[str, Any]] = {}


def wire_fields(cls: type[Message]) -> dict[str, Any]:
    """Return name and annotation of the transmitted fields of a message, in order."""
    if cls not in _FIELDS:
        hints = get_type_hints(cls, include_extras=True)
        _FIELDS[cls] = {
            f.name: hints[f.name]
            for f in dataclasses.fields(cls)  # type: ignore[arg-type]
            if not f.metadata.get("local")
        }
    return _FIELDS[cls]


_HEADS: dict[type[Message], tuple[bytes, ...] | None] = {}


def _heads(cls: type[Message]) -> tuple[bytes, ...] | None:
    """Return the bytes before each value, for the compiled kernel; None if a value is a map or a list."""
    if cls not in _HEADS:
        fields = wire_fields(cls)
        heads = [msgpack.packb(name) for name in fields]
        heads[0] = msgpack.Packer().pack_map_header(len(fields)) + heads[0]
        flat = not any(get_origin(hint) in (dict, list) for hint in _plain_hints(fields.values()))
        _HEADS[cls] = tuple(heads) if flat else None
    return _HEADS[cls]


def _plain_hints(hints: Iterable[Any]) -> Iterator[Any]:
    """Yield the annotations, each option of a union separately."""
    for hint in hints:
        yield from get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def _to_wire(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _from_wire(cls: type[Message], name: str, hint: Any, content: dict[str, Any]) -> Any:
    value = content[name]
    if get_origin(hint) is Annotated:
        array = next(extra for extra in get_args(hint) if isinstance(extra, Array))
        shape = [content.get(axis) if isinstance(axis, str) else axis for axis in array.shape]
        if not isinstance(value, bytes) or not all(isinstance(n, int) and 1 <= n <= MOST_TRIANGLES for n in shape):
            raise WireError(
                f"{cls.SCHEMA}: {name}: expected bytes of {array.dtype} {array.shape}, found {quoted(value)}, {shape}"
            )
        dtype = np.dtype(array.dtype)
        size = dtype.itemsize * math.prod(n or 0 for n in shape)
        if len(value) != size:
            raise WireError(
                f"{cls.SCHEMA}: {name}: expected {size} bytes for {array.dtype} {shape}, found {len(value)}"
            )
        return np.frombuffer(value, dtype).reshape(shape)
    if not _is_of(value, hint):
        raise WireError(f"{cls.SCHEMA}: {name}: expected {hint}, found {quoted(value)}")
    return value


def _is_of(value: Any, hint: Any) -> bool:
    """Return whether a decoded value has the annotated type and is plain; fields of maps and lists are not checked."""
    origin = get_origin(hint)
    if origin is Literal:
        return value in get_args(hint)
    if origin in (dict, list):
        return isinstance(value, origin) and is_plain(value)
    if origin in (Union, UnionType):
        return any(_is_of(value, option) for option in get_args(hint))
    if hint in (int, float):
        return isinstance(value, (int, hint)) and not isinstance(value, bool) and is_plain(value)
    return isinstance(value, hint)
