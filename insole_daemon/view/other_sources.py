"""Other sources of data on the same feet: a reference instrument, and another rig, such as a simulation of this one.

Their times differ from those of the cycles. A value is interpolated between the two around a cycle's time, and is
unknown if these are too far away.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Coroutine, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..untrusted import parse_json
from ..wire.client import Client
from ..wire.keys import key
from ..wire.messages import Pressure, Wrench

_LENGTH = 50
_NEAR_NS = 60_000_000

COLUMNS = ("fz_n", "mx_nm", "my_nm")


class Series:
    """The last values of one quantity, (n,) each, by time."""

    def __init__(self) -> None:
        self._values: deque[tuple[int, NDArray[np.float64]]] = deque(maxlen=_LENGTH)

    def add(self, t_ns: int, value: NDArray[np.float64]) -> None:
        """Add the newest value; time that goes backwards, or another length, clears the series."""
        if self._values and (t_ns < self._values[-1][0] or value.shape != self._values[-1][1].shape):
            self._values.clear()
        self._values.append((t_ns, value))

    def at(self, t_ns: int) -> NDArray[np.float64] | None:
        """Return the value at `t_ns`, or None if there is none near it."""
        after = None
        for then_ns, value in reversed(self._values):
            if then_ns > t_ns:
                after = then_ns, value
                continue
            if t_ns - then_ns > _NEAR_NS:
                break
            if after is None or after[0] - t_ns > _NEAR_NS:
                return value
            part = (t_ns - then_ns) / (after[0] - then_ns)
            return value + part * (after[1] - value)
        return None if after is None or after[0] - t_ns > _NEAR_NS else after[1]


@dataclass(frozen=True, slots=True)
class OtherValues:
    """The values of other sources at the time of a cycle, in N and N·m; NaN or None if unknown."""

    reference: tuple[float, float, float]
    model: tuple[float, float, float]
    pressure_pa: NDArray[np.float64] | None  # (n_triangles, 12)


class OtherSources:
    """The subscriptions to references and to the other rig `rig`, with their last values."""

    def __init__(self, rig: str, references: Mapping[str, str]) -> None:
        """`references`: the key of each foot's reference."""
        self._rig, self._references = rig, references
        self._reference = {foot: Series() for foot in references}
        self._model = {foot: Series() for foot in ("left", "right")}
        self._pressure = {foot: Series() for foot in ("left", "right")}

    def listening(self, client: Client) -> Iterator[Coroutine[Any, Any, None]]:
        """Yield the tasks that receive the data, each until it is cancelled."""
        yield self._listen_to_rig(client)
        for foot, own_key in self._references.items():
            yield self._listen_to_reference(client, foot, own_key)

    async def _listen_to_rig(self, client: Client) -> None:
        async for message in client.messages(key(self._rig, "*", "*")):
            if isinstance(message, Wrench):
                wrench = triple((message.f_z_n, message.m_x_nm, message.m_y_nm))
                self._model[message.foot].add(message.t_ns, np.array(wrench))
            elif isinstance(message, Pressure):
                self._pressure[message.foot].add(message.t_ns, message.pressure_pa.astype(np.float64))

    async def _listen_to_reference(self, client: Client, foot: str, own_key: str) -> None:
        async for payload in client.payloads(own_key):
            values = parse_reference(payload)
            if values is not None:
                self._reference[foot].add(time.time_ns(), values)

    def at(self, foot: str, t_ns: int, shape: tuple[int, ...]) -> OtherValues:
        """Return the values for `foot` at `t_ns`; `shape` is that of its taxel arrays."""
        reference = self._reference.get(foot)
        pressure_pa = self._pressure[foot].at(t_ns)
        return OtherValues(
            triple(None if reference is None else reference.at(t_ns)),
            triple(self._model[foot].at(t_ns)),
            pressure_pa if pressure_pa is not None and pressure_pa.shape == shape else None,
        )


def parse_reference(payload: bytes) -> NDArray[np.float64] | None:
    """Return f_z, m_x, m_y, (3,), of a reference's JSON message as for `insole record`; None if it is not one."""
    try:
        document = parse_json(payload)
        values = [math.nan if document[name] is None else float(document[name]) for name in COLUMNS]
    except (ValueError, TypeError, KeyError, OverflowError):
        return None
    return np.array(values)


def triple(values: NDArray[np.float64] | Sequence[float | None] | None) -> tuple[float, float, float]:
    """Return three floats, NaN where unknown."""
    if values is None:
        return (math.nan, math.nan, math.nan)
    first, second, third = (math.nan if value is None else float(value) for value in values)
    return (first, second, third)
