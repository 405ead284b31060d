"""Detect faults that readings show by themselves: lost contact, dead taxels, lost frames, bursts of noise, leaps.

No row is deleted: faulty taxels are replaced by the mean of others, and noisy rows get a smaller weight.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...errors import DiagnosisError
from ...physics.law import Array
from ...recording.loading import FootRecording
from ..finding import Finding
from ..places import place_of_triangles
from .broken_taxels import detect_contact_faults, detect_stuck_bits, substitute_broken, without_zeroed_taxels
from .fault_finding import make_fault_finding
from .hidden_faults import common_variance_ratios, detect_pick_up
from .lost_frames import detect_lost_frames
from .noise_bursts import biased_in_bursts, detect_noise_bursts
from .paired import PairedObservation
from .reference_leaps import detect_reference_leaps
from .rezeros import correct_rezeros
from .shifted_boards import correct_bit_shifts
from .taxel_faults import OddTaxels, correct_taxels
from .wrench import WrenchObservation


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
    contact_faults = detect_contact_faults(foot, seen)
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
        if (remaining := without_zeroed_taxels(finding, as_read, since_s)) is not None
    ]
    broken_parts += detect_stuck_bits(seen)
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
    seen = substitute_broken(seen, working, substituted) if substituted.any() else seen
    before_shifts = seen
    seen, shifts = correct_bit_shifts(foot, seen, working)
    has_load = seen.field.known if isinstance(seen, PairedObservation) and seen.field is not None else True
    seen, odd_taxels = correct_taxels(seen, working & has_load)
    frame_loss = detect_lost_frames(seen, substituted, since_s)
    burst_ratio, bursts = detect_noise_bursts(seen)
    if bursts and seen.load_is_known:
        seen = replace(seen, missing=seen.missing | biased_in_bursts(seen, burst_ratio))
    pick_up_ratio, pick_up = _pick_up(seen)
    seen = replace(seen, noise_ratio=np.maximum(burst_ratio, pick_up_ratio))
    spikes, leaps = detect_reference_leaps(seen)
    findings = (*broken_parts, *rezeros, *shifts, *odd_taxels.findings, *frame_loss, *bursts, *pick_up, *leaps)
    explained = np.zeros(1 if seen.load_is_known else 3)
    explained[0] = sum(finding.explains for finding in findings)
    if shifts and not seen.load_is_known:
        explained[1:] = _error_removed(before_shifts, seen)[1:]
    return ReadingFaults(
        seen, substituted | is_estimated, findings, odd_taxels, spikes, explained + explained_by_unloaded
    )


def _error_removed(before: WrenchObservation, after: WrenchObservation) -> Array:
    """Return the decrease of the wrench's mean square error, (3,) N² and N²·m², at least 0; (1,) if nothing changed."""
    if after is before:
        return np.zeros(1)
    return np.maximum(before.mean_square_error - after.mean_square_error, 0.0)


def _pick_up(seen: WrenchObservation) -> tuple[Array, list[Finding]]:
    """Return the noise of triangles with electrical pick-up as a multiple of the usual (T,), and a finding."""
    calm, usual = np.array(
        [common_variance_ratios(readings, usable) for readings, usable in zip(seen.readings, seen.usable, strict=True)]
    ).T
    has_pick_up = detect_pick_up(calm)
    if not has_pick_up.any():
        return np.ones(len(calm)), []
    text = "all taxels swing at once, faster than the load: pick-up of the mains or of a motor, folded by the sampling"
    where = place_of_triangles(np.flatnonzero(has_pick_up).tolist(), seen.layout)
    return np.where(has_pick_up, np.sqrt(np.where(has_pick_up, usual, 1.0)), 1.0), [
        make_fault_finding(seen, "unknown", where, (), text)
    ]
