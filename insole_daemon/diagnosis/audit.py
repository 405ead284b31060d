"""Find taxels and triangles without contact from the readings, before any physics is fitted.

Only counts and flags of the cycles are used. The mean reading of the insole stands for the load, because the clock of
the reference is not known yet.

Readings are masked, not taxels: a taxel that was at an end of its range for a while, or whose triangle lost contact, is
used at other times.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from ..errors import DiagnosisError
from ..physics.effect import Where
from ..physics.law import Array
from ..recording.loading import FootRecording
from ..recording.read_times import arrived
from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS
from . import contact
from .contact import intervals, joined
from .finding import Finding
from .places import place_in_words, where

LEAST_CHANGE_RATE = 0.25  # of that of the most active taxels: slower ones carry little information on the load
MOST_DEAD = 0.3  # of the cycles without a usable reading: the taxel is reported as dead
LEAST_USABLE = 0.5  # share of the cycles in which a taxel works and is within its range; below it the taxel is not used
END_READINGS, END_CYCLES, MOST_AT_ENDS = 2, 15, 0.2  # readings at an end, cycles of the window, share of taxels
ALWAYS = 0.95  # of the time: reported as lasting for the whole recording
MOST_LEAPING = 0.5  # of the taxels: so many loose contacts are implausible
FROZEN = 0.9  # of its readings repeat the one before: the triangle is not connected


@dataclass(frozen=True, slots=True, eq=False)
class Audit:
    """Which readings are usable, and findings on the others."""

    usable_taxels: NDArray[np.bool_]  # (n_triangles, 12)
    usable_readings: NDArray[np.bool_]  # (n, n_triangles, 12)
    findings: tuple[Finding, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Readings:
    """The readings of one foot: n cycles, k triangles, s = 12 k slots."""

    foot: FootRecording
    name: str  # of the recording
    t_s: Array  # (n,)
    counts: Array  # (n, s)
    valid: NDArray[np.bool_]  # (n, s)
    in_use: NDArray[np.intp]  # (m,) slots of pressure taxels that are in use
    mean: Array  # (n,) load estimated from the insole's readings
    is_repeated: NDArray[np.bool_]  # (n, k) without a new reading
    dead: NDArray[np.bool_]  # (n, s) does not follow the load
    is_at_ends: NDArray[np.bool_]  # (n,) many taxels at an end of their range: their baselines drifted, they work

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Return which readings are new and of working taxels, (n, s)."""
        return self.valid & ~np.repeat(self.is_repeated, N_TAXELS, axis=1) & ~self.dead

    def finding(
        self, effect: str, place: Where | NDArray[np.intp], when: Iterable[tuple[float, float]], text: str
    ) -> Finding:
        """Return a finding of this recording with `text` on a place or on slots."""
        layout = self.foot.layout
        if not isinstance(place, Where):
            place = where(place, np.flatnonzero(np.tile(PRESSURE_TAXELS, len(layout))), layout)
        return Finding(
            effect=effect, foot=self.foot.foot, where=place, sentence=f"{place_in_words(place)}: {text}.",
            recordings=(self.name,), when_s=tuple(when),
        )  # fmt: skip


def audit(foot: FootRecording, name: str, steps: bool = False) -> Audit:
    """Audit the readings of one foot in recording `name`; `steps`: the load has steps, which are no faults.

    Raises DiagnosisError if most cycles have the same time as the one before.
    """
    if not np.median(np.diff(foot.t_ns)) > 0:
        raise DiagnosisError(
            f"{name}: most cycles of the {foot.foot} foot have the same time as the one before: the clock of the log "
            "stood still; record the trial again, with the times of the frames"
        )
    seen = _readings(foot, name, steps)
    gone, opened, findings = _without_contact(seen)
    gone |= _loose_contacts(seen, steps)
    findings += _dead_taxel_findings(seen, gone, opened)
    is_unusable = gone.copy()
    is_unusable[seen.in_use] |= (seen.valid & ~seen.dead)[~seen.is_at_ends][:, seen.in_use].mean(axis=0) < LEAST_USABLE
    usable_taxels = ~is_unusable.reshape(foot.valid.shape[1:]) & _taxels_in_use(foot)
    return Audit(usable_taxels, seen.usable.reshape(foot.valid.shape), tuple(findings))


def _readings(foot: FootRecording, name: str, steps: bool) -> _Readings:
    """Return the readings, with the properties that each taxel shows by itself."""
    n = len(foot)
    t_s = (foot.t_ns - foot.t_ns[0]) * 1e-9
    counts, valid = foot.counts.reshape(n, -1).astype(np.float64), foot.valid.reshape(n, -1)
    in_use = np.flatnonzero(_taxels_in_use(foot).ravel())
    mean_reading, is_repeated = _median_reading(counts[:, in_use]), ~foot.is_new
    dead = np.zeros(counts.shape, bool)
    dead[:, in_use] = contact.silent(counts[:, in_use], valid[:, in_use], t_s, mean_reading, in_use // N_TAXELS, steps)
    dead |= np.repeat(contact.at_both_ends(foot.counts), N_TAXELS, axis=1)
    n_received = arrived(foot.read_ns).sum(axis=0)
    frozen = foot.is_new.sum(axis=0) < (1.0 - FROZEN) * n_received
    if not frozen.all():  # otherwise the load never moved
        dead[:, in_use] |= frozen[in_use // N_TAXELS]
    return _Readings(
        foot, name, t_s, counts, valid, in_use, mean_reading, is_repeated, dead, _many_at_ends(counts[:, in_use])
    )


def _without_contact(seen: _Readings) -> tuple[NDArray[np.bool_], list[int], list[Finding]]:
    """Return taxels without usable readings (s,), rows of triangles that lost contact, and findings on these."""
    gone = seen.dead[~seen.is_at_ends].mean(axis=0) > MOST_DEAD
    # Readings at the upper end come from a drifted rest count, not from a missing triangle.
    silent = (seen.dead & (seen.counts < 255)).reshape(seen.foot.valid.shape)
    opened = contact.opened(silent, contact.at_both_ends(seen.counts.reshape(silent.shape)), seen.t_s)
    rows_by_times: dict[tuple[tuple[float, float], ...], list[int]] = {}
    for row in opened:
        slots = row * N_TAXELS + np.flatnonzero(PRESSURE_TAXELS)
        if gone[slots].sum() >= contact.OPEN_TAXELS:  # the readings of its other taxels are not usable either
            gone[slots] = True
        fails = np.asarray(silent[:, row].sum(axis=1) >= contact.OPEN_TAXELS)
        when = joined(intervals(fails, seen.t_s), 1.0) if fails.mean() < ALWAYS else ()
        rows_by_times.setdefault(when, []).append(row)
    findings = []
    for when, rows in rows_by_times.items():
        text = "lost contact: " + ("its taxels fail" if len(rows) == 1 else "the taxels of each fail") + " together"
        place = Where("triangle", tuple(tuple(identity) for identity in seen.foot.layout.identities[rows].tolist()))
        findings.append(seen.finding("open_triangle", place, when, text + ("" if when else ", all along")))
    return gone, opened, findings


def _loose_contacts(seen: _Readings, steps: bool) -> NDArray[np.bool_]:
    """Return which taxels have a loose contact, (s,)."""
    is_loose = np.zeros(seen.counts.shape[1], bool)
    in_use = seen.in_use
    leaping = contact.loose(
        seen.counts[:, in_use], seen.valid[:, in_use], seen.mean, seen.t_s, in_use // N_TAXELS, steps
    )
    if leaping.mean() < MOST_LEAPING:  # otherwise it is a property of the insole, not of its contacts
        is_loose[in_use] = leaping
    return is_loose


def _dead_taxel_findings(seen: _Readings, gone: NDArray[np.bool_], opened: Sequence[int]) -> list[Finding]:
    """Return the finding on taxels that are `gone` although their triangle has contact."""
    single = np.array([slot for slot in np.flatnonzero(gone) if slot // N_TAXELS not in opened], np.intp)
    if not single.size:
        return []
    when = intervals(np.asarray(seen.dead[:, single].any(axis=1)), seen.t_s)
    always = seen.dead[:, single].mean() > ALWAYS
    text = "say the same number while the load moves, leap, or say none that can be believed"
    return [seen.finding("dead_taxels", single, () if always else when, text)]


def _taxels_in_use(foot: FootRecording) -> NDArray[np.bool_]:
    """Return the taxels with pressure (n_triangles, 12): all ten of a triangle, or those in the calibration."""
    in_use = np.tile(PRESSURE_TAXELS, (len(foot.layout), 1))
    return in_use if foot.calibration is None else in_use & foot.calibration.usable


def _median_reading(counts: Array) -> Array:
    """Return the reading of a typical taxel over its range (n,); taxels that hardly change are left out."""
    change_rate = np.mean(np.diff(counts, axis=0) != 0, axis=0)
    median_count = np.median(counts[:, change_rate >= LEAST_CHANGE_RATE * np.quantile(change_rate, 0.95)], axis=1)
    span = float(np.ptp(median_count)) or 1.0
    share_of_span: Array = (median_count.max() - median_count) / span
    return share_of_span


def _many_at_ends(counts: Array) -> NDArray[np.bool_]:
    """Return cycles in which many taxels are so near an end of their range that their noise is clipped, (n,)."""
    at_end = uniform_filter1d(((counts <= 0) | (counts >= 255)).astype(np.float64), END_CYCLES, axis=0)
    is_cut_off: NDArray[np.bool_] = np.mean(at_end > (END_READINGS - 0.5) / END_CYCLES, axis=1) > MOST_AT_ENDS
    return is_cut_off if is_cut_off.mean() < 0.9 else np.zeros_like(is_cut_off)
