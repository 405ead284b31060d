"""Taxels and triangles without a contact: told from the readings themselves, before any physics.

Everything is told from the counts and the cycles' own flags. The mean of the insole's readings stands for the load
here: the reference's clock is not known yet.

What is masked is readings, not taxels: one that stood at an end of its range for a while, or whose triangle had lost
contact, is believed elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from ..physics.effect import Where
from ..physics.law import Array
from ..recording.loading import FootRecording
from ..recording.read_times import arrived
from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS
from . import contact
from .contact import intervals, joined
from .finding import Finding
from .places import said, where

TALKS = 0.25  # as often as the liveliest taxels do: one that changes more seldom tells little of the load
MOST_DEAD = 0.3  # of its cycles without a reading that can be believed: the taxel is called dead
LEAST_BELIEVED = 0.5  # of its cycles in which it works and is within its range: less, and it is left out
RAIL_READINGS, RAIL_CYCLES, MOST_ON_RAILS = 2, 15, 0.2  # at an end, of how many cycles, of how many taxels
ALWAYS = 0.95  # of the time: from beginning to end
MOST_LEAPING = 0.5  # of the taxels: as many loose contacts there are not
FROZEN = 0.9  # of its readings repeat the one before: the triangle is not there, whatever it says


@dataclass(frozen=True, slots=True, eq=False)
class Audit:
    """Which readings have a contact behind them, and what was found out about the others."""

    kept: NDArray[np.bool_]  # (n_triangles, 12)
    believed: NDArray[np.bool_]  # (n, n_triangles, 12) readings
    findings: tuple[Finding, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Readings:
    """Of one foot in n cycles: k triangles of twelve slots, s slots in all."""

    foot: FootRecording
    name: str  # of the recording
    t_s: Array  # (n,)
    counts: Array  # (n, s)
    valid: NDArray[np.bool_]  # (n, s)
    asked: NDArray[np.intp]  # (m,) slots that have pressure to tell
    mean: Array  # (n,) the load, as the insole tells it
    old: NDArray[np.bool_]  # (n, k) nothing new was read
    dead: NDArray[np.bool_]  # (n, s) says nothing of the load
    railed: NDArray[np.bool_]  # (n,) many at an end of their range: the rest counts have wandered off, not the taxels

    @property
    def believed(self) -> NDArray[np.bool_]:
        """(n, s) readings that are new, of taxels that work."""
        return self.valid & ~np.repeat(self.old, N_TAXELS, axis=1) & ~self.dead

    def finding(
        self, effect: str, place: Where | NDArray[np.intp], when: Iterable[tuple[float, float]], text: str
    ) -> Finding:
        """Of the recording: `text` about a place, or about slots."""
        layout = self.foot.layout
        if not isinstance(place, Where):
            place = where(place, np.flatnonzero(np.tile(PRESSURE_TAXELS, len(layout))), layout)
        return Finding(
            effect=effect, foot=self.foot.foot, where=place, sentence=f"{said(place)}: {text}.",
            recordings=(self.name,), when_s=tuple(when),
        )  # fmt: skip


def audit(foot: FootRecording, name: str, steps: bool = False) -> Audit:
    """The readings of one foot in recording `name`; `steps`: it is walked on, and leaps that stay are none."""
    seen = _readings(foot, name)
    gone, opened, findings = _without_contact(seen)
    gone |= _leaping(seen, steps)
    findings += _alone(seen, gone, opened)
    unfit = gone.copy()
    unfit[seen.asked] |= (seen.valid & ~seen.dead)[~seen.railed][:, seen.asked].mean(axis=0) < LEAST_BELIEVED
    kept = ~unfit.reshape(foot.valid.shape[1:]) & _asked(foot)
    return Audit(kept, seen.believed.reshape(foot.valid.shape), tuple(findings))


def _readings(foot: FootRecording, name: str) -> _Readings:
    """The readings with what is told of each by itself."""
    n = len(foot)
    t_s = (foot.t_ns - foot.t_ns[0]) * 1e-9
    counts, valid = foot.counts.reshape(n, -1).astype(np.float64), foot.valid.reshape(n, -1)
    asked = np.flatnonzero(_asked(foot).ravel())
    mean, old = _insole(counts[:, asked]), ~foot.is_new
    dead = np.zeros(counts.shape, bool)
    dead[:, asked] = contact.silent(counts[:, asked], valid[:, asked], t_s, mean)
    dead |= np.repeat(contact.at_both_ends(foot.counts), N_TAXELS, axis=1)
    came = arrived(foot.read_ns).sum(axis=0)
    frozen = foot.is_new.sum(axis=0) < (1.0 - FROZEN) * came
    if not frozen.all():  # else the load never moved
        dead[:, asked] |= frozen[asked // N_TAXELS]
    return _Readings(foot, name, t_s, counts, valid, asked, mean, old, dead, _on_rails(counts[:, asked]))


def _without_contact(seen: _Readings) -> tuple[NDArray[np.bool_], list[int], list[Finding]]:
    """(s,) taxels that say nothing for long, rows of triangles that lost contact, and what is told of these."""
    gone = seen.dead[~seen.railed].mean(axis=0) > MOST_DEAD
    # Readings at the upper end are a rest count that has wandered off, not a line without a triangle.
    silent = (seen.dead & (seen.counts < 255)).reshape(seen.foot.valid.shape)
    opened = contact.opened(silent, contact.at_both_ends(seen.counts.reshape(silent.shape)), seen.t_s)
    together: dict[tuple[tuple[float, float], ...], list[int]] = {}
    for row in opened:
        slots = row * N_TAXELS + np.flatnonzero(PRESSURE_TAXELS)
        if gone[slots].sum() >= contact.OPEN_TAXELS:  # what its last taxels say is not to be believed either
            gone[slots] = True
        fails = np.asarray(silent[:, row].sum(axis=1) >= contact.OPEN_TAXELS)
        when = joined(intervals(fails, seen.t_s), 1.0) if fails.mean() < ALWAYS else ()
        together.setdefault(when, []).append(row)
    findings = []
    for when, rows in together.items():
        text = "lost contact: " + ("its taxels fail" if len(rows) == 1 else "the taxels of each fail") + " together"
        place = Where("triangle", tuple(tuple(identity) for identity in seen.foot.layout.identities[rows].tolist()))
        findings.append(seen.finding("open_triangle", place, when, text + ("" if when else ", all along")))
    return gone, opened, findings


def _leaping(seen: _Readings, steps: bool) -> NDArray[np.bool_]:
    """(s,) taxels with a loose contact."""
    found = np.zeros(seen.counts.shape[1], bool)
    asked = seen.asked
    leaping = contact.loose(seen.counts[:, asked], seen.valid[:, asked], seen.mean, seen.t_s, asked // N_TAXELS, steps)
    if leaping.mean() < MOST_LEAPING:  # else it is how this insole answers, and no contact
        found[asked] = leaping
    return found


def _alone(seen: _Readings, gone: NDArray[np.bool_], opened: Sequence[int]) -> list[Finding]:
    """What is told of taxels that are `gone` without their triangle."""
    lone = np.array([slot for slot in np.flatnonzero(gone) if slot // N_TAXELS not in opened], np.intp)
    if not lone.size:
        return []
    when = intervals(np.asarray(seen.dead[:, lone].any(axis=1)), seen.t_s)
    always = seen.dead[:, lone].mean() > ALWAYS
    text = "say the same number while the load moves, leap, or say none that can be believed"
    return [seen.finding("dead_taxels", lone, () if always else when, text)]


def _asked(foot: FootRecording) -> NDArray[np.bool_]:
    """(n_triangles, 12) taxels that have pressure to tell: all ten of a triangle, or what a calibration lists."""
    asked = np.tile(PRESSURE_TAXELS, (len(foot.layout), 1))
    return asked if foot.calibration is None else asked & foot.calibration.usable


def _insole(counts: Array) -> Array:
    """(n,) what a typical taxel says, over its range; most of an insole may not be there, and say one number."""
    often = np.mean(np.diff(counts, axis=0) != 0, axis=0)
    middle = np.median(counts[:, often >= TALKS * np.quantile(often, 0.95)], axis=1)
    span = float(np.ptp(middle)) or 1.0
    found: Array = (middle.max() - middle) / span
    return found


def _on_rails(counts: Array) -> NDArray[np.bool_]:
    """(n,) cycles in which many taxels stand so near an end of their range that it cuts their noise off."""
    at_end = uniform_filter1d(((counts <= 0) | (counts >= 255)).astype(np.float64), RAIL_CYCLES, axis=0)
    cut: NDArray[np.bool_] = np.mean(at_end > (RAIL_READINGS - 0.5) / RAIL_CYCLES, axis=1) > MOST_ON_RAILS
    return cut if cut.mean() < 0.9 else np.zeros_like(cut)
