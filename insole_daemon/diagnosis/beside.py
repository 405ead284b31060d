"""What is found beside the physics of a load: clocks, jumps, and what recalibration removes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..physics.calibration import Calibration
from ..physics.effects import laws
from ..physics.law import Array
from ..skin.geometry import N_TAXELS
from .deciding import unexplained
from .explained import Insole
from .finding import Finding, Quantity
from .fit import Hypothesis
from .groups import LEAST_EXCESS, Located, Named
from .handed_in import Component, absorbed, activation, listed
from .jumps import Jump
from .modelling import Curves
from .observed import Observed
from .places import merged, said, where
from .reference_faults import WORD as REFERENCE
from .reference_faults import Fault
from .static import Change, changes, compare

MOST_RATE = 1e-4  # a clock's rate error from which on it is a finding: the format's
SIGMAS = 3.0
LEAST_MOVED = 0.25  # of a reading's noise, RMS
LEAST_LATE_S = 0.05  # that it makes by the end, at the least
LEAST_IN_TIME = 0.25  # of the taxels
LEAST_TAXELS = 8  # fewer have no moment of their own: they are loose
LEAST_OFFSET_S = 0.1  # of a reference whose rows were to go with the cycles


def of_jumps(insole: Insole, observed: Sequence[Observed], found: Sequence[Sequence[Jump]]) -> list[Finding]:
    """Boards that took their baselines anew."""
    findings = []
    for each, own in zip(observed, found, strict=True):
        for jump in own:
            slots = each.slots[np.isin(each.layout.identities[:, 0][each.slots // N_TAXELS], jump.boards)]
            place = where(slots, each.slots, each.layout)
            findings.append(
                Finding(
                    effect="rezero", foot=insole.foot, where=place, recordings=(each.name,),
                    when_s=((jump.t_s, float(each.t_s[-1])),), equation=laws()["rezero"].equation,
                    parameters={
                        "t_s": Quantity(jump.t_s, 0.05, "s"),
                        "shift_count": Quantity(jump.shift_count, 0.1, "count"),
                    },
                    explains=len(slots) / len(each.slots) * jump.shift_count**2 / 4,
                    sentence=f"{said(place)} took its baselines anew at {jump.t_s:.1f} s: "
                    f"{jump.shift_count:+.1f} counts since.",
                )
            )  # fmt: skip
    return findings


def of_spikes(insole: Insole, name: str, spikes: tuple[tuple[float, float], ...]) -> list[Finding]:
    """A reference that says what no taxel knows of."""
    if not spikes:
        return []
    return [
        Finding(
            effect=REFERENCE, foot=insole.foot, where=where(insole.slots, insole.slots, insole.layout),
            recordings=(name,), when_s=spikes,
            sentence=f"The reference of {name} has {len(spikes)} spikes that no taxel knows of; they were taken out.",
        )
    ]  # fmt: skip


def of_reference(insole: Insole, faults: Sequence[Fault]) -> list[Finding]:
    """References that stepped or drifted: all taxels are off at once, each as its curve is steep."""
    said_of = {"step": "steps by {:+.2f} kPa", "drift": "drifts by {:.2f} kPa"}
    return [
        Finding(
            effect=REFERENCE, foot=insole.foot, where=where(insole.slots, insole.slots, insole.layout),
            recordings=(each.recording,), when_s=each.when_s, explains=each.explains_count2,
            sentence=f"The reference of {each.recording} {said_of[each.kind].format(each.size_pa / 1e3)}, of which no "
            "taxel knows: the readings are off in proportion to the slopes of their curves. It was taken out.",
        )
        for each in faults
    ]  # fmt: skip


def of_clocks(insole: Insole, observed: Sequence[Observed], clocks: Array, std: Array) -> list[Finding]:
    """Rate errors beyond what two quartzes have, and any clock error where rows were to go with the cycles.

    `clocks` (recordings, 2) offset_s and rate, `std` the same of their standard deviations.
    """
    findings = []
    for each, (offset, rate), (offset_std, rate_std) in zip(observed, clocks, std, strict=True):
        late = abs(rate) * float(each.cycle_s[-1])
        by_row = each.paired_by_row and max(abs(offset), late) > LEAST_OFFSET_S
        runs = abs(rate) > MOST_RATE + SIGMAS * rate_std and late > LEAST_LATE_S
        if each.load.clock != "own" or not (by_row or runs):
            continue
        t = each.t_s
        slope = np.gradient(each.count.mean(axis=1), t)
        moved = slope * ((offset if each.paired_by_row else 0.0) + rate * t)
        if np.sqrt(np.mean(moved**2)) < LEAST_MOVED * np.median(insole.noise_count):
            continue
        ahead = ""
        if each.paired_by_row:
            ahead = f", and {abs(offset):.2f} s {_way(offset, 'ahead of', 'behind')} its rows at the beginning"
        findings.append(
            Finding(
                effect="clock", foot=insole.foot, where=where(each.slots, each.slots, each.layout),
                recordings=(each.name,), equation=laws()["clock"].equation,
                parameters={"offset_s": Quantity(offset, offset_std, "s"), "rate": Quantity(rate, rate_std, "1")},
                explains=float(np.mean(moved**2)),
                sentence=f"The reference's clock of {each.name} runs {abs(rate):.3%} {_way(rate, 'fast', 'slow')}"
                f"{ahead}.",
            )
        )  # fmt: skip
    return findings


def _way(value: float, positive: str, negative: str) -> str:
    return positive if value > 0 else negative


def of_delays(insole: Insole, observed: Sequence[Observed], located: Located) -> list[Finding]:
    """Groups that are read later than the earliest, where each group's clocks were fitted with it."""
    clocks = [
        (each.group.slots, each.naming.best.fitted.clocks(), float(each.naming.best.std[0]))
        for each in located.named
        if observed[0].load.clock == "own" and len(each.group.slots) >= LEAST_TAXELS and _explained(each)
    ]
    rest = np.setdiff1d(insole.slots, merged(each.group.slots for each in located.named))
    if clocks and len(rest) >= LEAST_TAXELS:
        plain = Hypothesis(located.taxels.of_taxels(np.searchsorted(insole.slots, rest)), ())
        clocks.append((rest, plain.fit().clocks(), 0.0))
    # The reference is ahead or behind by any constant: what is read earliest, of a quarter at least, is read in time.
    many = [each for each in clocks if LEAST_IN_TIME * len(insole.slots) <= len(each[0])]
    if not many:
        return []
    _, usual, usual_std = max(many, key=lambda each: each[1][0, 0])
    late: list[tuple[NDArray[np.intp], float, float]] = []
    for slots, clock, own_std in clocks:
        late_s, std_s = float(usual[0, 0] - clock[0, 0]), float(np.hypot(usual_std, own_std))
        if late_s <= SIGMAS * std_s or _moved(insole, observed[0], slots, late_s) < LEAST_MOVED:
            continue
        same = next((i for i, (_, s, std) in enumerate(late) if abs(s - late_s) < SIGMAS * np.hypot(std, std_s)), None)
        if same is None:
            late.append((slots, late_s, std_s))
        else:  # other physics beside the same delay
            late[same] = (merged([late[same][0], slots]), *late[same][1:])
    return [_late(insole, observed[0], *each) for each in late]


def _late(insole: Insole, seen: Observed, slots: NDArray[np.intp], late_s: float, std_s: float) -> Finding:
    place = where(slots, insole.slots, insole.layout)
    moved_count = _moved(insole, seen, slots, late_s) * float(np.median(insole.noise_count))
    return Finding(
        effect="delay", foot=insole.foot, where=place, recordings=insole.recordings,
        equation=laws()["delay"].equation, parameters={"delay_s": Quantity(late_s, std_s, "s")},
        explains=moved_count**2 * len(slots) / len(insole.slots),
        sentence=f"{said(place)} is read {late_s * 1e3:.0f} ms later than the rest.",
    )  # fmt: skip


def _moved(insole: Insole, seen: Observed, slots: NDArray[np.intp], late_s: float) -> float:
    """By how much readings that come late differ from those in time: RMS, in units of a reading's noise."""
    slope = np.gradient(seen.count[:, np.isin(insole.slots, slots)].mean(axis=1), seen.t_s)
    return float(np.sqrt(np.mean(slope**2))) * late_s / float(np.median(insole.noise_count))


def _explained(named: Named) -> bool:
    """What is not explained bends the clocks that are fitted with it, where there is enough of it."""
    little = named.group.per_taxel(named.naming.excess) < LEAST_EXCESS**2
    return little or not unexplained(named.naming, named.group.evidence.y.size)


def of_curves(
    insole: Insole,
    curves: Sequence[Curves],
    model: Calibration,
    bits: Sequence[int],
    creeps: bool,
    components: Sequence[Component],
) -> tuple[list[Finding], float]:
    """How the curves differ from `model`'s, beside a creep or none, and what of a reading the components may move.

    The components are what a calibration of the sensor with its effects may hold; the second value is the RMS, counts,
    of all that they may bring at once: no gain is told from less.
    """
    slots = merged(each.slots for each in curves)
    slots = slots[listed(model, slots)]
    if not slots.size:
        return [], 0.0
    low = max(0.0, *(float(each.load_pa[0]) for each in curves))
    loads = np.linspace(low, min(float(each.load_pa[-1]) for each in curves), 60)
    baseline = model.baseline_count.ravel()[slots][:, None]
    fitted = _on(loads, slots, curves) + baseline
    believed = activation(model, slots, np.broadcast_to(loads[:, None], (len(loads), len(slots)))).T
    parts = []
    for each in components:
        less = fitted - baseline if each.less is None else _on(loads, slots, [each.less])
        parts.append((_on(loads, slots, [each.more]) - less, each.low, each.high))
    moves = sum(np.sqrt(np.mean(part**2)) * (high - low) for part, low, high in parts)
    held = absorbed(fitted, believed, parts)
    noise_count = float(np.median(insole.noise_of(slots)))
    compared = compare(slots, loads, fitted + held, model, creeps, noise_count)
    found = changes(compared, noise_count, insole.layout, bits)
    return [_change(insole, each) for each in found], float(moves)


def _on(loads_pa: Array, slots: NDArray[np.intp], curves: Sequence[Curves]) -> Array:
    """(m, g) activation of the `slots` (m,) at `loads_pa` (g,)."""
    found = np.zeros((len(slots), len(loads_pa)))
    for each in curves:
        for slot, read in zip(each.slots.tolist(), each.activation_count, strict=True):
            at = int(np.searchsorted(slots, slot))
            if at < len(slots) and slots[at] == slot:
                found[at] = np.interp(loads_pa, each.load_pa, read)
    return found


def _change(insole: Insole, change: Change) -> Finding:
    place = where(change.slots, insole.slots, insole.layout)
    units = {parameter.name: parameter.unit for parameter in laws()[change.word].parameters}
    value = next(value for value, _ in change.parameters.values())
    sentence = {
        "gain": f"answers {value:.2f} times as much as its calibration says",
        "baseline": f"rests {value:+.1f} counts beside its calibration",
        "bit_shift": f"answers as if its bit shift were {value:.0f}",
        "stiffening": f"answers ever less beyond {value / 1e3:.0f} kPa",
    }[change.word]
    return Finding(
        effect=change.word, foot=insole.foot, where=place, recordings=insole.recordings,
        equation=laws()[change.word].equation,
        parameters={name: Quantity(v, s, units[name]) for name, (v, s) in change.parameters.items()},
        explains=change.moves_count**2 * len(change.slots) / len(insole.slots),
        sentence=f"{said(place)} {sentence}: recalibration removes it.",
    )  # fmt: skip
