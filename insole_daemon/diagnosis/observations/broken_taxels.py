"""Detect taxels that do not work, and replace their readings by the mean of others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...physics.effect import Where
from ...physics.law import Array
from ...recording.loading import FootRecording
from ...skin.geometry import N_TAXELS
from ..audit import audit
from ..contact import at_both_ends
from ..finding import Finding
from ..places import place_of_triangles
from .fault_finding import make_fault_finding
from .hidden_faults import is_bit_constant, stuck_bit
from .wrench import LARGEST, WrenchObservation

CONTACT_FAULTS = ("open_triangle", "dead_taxels")  # findings of the audit that are used
MOST_VALID = 0.95  # of a triangle's readings while it is reported as open: above, it has only lost readings
MOST_RESTING_COUNT = 30.0  # activation that a shift of the baseline can hide
LEAST_WORKING_TAXELS = 3  # of a triangle, whose mean replaces its others
DONORS = 3  # nearest triangles that replace one with too few working taxels
MOST_CUT_OFF = 0.5  # of a taxel's readings, or of a triangle's cycles, at an end of their range


def detect_contact_faults(foot: FootRecording, seen: WrenchObservation) -> list[Finding]:
    """Return the findings of the audit on lost contact and dead taxels that the observation does not contradict."""
    audited = audit(foot, seen.name, steps=not seen.is_uniform)
    findings = [
        _without_resting_taxels(finding, seen)
        for finding in audited.findings
        if finding.effect in CONTACT_FAULTS and not _has_only_lost_readings(finding, foot, seen)
    ]
    return [finding for finding in findings if finding is not None]


def _without_resting_taxels(finding: Finding, seen: WrenchObservation) -> Finding | None:
    """Return a finding on dead taxels without those that a shift of the baseline explains, or None if none is left.

    Such a taxel stays at the unloaded end of its range, and its load is always small.
    """
    if finding.effect != "dead_taxels" or not seen.load_is_known or finding.where.scope != "taxel":
        return finding
    slots = np.asarray(finding.where.slots(seen.layout))
    count = _counts_of(seen, slots)
    most_expected = np.quantile(seen.expected_count.reshape(len(seen.t_s), -1)[:, slots], 0.99, axis=0)
    is_resting = (np.quantile(count, 0.01, axis=0) > LARGEST) & (most_expected < MOST_RESTING_COUNT)
    return _without(finding, is_resting)


def _counts_of(seen: WrenchObservation, slots: NDArray[np.intp]) -> Array:
    """Return the counts (N, k) of taxels."""
    return np.asarray((seen.calibration.baseline_count - seen.activation_count).reshape(len(seen.t_s), -1)[:, slots])


def without_zeroed_taxels(finding: Finding, seen: WrenchObservation, since_s: Mapping[int, float]) -> Finding | None:
    """Return a finding on dead taxels without those that a re-zero of their board moved beyond the end of their range.

    `since_s` has the times of re-zeros by board. Such a taxel worked until then. A finding on whole triangles or boards
    is left out if it is so of most of their taxels.
    """
    if finding.effect != "dead_taxels":
        return finding
    slots = np.asarray(finding.where.slots(seen.layout))
    slots = slots if finding.where.scope == "taxel" else slots[seen.usable.reshape(-1)[slots]]
    is_zeroed = np.zeros(len(slots), bool)
    for i, slot in enumerate(slots.tolist()):
        row, taxel = divmod(slot, N_TAXELS)
        # As they were read: rows have values interpolated between valid readings.
        readings, board = seen.readings[row], int(seen.layout.identities[row, 0])
        is_later = readings.t_s >= since_s.get(board, np.inf)
        is_at_end = readings.counts[:, taxel] > LARGEST
        is_zeroed[i] = is_later.any() and is_at_end[is_later].mean() > MOST_CUT_OFF > is_at_end[~is_later].mean()
    if finding.where.scope == "taxel":
        return _without(finding, is_zeroed)
    return None if is_zeroed.size and is_zeroed.mean() > MOST_CUT_OFF else finding


def _without(finding: Finding, is_left_out: NDArray[np.bool_]) -> Finding | None:
    """Return a finding on single taxels without some of them, or None if none is left."""
    kept_ids = tuple(identity for identity, out in zip(finding.where.ids, is_left_out.tolist(), strict=True) if not out)
    if len(kept_ids) == len(finding.where.ids):
        return finding
    return replace(finding, where=Where("taxel", kept_ids)) if kept_ids else None


def _has_only_lost_readings(finding: Finding, foot: FootRecording, seen: WrenchObservation) -> bool:
    """Return whether the readings that came from a triangle reported as open are valid: then frames were lost.

    Readings of an open line are constant and may count as repeats, so cycles in which all taxels are at an end of their
    range tell as much.
    """
    if finding.effect != "open_triangle" or not finding.when_s:
        return False
    identities = [tuple(identity) for identity in seen.layout.identities.tolist()]
    rows = [identities.index(identity[:2]) for identity in finding.where.ids]
    is_open = at_both_ends(foot.counts)[:, rows]
    if is_open[_is_during(finding, (foot.t_ns - foot.t_ns[0]) * 1e-9)].mean() > MOST_CUT_OFF:
        return False
    valid: list[float] = []
    for row in rows:
        readings = seen.readings[row]
        valid += readings.valid[_is_during(finding, readings.t_s)][:, seen.usable[row]].ravel().tolist()
    return not valid or float(np.mean(valid)) > MOST_VALID


def _is_during(finding: Finding, t_s: Array) -> NDArray[np.bool_]:
    """Return which of the times `t_s` (n,) are in an interval of the finding, (n,)."""
    return np.asarray(np.any([(t_s >= a) & (t_s <= b) for a, b in finding.when_s], axis=0))


def detect_stuck_bits(seen: WrenchObservation) -> list[Finding]:
    """Return a finding for each bit that never changes in the counts of some triangles."""
    bits = [stuck_bit(readings, usable) for readings, usable in zip(seen.readings, seen.usable, strict=True)]
    findings = []
    for bit in sorted({bit for bit in bits if bit is not None}):
        rows = [row for row, bit_of_row in enumerate(bits) if bit_of_row == bit]
        rows = _with_whole_boards(seen, rows, bit)
        text = f"bit {bit} of the counts never changes, although they pass both of its values: look at the digitiser"
        findings.append(make_fault_finding(seen, "unknown", place_of_triangles(rows, seen.layout), (), text))
    return findings


def _with_whole_boards(seen: WrenchObservation, rows: Sequence[int], bit: int) -> list[int]:
    """Return `rows`, completed to boards of which several triangles are among them and no other uses the bit."""
    chosen, boards = set(rows), seen.layout.identities[:, 0]
    for board in np.unique(boards[list(rows)]).tolist():
        of_board = np.flatnonzero((boards == board) & seen.usable.any(axis=1)).tolist()
        if len(chosen & set(of_board)) > 1 and all(
            row in chosen or is_bit_constant(seen.readings[row], seen.usable[row], bit) for row in of_board
        ):
            chosen |= set(of_board)
    return sorted(chosen)


def substitute_broken(
    seen: WrenchObservation, working: NDArray[np.bool_], substituted: NDArray[np.bool_]
) -> WrenchObservation:
    """Return `seen` with the mean of working taxels nearby in place of taxels that do not work.

    The mean is that of the triangle itself, or of the DONORS nearest if too few of its taxels work.
    """
    activation, is_replaced = seen.activation_count.copy(), np.zeros(len(substituted), bool)
    for row in np.flatnonzero(substituted).tolist():
        donors = [j for j in seen.nearest(row) if working[j].any()]
        is_replaced[row] = working[row].sum() < LEAST_WORKING_TAXELS
        others = [j for j in donors if j != row][:DONORS]
        donors = others if is_replaced[row] and others else [row]
        mean = np.mean([activation[:, j][:, working[j]].mean(axis=1) for j in donors], axis=0)
        activation[:, row][:, seen.usable[row] & ~working[row]] = mean[:, None]
    return replace(seen, activation_count=activation, is_wholly_substituted=is_replaced)
