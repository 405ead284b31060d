"""Reload the configuration of a running daemon, as far as it can change between two cycles.

Reading the files and making pipelines of them takes longer than a cycle. A thread does both, and the loop takes the
complete result. A file that is refused changes nothing.
"""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .. import config as configs
from ..config import Config
from ..errors import InsoleError
from .foot_pipeline import FootPipeline
from .foot_setup import FootSetup, load_setups

_CHANGES_RUNNING = frozenset({"extensions", "contact", "publish", "insoles"})  # the last two only in part, see below
_PUBLISH_CHANGES_RUNNING = frozenset({"extensions", "stale_after_ms"})


@dataclass(frozen=True, slots=True)
class Reloaded:
    """The result of one reload: the new pipelines, or the reason why nothing changes."""

    before: tuple[FootSetup, ...]  # in use when the reload began
    pipelines: tuple[FootPipeline, ...] = ()  # that replace those in use; empty: nothing is replaced
    changed: tuple[str, ...] = ()
    needs_restart: tuple[str, ...] = ()  # what changed in the file and cannot change in a running daemon
    refused: str | None = None  # every problem of the files, one per line

    def events(self) -> list[tuple[str, str]]:
        """Return (kind, text) of the events that report the reload."""
        if self.refused is not None:
            return [("reload_refused", f"all stays as it was: {self.refused}")]
        events = [("reloaded", "changed: " + (", ".join(self.changed) or "nothing"))]
        if self.needs_restart:
            events.append(("restart_needed", "changed in the file, needs a restart: " + ", ".join(self.needs_restart)))
        return events


class Reloader:
    """Reads `path` again on request, in a thread; `take` returns each result once."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._thread: threading.Thread | None = None
        self._result: Reloaded | None = None

    @property
    def busy(self) -> bool:
        """Whether a reload runs or its result has not been taken yet."""
        return self._thread is not None

    def start(self, running: Sequence[FootSetup]) -> None:
        """Start reading, to replace the setups in use; must not be called while `busy`."""
        self._thread = threading.Thread(target=self._read, args=(tuple(running),), name="reload", daemon=True)
        self._thread.start()

    def take(self) -> Reloaded | None:
        """Return the result of the reload; None while it runs."""
        result = self._result
        if result is not None:
            self._result = self._thread = None
        return result

    def _read(self, running: tuple[FootSetup, ...]) -> None:
        try:
            if self._path is None:
                why = "there is nothing to read again, the daemon runs without --config"
                self._result = Reloaded(running, refused=why)
            else:
                self._result = merge(running, *read(self._path))
        except InsoleError as error:
            self._result = Reloaded(running, refused=str(error))
        except Exception as error:  # of whatever kind: the reload must be answered, and the old setups stay in use
            self._result = Reloaded(running, refused=f"{self._path}: cannot be read again: {error!r}")


def read(path: Path) -> tuple[Config, list[FootSetup]]:
    """Read the configuration and the setups of its feet; raises InsoleError with the problems of all files."""
    config = configs.load(path)
    return config, load_setups(config)


def merge(running: Sequence[FootSetup], asked: Config, asked_setups: Sequence[FootSetup]) -> Reloaded:
    """Return the `running` setups with every change in `asked` that can be made between two cycles.

    These are layouts of the same triangles, calibrations, zeros, the thresholds of contact and the age of staleness.
    """
    before = running[0].config
    asked_by_foot = {setup.insole.foot: setup for setup in asked_setups}
    needs_restart = _other_keys(before, asked)
    if asked_by_foot.keys() != {setup.insole.foot for setup in running}:
        needs_restart.append("insoles: another set of feet")
    chosen = []
    for old in running:
        new = asked_by_foot.get(old.insole.foot, old)
        why = _why_not(old, new)
        if why is not None:
            needs_restart.append(f"insoles: {old.insole.foot}: {why}")
            new = old
        chosen.append(new)
    config = replace(
        before,
        contact=asked.contact,
        publish=replace(before.publish, stale_after_ms=asked.publish.stale_after_ms),
        insoles=tuple(setup.insole for setup in chosen),
    )
    pipelines = tuple(
        FootPipeline.of(replace(new, config=config), old) for old, new in zip(running, chosen, strict=True)
    )
    changed = dict.fromkeys(what for pipeline in pipelines for what in _changes(pipeline))
    return Reloaded(tuple(running), pipelines, tuple(changed), tuple(needs_restart))


def _other_keys(before: Config, asked: Config) -> list[str]:
    """Return the keys that differ and need a restart: all that are not known to be safe to change."""
    keys = _differences("", before, asked, _CHANGES_RUNNING)
    return keys + _differences("publish.", before.publish, asked.publish, _PUBLISH_CHANGES_RUNNING)


def _differences(prefix: str, old: object, new: object, leave_out: frozenset[str]) -> list[str]:
    names = [field.name for field in dataclasses.fields(old)]  # type: ignore[arg-type]
    return [prefix + n for n in names if n not in leave_out and getattr(old, n) != getattr(new, n)]


def _why_not(old: FootSetup, new: FootSetup) -> str | None:
    """Return why the running foot cannot change to the new setup; None if it can."""
    if old.insole.boards != new.insole.boards:
        return "boards"
    if not np.array_equal(old.layout.identities, new.layout.identities):
        return "a layout of other triangles"
    return None


def _changes(pipeline: FootPipeline) -> list[str]:
    old, new = pipeline.before, pipeline.setup
    changes = [f"{what} of the {old.insole.foot} foot" for what in pipeline.differences]
    if old.insole.model != new.insole.model:
        changes.append(f"model of the {old.insole.foot} foot")
    changes += _differences("contact.", old.config.contact, new.config.contact, frozenset({"extensions"}))
    return changes + _differences("publish.", old.config.publish, new.config.publish, frozenset({"extensions"}))
