"""Checks through the running daemon: its version, its bus, and the boards with their firmware."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from ... import __version__
from ...config import Config
from ...errors import WireError
from ...wire.client import Client
from ...wire.messages import CalibrationInUse, Health, Meta
from .files import RESTART
from .finding import CheckResult, ok, problem, warning

_HEALTH_WITHIN_S = 3.0  # health is published once a second
_OLDEST_MTB = (2, 10, 16)  # first firmware with the commands 4D and 50, according to the robot's own host software


class Running:
    """The running daemon behind `endpoint`; None: no daemon runs, and only that is reported."""

    def __init__(self, settings: Config, endpoint: str | None, config_file: Path | None) -> None:
        self._settings, self._config_file = settings, config_file
        self._client = Client(endpoint, settings.rig, settings.zenoh.config_file) if endpoint is not None else None
        self._known: dict[str, tuple[Meta, CalibrationInUse]] = {}
        self._failed = ""

    def __enter__(self) -> Self:
        if self._client is not None:
            self._client.open()
            try:
                for _, foot in self._client.feet():
                    self._known[foot] = self._client.meta(foot), self._client.calibration(foot)
            except WireError as error:
                self._failed = str(error)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._client is not None:
            self._client.close()

    def meta(self, foot: str) -> tuple[Meta, CalibrationInUse] | None:
        """Return the setup and calibration that the daemon uses for `foot`; None if no daemon has the foot."""
        return self._known.get(foot)

    def findings(self) -> Iterator[CheckResult]:
        """Check the version of the daemon, its buses and its boards."""
        if self._client is None:
            run = "insole run" + (f" --config {self._config_file}" if self._config_file else "")
            yield warning(
                "daemon",
                f"none of rig {self._settings.rig} runs: boards, their versions and the bus cannot be looked at",
                f"{run}   # or: sudo systemctl start insole-daemon",
            )
            return
        if self._failed or not self._known:
            yield problem("daemon", self._failed or "it has just ended", RESTART)
            return
        for insole in self._settings.insoles:
            if insole.foot not in self._known:
                yield warning("daemon", f"has no {insole.foot} foot: it runs with another configuration", RESTART)
        version = next(iter(self._known.values()))[0].version
        if version != __version__:
            yield warning("daemon", f"is version {version}, this is {__version__}", RESTART)
        else:
            yield ok("daemon", f"runs, version {version}")
        yield from self._bus(self._client)
        with ThreadPoolExecutor(len(self._known)) as pool:
            for findings in pool.map(self._boards, self._known):
                yield from findings

    def _bus(self, client: Client) -> Iterator[CheckResult]:
        """Check the daemon's counters of its buses since its start."""
        healths = client.healths()
        end = threading.Timer(_HEALTH_WITHIN_S, healths.close)
        end.start()
        health: Health | None = next(healths, None)
        end.cancel()
        if health is None:
            yield problem("daemon", f"no health within {_HEALTH_WITHIN_S:g} s: it hangs", RESTART)
            return
        bus = health.bus
        if bus["overflows"]:
            yield warning(
                "bus",
                f"{bus['overflows']} frames lost to a full receive queue since the start",
                "raise net.core.rmem_max as above, or give the daemon more CPU (systemd/real-time.conf)",
            )
        if bus["error_frames"]:
            kinds = ", ".join(f"{count} {kind.replace('_', ' ')}" for kind, count in bus["error_frames"].items())
            yield warning("bus", f"error frames since the start: {kinds}", "check wiring, and 120 Ω at both ends")
        if bus["clock_steps"]:
            yield warning("clock", f"stepped {bus['clock_steps']} times since the daemon's start", "timedatectl")
        if not (bus["overflows"] or bus["error_frames"]):
            yield ok("bus", f"{bus['frames']} frames, none lost")

    def _boards(self, foot: str) -> list[CheckResult]:
        """Check the boards of one foot, which the daemon asks for their identity."""
        assert self._client is not None
        try:
            reply = self._client.request(foot, "boards", do="list")
        except WireError as error:
            return [problem(f"{foot} boards", str(error), RESTART)]
        configure = self._settings.boards.configure
        results = [result for board in reply["boards"] for result in judge_board(board, foot, configure)]
        results += [
            warning(
                f"board {stranger['address']}",
                f"{stranger['type']} answers, and is not in the configuration",
                f"config.yaml, under boards: - {{address: {stranger['address']}, interface: …}}   # or unplug it",
            )
            for stranger in reply["strangers"]
        ]
        return results


def judge_board(board: dict[str, Any], foot: str, configure: bool) -> Iterator[CheckResult]:
    """Check one board, by its entry in the reply to a `boards` request."""
    name, remedy = f"board {board['address']}", f"insole boards configure --foot {foot}"
    if not configure:
        remedy = f"config.yaml: boards: {{configure: true}}, then {remedy}"
    who = "not asked what it is (boards: {configure: false})"
    if board["type"] is not None:
        who = f"{board['type']} with firmware {board['firmware']}"
    elif configure:
        who = "does not say what it is"
    if board["bootloader"]:
        yield problem(
            name, f"{who}: only its bootloader runs", "load its firmware with the maker's tool; the daemon never does"
        )
        return
    if board["state"] != "streaming":
        yield problem(name, f"{who}; {board['state']}: is it powered and connected?", remedy)
        return
    if board["type"] == "MTB" and tuple(map(int, board["firmware"].split("."))) < _OLDEST_MTB:
        oldest = ".".join(map(str, _OLDEST_MTB))
        yield warning(
            name, f"{who}: older than {oldest}, it may not know its settings", "update it with the maker's tool"
        )
    if board["open_triangles"]:
        numbers = ", ".join(map(str, board["open_triangles"]))
        yield warning(name, f"triangle {numbers}: not connected", "check the flat cable of that triangle")
    if board["differences"]:
        yield warning(name, f"not as configured: {'; '.join(board['differences'])}", remedy)
    yield ok(name, f"{who}, sends {board['rate_hz']:.1f} Hz, new values {board['change_rate_hz']:.1f} Hz")
