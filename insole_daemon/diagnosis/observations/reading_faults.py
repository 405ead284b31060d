"""Detect faults that readings show by themselves: lost contact, dead taxels, lost frames, bursts of noise, leaps.

No row is deleted: faulty taxels are replaced by the mean of others, and noisy rows get a smaller weight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter, percentile_filter

from ...errors import DiagnosisError
from ...physics.effect import Where
from ...physics.law import Array
from ...recording.loading import FootRecording
from ...skin.geometry import N_TAXELS
from ..audit import audit
from ..contact import joined, stretches
from ..finding import Finding
from ..places import place_in_words
from .hidden_faults import common_variance_ratio, detect_pick_up, is_bit_constant, stuck_bit
from .paired import PairedObservation
from .reference_wrench import FINE_S
from .rezeros import correct_rezeros
from .shifted_boards import correct_bit_shifts
from .taxel_faults import OddTaxels, correct_taxels
from .wrench import LARGEST, WrenchObservation

CONTACT_FAULTS = ("open_triangle", "dead_taxels")  # findings of the audit that are used
MOST_VALID = 0.95  # of a triangle's readings while it is reported as open: above, it has only lost readings
REZERO_S = 0.1  # error of the time of a re-zero
USUAL_LOSS = 0.003  # of a triangle's readings, on a bus without a fault
LEAST_REPEATED = 0.005  # share of repeated readings that lost frames make
BURST_RATIO, CALM_QUANTILE = 2.0, 0.25  # a window's noise against the triangle's usual one; rows in the air
CALM_SHARE, LEAST_CALM_ROWS = 0.35, 4  # rows in which the load changes least, of all; smallest number in a window
USUAL_WINDOW_QUANTILE = 0.3  # of the windows: noise that is present half of the time is usual
LEAST_NOISE_COUNT = 0.5  # of a reading that toggles between two counts by rounding alone
WINDOW_S, LEAST_BURST_S, MOST_BURST = 1.5, 2.9, 0.75
SPIKE_SIGMAS, LEAST_SPIKES, LEAST_LEAPS = 9.0, 4, 3  # leaps: that no pressure could have
LEAP_ROWS = 3  # longest leap, in rows of the reference
COMPARABLE_LEAP = 0.5  # of the usual size: a leap while the insole's force changes
MOST_APART_S = 0.1  # between the clocks of readings and reference
MOST_RESTING_COUNT = 30.0  # activation that a shift of the baseline can hide
LEAST_WORKING_TAXELS = 3  # of a triangle, whose mean replaces its others
DONORS = 3  # nearest triangles that replace one with too few working taxels
JOINED_S = 1.0  # gap between two times that are reported as one
MOST_CUT_OFF = 0.5  # of a window's readings at an end of their range


@dataclass(frozen=True, slots=True, eq=False)
class ReadingFaults:
    """Faults of the readings, and the observation corrected for them."""

    observation: WrenchObservation
    substituted: NDArray[np.bool_]  # (T,) triangles with taxels whose readings or curves are those of others
    findings: tuple[Finding, ...]  # those of `odd_taxels` are among them
    odd_taxels: OddTaxels
    spikes: NDArray[np.bool_]  # (N,) rows in which the reference leaps
    explained: Array  # (1,) count² or (3,) N² and N²·m²: mean square error removed by corrections

    def weights_of(self, seen: WrenchObservation) -> Array:
        """Return one over the standard deviation of a row (N, c) of `seen` in each channel; 0 if unknown."""
        variance = np.where(self.spikes[:, None], np.inf, seen.weight_variance)
        weights = np.asarray(np.where(np.isfinite(variance), variance, np.inf) ** -0.5)
        if seen.load_is_known:  # channels are triangles
            weights[:, self.substituted] = 0.0
        return weights


def reading_faults(foot: FootRecording, seen: WrenchObservation) -> ReadingFaults:
    """Return the faults of the readings of `foot`, and the observation `seen` corrected for them.

    Raises DiagnosisError if no taxel works.
    """
    contact_faults = _contact_faults(foot, seen)
    as_read = seen
    seen, rezeros = correct_rezeros(foot, seen)
    with_negative_load = seen
    if not seen.load_is_known:
        seen = seen.with_unloaded()
    explained_by_unloaded = _error_removed(with_negative_load, seen)
    # A board that was zeroed under load reads as if nothing were connected until the load is higher.
    since_s = {finding.where.ids[0][0]: finding.when_s[0][0] for finding in rezeros}
    broken_parts = [
        remaining
        for finding in contact_faults
        if finding.effect != "open_triangle" or finding.where.ids[0][0] not in since_s
        if (remaining := _without_zeroed_taxels(finding, as_read, since_s)) is not None
    ]
    broken_parts += _stuck_bit_findings(seen)
    is_broken = np.zeros_like(seen.usable)
    for finding in broken_parts:
        is_broken.reshape(-1)[finding.where.slots(seen.layout)] = True
    is_broken &= seen.usable
    is_estimated = np.zeros(len(is_broken), bool) if seen.is_estimated is None else seen.is_estimated
    working = seen.usable & ~is_broken & ~is_estimated[:, None]
    if not working.any():
        raise DiagnosisError(
            f"{seen.name}: no taxel of the {seen.layout.foot} foot works: the readings of each are constant, those of "
            "an open contact, or not valid; insole doctor checks the boards"
        )
    substituted = np.asarray(is_broken.any(axis=1))
    seen = _substitute(seen, working, substituted) if substituted.any() else seen
    before_shifts = seen
    seen, shifts = correct_bit_shifts(foot, seen, working)
    has_load = seen.field.known if isinstance(seen, PairedObservation) and seen.field is not None else True
    seen, odd_taxels = correct_taxels(seen, working & has_load)
    frame_loss = _frame_loss(seen, substituted, since_s)
    burst_ratio, bursts = _bursts(seen)
    pick_up_ratio, pick_up = _pick_up(seen)
    seen = replace(seen, noise_ratio=np.maximum(burst_ratio, pick_up_ratio))
    spikes, leaps = _spikes(seen)
    findings = (*broken_parts, *rezeros, *shifts, *odd_taxels.findings, *frame_loss, *bursts, *pick_up, *leaps)
    explained = np.zeros(1 if seen.load_is_known else 3)
    explained[0] = sum(finding.explains for finding in findings)
    if shifts and not seen.load_is_known:
        explained[1:] = _error_removed(before_shifts, seen)[1:]
    return ReadingFaults(
        seen, substituted | is_estimated, findings, odd_taxels, spikes, explained + explained_by_unloaded
    )


def _contact_faults(foot: FootRecording, seen: WrenchObservation) -> list[Finding]:
    """Return the findings of the audit on lost contact and dead taxels that the observation does not contradict."""
    audited = audit(foot, seen.name, steps=not seen.is_uniform)
    findings = [
        _without_resting_taxels(finding, seen)
        for finding in audited.findings
        if finding.effect in CONTACT_FAULTS and not _has_only_lost_readings(finding, seen)
    ]
    return [finding for finding in findings if finding is not None]


def _error_removed(before: WrenchObservation, after: WrenchObservation) -> Array:
    """Return the decrease of the wrench's mean square error, (3,) N² and N²·m², at least 0; (1,) if nothing changed."""
    if after is before:
        return np.zeros(1)
    return np.maximum(before.mean_square_error - after.mean_square_error, 0.0)


def _stuck_bit_findings(seen: WrenchObservation) -> list[Finding]:
    """Return a finding for each bit that never changes in the counts of some triangles."""
    bits = [stuck_bit(readings, usable) for readings, usable in zip(seen.readings, seen.usable, strict=True)]
    findings = []
    for bit in sorted({bit for bit in bits if bit is not None}):
        rows = [row for row, bit_of_row in enumerate(bits) if bit_of_row == bit]
        rows = _with_whole_boards(seen, rows, bit)
        text = f"bit {bit} of the counts never changes, although they pass both of its values: look at the digitiser"
        findings.append(_finding(seen, "unknown", _triangles(seen, rows), (), text))
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


def _pick_up(seen: WrenchObservation) -> tuple[Array, list[Finding]]:
    """Return the noise of triangles with electrical pick-up as a multiple of the usual (T,), and a finding."""
    ratios = np.array(
        [common_variance_ratio(readings, usable) for readings, usable in zip(seen.readings, seen.usable, strict=True)]
    )
    has_pick_up = detect_pick_up(ratios)
    if not has_pick_up.any():
        return np.ones(len(ratios)), []
    text = "all taxels swing at once, faster than the load: pick-up of the mains or of a motor, folded by the sampling"
    where = _triangles(seen, np.flatnonzero(has_pick_up).tolist())
    return np.where(has_pick_up, np.sqrt(np.where(has_pick_up, ratios, 1.0)), 1.0), [
        _finding(seen, "unknown", where, (), text)
    ]


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


def _without_zeroed_taxels(finding: Finding, seen: WrenchObservation, since_s: Mapping[int, float]) -> Finding | None:
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


def _counts_of(seen: WrenchObservation, slots: NDArray[np.intp]) -> Array:
    """Return the counts (N, k) of taxels."""
    return np.asarray((seen.calibration.baseline_count - seen.activation_count).reshape(len(seen.t_s), -1)[:, slots])


def _without(finding: Finding, is_left_out: NDArray[np.bool_]) -> Finding | None:
    """Return a finding on single taxels without some of them, or None if none is left."""
    kept_ids = tuple(identity for identity, out in zip(finding.where.ids, is_left_out.tolist(), strict=True) if not out)
    if len(kept_ids) == len(finding.where.ids):
        return finding
    return replace(finding, where=Where("taxel", kept_ids)) if kept_ids else None


def _has_only_lost_readings(finding: Finding, seen: WrenchObservation) -> bool:
    """Return whether the readings that came from a triangle reported as open are valid: then frames were lost."""
    if finding.effect != "open_triangle" or not finding.when_s:
        return False
    identities = [tuple(identity) for identity in seen.layout.identities.tolist()]
    valid: list[float] = []
    for row in (identities.index(identity[:2]) for identity in finding.where.ids):
        readings = seen.readings[row]
        during = np.any([(readings.t_s >= a) & (readings.t_s <= b) for a, b in finding.when_s], axis=0)
        valid += readings.valid[during][:, seen.usable[row]].ravel().tolist()
    return not valid or float(np.mean(valid)) > MOST_VALID


def _substitute(
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


def _finding(
    seen: WrenchObservation, effect: str, where: Where, when_s: Sequence[tuple[float, float]], text: str
) -> Finding:
    """Return a finding of an effect without parameters, with `text` on its place."""
    return Finding(
        effect=effect, foot=seen.layout.foot, where=where, sentence=f"{place_in_words(where)}: {text}.",
        recordings=(seen.name,), when_s=tuple(when_s),
    )  # fmt: skip


def _frame_loss(seen: WrenchObservation, substituted: NDArray[np.bool_], since_s: Mapping[int, float]) -> list[Finding]:
    """Return the finding on triangles whose readings are missing, or repeat the reading before.

    `since_s` has the times of re-zeros by board, which may send nothing meanwhile.
    """
    rows, shares = [], []
    gaps_s: list[tuple[float, float]] = []
    for row, readings in enumerate(seen.readings):
        if len(readings.t_s) < 50 or substituted[row]:
            continue
        steps = np.diff(readings.t_s)
        rezero_s = since_s.get(int(seen.layout.identities[row, 0]), np.inf)
        is_zeroing = (readings.t_s[:-1] < rezero_s + REZERO_S) & (readings.t_s[1:] > rezero_s - REZERO_S)
        missing = np.where(is_zeroing, 0.0, np.maximum(np.rint(steps / readings.period_s) - 1, 0))
        share = float(missing.sum() / (len(steps) + missing.sum()))
        repeats = (
            readings.held_fraction
            if readings.held_fraction > LEAST_REPEATED and not readings.is_converter_slow
            else 0.0
        )
        if max(share, repeats) > USUAL_LOSS:
            rows.append(row)
            shares.append(max(share, repeats))
            if not gaps_s:
                gaps_s = [(float(readings.t_s[k]), float(readings.t_s[k + 1])) for k in np.flatnonzero(missing)]
    if not rows:
        return []
    where = _triangles(seen, rows)
    is_frequent = len(gaps_s) > 40 or sum(b - a for a, b in gaps_s) > 0.5 * float(np.ptp(seen.t_s))
    text = f"{np.mean(shares):.1%} of the readings did not come, or came again unchanged"
    return [_finding(seen, "frame_loss", where, () if is_frequent else joined(gaps_s, JOINED_S), text)]


def _triangles(seen: WrenchObservation, rows: Sequence[int]) -> Where:
    """Return the coarsest place that consists of the triangles `rows`."""
    identities = [tuple(identity) for identity in seen.layout.identities.tolist()]
    if len(rows) >= 0.9 * len(identities):
        return Where()
    boards = sorted({identities[row][0] for row in rows})
    of_boards = [row for row, identity in enumerate(identities) if identity[0] in boards]
    if len(rows) >= 0.9 * len(of_boards):
        return Where("board", tuple((board,) for board in boards))
    return Where("triangle", tuple(identities[row] for row in rows))


def _bursts(seen: WrenchObservation) -> tuple[Array, list[Finding]]:
    """Return the noise of each triangle's readings as a multiple of its usual noise, (N, T), and a finding on bursts.

    Noise is the RMS of third differences, which contain hardly any load, in windows of WINDOW_S.
    """
    noise_ratio = np.ones(seen.missing.shape)
    window_rows = max(round(WINDOW_S / seen.step_s), 8)
    n_windows = len(seen.t_s) // window_rows
    if n_windows < 8:
        return noise_ratio, []
    third_difference = np.zeros_like(seen.activation_count)
    third_difference[1:-2] = np.diff(seen.activation_count, n=3, axis=0) / np.sqrt(20.0)
    taxels = np.maximum(seen.usable.sum(axis=1), 1)
    rms_difference = np.sqrt(np.sum(third_difference**2 * seen.usable, axis=2) / taxels)
    is_calm = _calm_rows(seen, third_difference, n_windows, window_rows)
    noise_level = _calm_level(rms_difference, is_calm)
    late_level = _calm_level(_change_in_half_a_period(seen), is_calm)
    # Readings at an end of the range have no noise, so the usual noise would pass for a burst beside them.
    is_cut_off = (seen.clipped | seen.missing)[: n_windows * window_rows].reshape(n_windows, window_rows, -1).mean(
        axis=1
    ) > MOST_CUT_OFF
    heard_level = np.where(is_cut_off, np.nan, noise_level)
    usual_level = np.where(is_cut_off.all(axis=0), np.inf, np.maximum(_usual_level(heard_level), LEAST_NOISE_COUNT))
    noise_level = np.where(is_cut_off, 0.0, noise_level)
    is_loud = noise_level > np.hypot(BURST_RATIO * usual_level, late_level)
    is_loud &= median_filter(is_loud.astype(np.uint8), (3, 1), mode="nearest") > 0
    share = is_loud.mean(axis=0)
    has_bursts = (share * n_windows * window_rows * seen.step_s >= LEAST_BURST_S) & (share < MOST_BURST)
    is_loud &= has_bursts
    window_ratio = np.where(is_loud, noise_level / usual_level, 1.0)
    noise_ratio[: n_windows * window_rows] = np.repeat(window_ratio, window_rows, axis=0)
    # A burst may begin and end within a window, so its neighbours count as noisy, too.
    noise_ratio = maximum_filter1d(noise_ratio, 2 * (window_rows // 2) + 1, axis=0)
    if not has_bursts.any():
        return noise_ratio, []
    edges = np.flatnonzero(np.diff(is_loud.any(axis=1).astype(int), prepend=0, append=0)).reshape(-1, 2)
    when = [
        (float(seen.t_s[a * window_rows]), float(seen.t_s[min(b * window_rows, len(seen.t_s) - 1)])) for a, b in edges
    ]
    text = f"readings scatter {np.median(window_ratio[is_loud]):.1f} times as much as usual for a while"
    where = _triangles(seen, np.flatnonzero(has_bursts).tolist())
    return noise_ratio, [_finding(seen, "noise_burst", where, when, text)]


def _change_in_half_a_period(seen: WrenchObservation) -> Array:
    """Return the change (N, T) of the readings in half of their period: what an error of their times looks like."""
    mean_count = np.sum(seen.activation_count * seen.usable, axis=2) / np.maximum(seen.usable.sum(axis=1), 1)
    change = np.zeros_like(mean_count)
    change[2:-2] = np.abs(mean_count[4:] - mean_count[:-4]) / (4.0 * seen.step_s)
    period_s = np.where(np.isfinite(seen.period_s), seen.period_s, seen.step_s)
    return np.asarray(0.5 * period_s * change)


def _calm_rows(seen: WrenchObservation, third_difference: Array, n_windows: int, window_rows: int) -> NDArray[np.bool_]:
    """Return the rows (n, m) of windows in which the load is calm: most triangles hardly change."""
    taxels = np.maximum(seen.usable.sum(axis=1), 1)
    median_change = np.median(np.abs(np.sum(third_difference * seen.usable, axis=2)) / taxels, axis=1)
    is_calm = median_change <= np.quantile(median_change, CALM_SHARE)
    return np.asarray(is_calm[: n_windows * window_rows].reshape(n_windows, window_rows))


def _calm_level(course: Array, is_calm: NDArray[np.bool_]) -> Array:
    """Return the level (n, T) of `course` (N, T) in n windows, from the rows that are calm (n, m).

    In a window with few such rows a low quantile of all rows is used: an edge of the load takes a few rows, a burst all
    of them.
    """
    windows = course[: is_calm.size].reshape(*is_calm.shape, -1)
    level = np.quantile(windows, CALM_QUANTILE, axis=1)
    for k in np.flatnonzero(is_calm.sum(axis=1) >= LEAST_CALM_ROWS):
        level[k] = np.median(windows[k, is_calm[k]], axis=0)
    return np.asarray(level)


def _usual_level(values: Array) -> Array:
    """Return a low quantile (m,) of each column of (n, m), without NaN; 0 for a column of NaN."""
    is_finite = np.isfinite(values)
    return np.array(
        [
            np.quantile(column[finite], USUAL_WINDOW_QUANTILE) if finite.any() else 0.0
            for column, finite in zip(values.T, is_finite.T, strict=True)
        ]
    )


def _leap_finding(seen: WrenchObservation) -> list[Finding]:
    """Return the finding on a reference whose leaps were left out, if there are enough."""
    leaps_s = [
        tuple((edge_s - seen.offset_s) / (1.0 + seen.rate) for edge_s in leap) for leap in seen.reference.leaps_s
    ]
    if len(leaps_s) < LEAST_LEAPS:
        return []
    text = f"the reference leaps for a moment, {len(leaps_s)} times"
    return [_finding(seen, "reference_fault", Where(), joined([(a, b) for a, b in leaps_s], JOINED_S)[:40], text)]


def _spikes(seen: WrenchObservation) -> tuple[NDArray[np.bool_], list[Finding]]:
    """Return the rows (N,) in which the reference leaps and the insole does not, and the finding on them.

    A leap lasts a few rows of the reference and deviates from their median by far more than noise and neighbouring rows
    do. At a heel strike the insole's force changes, too. A reference that leaps elsewhere also leaps there: a row that
    deviates as much as the clear ones do, from the insole as well, is one of them.
    """
    if isinstance(seen, PairedObservation):
        return np.zeros(len(seen.t_s), bool), []  # a simulation does not leap
    if seen.load_is_known:
        return np.zeros(len(seen.t_s), bool), _leap_finding(seen)
    width_rows = max(round(LEAP_ROWS * seen.reference.row_s / FINE_S), 1) * 2 + 1
    fine = seen.reference.fine
    deviation = np.abs(fine - median_filter(fine, (width_rows, 1), mode="nearest"))
    usual_deviation = percentile_filter(deviation, 90, (4 * width_rows + round(0.5 / FINE_S) | 1, 1))
    is_leap = (deviation > SPIKE_SIGMAS * seen.reference.noise) & (deviation > 4.0 * usual_deviation)
    # A change of the insole's force about the same time is a heel strike; the clocks may differ by MOST_APART_S.
    near_rows = max(round(MOST_APART_S / seen.step_s), 2)
    insole_range = np.ptp(
        sliding_window_view(np.pad(seen.wrench, ((near_rows, near_rows), (0, 0)), "edge"), 2 * near_rows + 1, 0),
        axis=-1,
    )
    fine_row = np.clip(np.rint(seen.reference_s / FINE_S), 0, len(fine) - 1).astype(np.intp)
    steps = max(round(seen.step_s / FINE_S), 1)
    leap_size = maximum_filter1d(np.where(is_leap, deviation, 0.0), steps, axis=0)[fine_row]
    residual = np.abs(seen.reference.at(seen.reference_s) - seen.wrench)
    residual_nearby = np.sort(np.stack([np.roll(residual, k, axis=0) for k in (-3, -2, 2, 3)]), axis=0)[2]
    is_alone = leap_size > 2.0 * residual_nearby
    spikes = np.any(is_alone & (leap_size > insole_range), axis=1)
    if len(stretches(spikes)) < LEAST_SPIKES:
        return np.zeros(len(spikes), bool), []
    usual_size = np.median(leap_size[spikes], axis=0)
    spikes |= np.any(is_alone & (np.minimum(leap_size, 2.0 * residual) > COMPARABLE_LEAP * usual_size), axis=1)
    times_s = [(float(t), float(t + seen.step_s)) for t in seen.t_s[spikes]]
    text = f"the reference leaps for a moment, {len(stretches(spikes))} times"
    return spikes, [_finding(seen, "reference_fault", Where(), joined(times_s, JOINED_S)[:40], text)]
