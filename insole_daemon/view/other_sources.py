"""What others publish of the same feet: a reference instrument, and another rig, such as a simulation of this one.

Their moments are not ours: a value is interpolated between the two around a cycle's, and is none where they are too
far away.
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

_KEPT = 50
_NEAR_NS = 60_000_000

COLUMNS = ("fz_n", "mx_nm", "my_nm")


class Series:
    """The last values of something, (n,) each, by time."""

    def __init__(self) -> None:
        self._values: deque[tuple[int, NDArray[np.float64]]] = deque(maxlen=_KEPT)

    def add(self, t_ns: int, value: NDArray[np.float64]) -> None:
        """The newest value; time that goes backwards, or another length, begins anew."""
        if self._values and (t_ns < self._values[-1][0] or value.shape != self._values[-1][1].shape):
            self._values.clear()
        self._values.append((t_ns, value))

    def at(self, t_ns: int) -> NDArray[np.float64] | None:
        """The value at `t_ns`, None where nobody said one near it."""
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
class Beside:
    """What others say of the same moment: N, N·m; NaN or None where they say nothing."""

    reference: tuple[float, float, float]
    model: tuple[float, float, float]
    pressure_pa: NDArray[np.float64] | None  # (n_triangles, 12)


class Others:
    """Everything that is published beside one rig: readings of references, and the rig `rig`."""

    def __init__(self, rig: str, references: Mapping[str, str]) -> None:
        """`references`: the key of each foot's reference."""
        self._rig, self._references = rig, references
        self._reference = {foot: Series() for foot in references}
        self._model = {foot: Series() for foot in ("left", "right")}
        self._pressure = {foot: Series() for foot in ("left", "right")}

    def listening(self, client: Client) -> Iterator[Coroutine[Any, Any, None]]:
        """What takes it all in, each until it is cancelled."""
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
            values = reading(payload)
            if values is not None:
                self._reference[foot].add(time.time_ns(), values)

    def at(self, foot: str, t_ns: int, shape: tuple[int, ...]) -> Beside:
        """What is said of `foot` at `t_ns`, whose arrays have `shape`."""
        reference = self._reference.get(foot)
        pressure_pa = self._pressure[foot].at(t_ns)
        return Beside(
            triple(None if reference is None else reference.at(t_ns)),
            triple(self._model[foot].at(t_ns)),
            pressure_pa if pressure_pa is not None and pressure_pa.shape == shape else None,
        )


def reading(payload: bytes) -> NDArray[np.float64] | None:
    """(3,) f_z, m_x, m_y of a reference's message, a JSON object as `insole record` takes it; None where it is none."""
    try:
        said = parse_json(payload)
        values = [math.nan if said[name] is None else float(said[name]) for name in COLUMNS]
    except (ValueError, TypeError, KeyError, OverflowError):
        return None
    return np.array(values)


def triple(values: NDArray[np.float64] | Sequence[float | None] | None) -> tuple[float, float, float]:
    """As three floats, NaN where nothing is known."""
    if values is None:
        return (math.nan, math.nan, math.nan)
    first, second, third = (math.nan if value is None else float(value) for value in values)
    return (first, second, third)
