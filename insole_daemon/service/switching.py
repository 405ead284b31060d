"""Requests that report or switch the published model, static or dynamic."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, get_args

from ..errors import InsoleError
from ..wire.messages import Event, ModelName
from .foot import Foot
from .operations import Operation
from .zeroing import LatchingPublisher


def model_handler(foot: Foot, publisher: LatchingPublisher) -> Callable[[dict[str, Any]], Operation]:
    """Return the handler of `model` requests: `do` is `tell`, `static` or `dynamic`; InsoleError for anything else."""

    def handle(request: dict[str, Any]) -> Operation:
        do = request.get("do")
        known = ("tell", *get_args(ModelName))
        if do not in known or len(request) > 1:
            raise InsoleError(f"model: expected `do`, one of {', '.join(known)}, and nothing else, found {request}")
        return _switch(foot, publisher, str(do))

    return handle


def _switch(foot: Foot, publisher: LatchingPublisher, do: str) -> Operation:
    yield
    meta = foot.meta()
    if do == "dynamic" and not meta.effects:
        raise InsoleError(f"the calibration of the {foot.name} foot has no effects ({meta.calibration}): both are one")
    if do != "tell" and do != foot.model:
        foot.switch("static" if do == "static" else "dynamic")
        meta = foot.meta()
        publisher.publish_latched("meta", meta)
        publisher.publish(Event(foot.name, time.time_ns(), "model_switched", f"{foot.model} from now on", []))
    return {
        "foot": foot.name,
        "model": meta.model,
        "calibration": meta.calibration,
        "effects": meta.effects,
        "late_ms": float(meta.late_ms.max()),
    }
