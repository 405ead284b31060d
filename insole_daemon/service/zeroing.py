"""Take a zero while the daemon runs, as an operation of its loop; no cycle is lost."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any, Protocol

from ..errors import InsoleError
from ..physics import zero as zeros
from ..physics.zero import Zero
from ..physics.zeroing import Zeroing, ZeroOutcome
from ..skin.cycles import Cycles
from ..untrusted import quoted
from ..wire.messages import CalibrationInUse, Event, Meta
from .foot import Foot
from .foot_pipeline import FootPipeline
from .foot_setup import FootSetup
from .state import zero_path

SECONDS = 3.0
SECONDS_LEAST, SECONDS_MOST = 0.5, 60.0


class ZeroingStep(Protocol):
    """The input of the operation in one iteration of the loop."""

    @property
    def now_mono_ns(self) -> int:
        """The current time on the clock of the frames."""
        ...

    @property
    def closed(self) -> Sequence[Cycles]:
        """The cycles of this foot that closed in this iteration."""
        ...


class LatchingPublisher(Protocol):
    """The part of a FootPublisher that the operation uses."""

    def publish(self, message: Event) -> None:
        """Publish an event."""

    def publish_latched(self, what: str, message: Meta | CalibrationInUse) -> None:
        """Publish a message and keep it for late joiners."""


def zero(
    foot: Foot,
    publisher: LatchingPublisher,
    seconds: float = SECONDS,
    force: bool = False,
    clock_ns: Callable[[], int] = time.time_ns,
) -> Generator[None, ZeroingStep, dict[str, Any]]:
    """Gather readings for `seconds`, then store and apply the zero; the reply has `ok`, or the reasons and taxels.

    On a refusal nothing is stored and nothing changes. Keys of the reply: see `_reply`.
    """
    zeroing = Zeroing(foot.layout, foot.calibration, foot.validity)
    step = yield
    until_ns = step.now_mono_ns + round(seconds * 1e9)
    while step.now_mono_ns < until_ns:
        step = yield
        for cycles in step.closed:
            zeroing.add(cycles)
    outcome = zeroing.outcome(clock_ns(), force)
    reply = _reply(foot, outcome)
    if outcome.zero is None:
        publisher.publish(Event(foot.name, clock_ns(), "zero_refused", "; ".join(outcome.refusals), []))
        return reply
    path = zero_path(foot.config.rig, foot.name)
    try:
        pipeline = yield from _stored(foot, outcome.zero, path)
    except OSError as error:
        why = f"{path}: cannot be written: {error.strerror or error}; the zero is not in use either"
        publisher.publish(Event(foot.name, clock_ns(), "zero_refused", why, []))
        return reply | {"ok": False, "refusals": [*reply["refusals"], why]}
    foot.replace_pipeline(pipeline)
    publisher.publish_latched("meta", foot.meta())
    publisher.publish_latched("calibration", foot.calibration_in_use())
    publisher.publish(
        Event(
            foot.name,
            clock_ns(),
            "zeroed",
            f"{reply['n_taxels']} taxels, baselines moved by {outcome.shift_count:+.2f} counts on average"
            + (f"; forced although {'; '.join(outcome.refusals)}" if outcome.refusals else ""),
            [],
        )
    )
    note = ""
    if foot.insole.zero is not None:
        note = (
            f"the configuration names {foot.insole.zero}, which the next start or reload will read: "
            f"copy {path} there, or remove `zero:` from the configuration"
        )
    return reply | {"stored": str(path), "note": note}


def zero_handler(
    foot: Foot, publisher: LatchingPublisher
) -> Callable[[dict[str, Any]], Generator[None, ZeroingStep, dict[str, Any]]]:
    """Return the handler of `zero` requests: `seconds` and `force` are optional; InsoleError for anything else."""

    def handle(request: dict[str, Any]) -> Generator[None, ZeroingStep, dict[str, Any]]:
        seconds, force = request.get("seconds", SECONDS), request.get("force", False)
        unknown = request.keys() - {"seconds", "force"}
        if unknown:
            raise InsoleError(f"zero: expected `seconds` and `force`, found {quoted(sorted(unknown))}")
        number = isinstance(seconds, (int, float)) and not isinstance(seconds, bool)
        if not number or not SECONDS_LEAST <= seconds <= SECONDS_MOST:
            raise InsoleError(f"zero: seconds: expected {SECONDS_LEAST:g} to {SECONDS_MOST:g}, found {quoted(seconds)}")
        if not isinstance(force, bool):
            raise InsoleError(f"zero: force: expected true or false, found {quoted(force)}")
        return zero(foot, publisher, float(seconds), force)

    return handle


def _reply(foot: Foot, outcome: ZeroOutcome) -> dict[str, Any]:
    """Return the reply; taxels are [board, triangle, taxel]."""
    n_taxels = int((outcome.zero.baseline_count >= 0).sum()) if outcome.zero is not None else 0
    return {
        "ok": outcome.zero is not None,
        "foot": foot.name,
        "refusals": list(outcome.refusals),  # sentences; with ok, it was forced
        "loaded": [list(taxel) for taxel in outcome.loaded],
        "noisy": [list(taxel) for taxel in outcome.noisy],
        "left_out": {reason: [list(taxel) for taxel in taxels] for reason, taxels in outcome.left_out.items()},
        "n_taxels": n_taxels,
        "shift_count": outcome.shift_count,
        "largest_shift_count": outcome.largest_shift_count,
        "noise_count": outcome.noise_count,
        "stored": None,  # the file
        "note": "",
    }


def _stored(foot: Foot, zero: Zero, path: Path) -> Generator[None, ZeroingStep, FootPipeline]:
    """Write the zero and return the pipeline that uses it; raises OSError if the file cannot be written."""
    while True:
        storing = _Storing(path, zero, foot.setup)
        while not storing.done:
            yield
        if storing.error is not None:
            raise storing.error
        assert storing.pipeline is not None
        if storing.pipeline.before is foot.setup:  # else a reload came in between, and is not to be undone
            return storing.pipeline


class _Storing:
    """Writes a zero and makes its pipeline in a thread, because either may take longer than a cycle."""

    def __init__(self, path: Path, zero: Zero, setup: FootSetup) -> None:
        self.error: Exception | None = None
        self.pipeline: FootPipeline | None = None
        self._job = path, zero, setup
        self._thread = threading.Thread(target=self._store, name="zero", daemon=True)
        self._thread.start()

    def _store(self) -> None:
        path, zero, setup = self._job
        try:
            pipeline = FootPipeline.of(setup.with_zero(zero, str(path)), setup)
            zeros.save(path, zero, setup.layout)
            self.pipeline = pipeline
        except Exception as error:  # reported in the reply
            self.error = error

    @property
    def done(self) -> bool:
        return not self._thread.is_alive()
