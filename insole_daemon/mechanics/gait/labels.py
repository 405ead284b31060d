"""Labels of stances, from times, forces and the CoP of both feet.

steady     a walking step that is none of the following
start      first step of each foot of a bout of walking, and those after it until the first that is like the others
stop       the same at the end of a bout, backwards
turn       steps in a row whose CoP lies to the same side of the room under both feet: who turns leans inwards
           (Orendurff et al. 2006, Gait & Posture 23:106)
stumble    a few steps in a row whose timing departs from the others
irregular  steps that depart from the others, and are none of these
standing   a stance longer than LONGEST_STANCE_S, or than twice the usual one
one_leg    standing while the other foot is in the air for LONG_SWING_S or more
cut        the recording begins or ends within the stance, or cycles are missing beside it

A step departs from the others of its foot if stance, step time, peak force, impulse or mean y of the CoP is farther
from its median than FAR standard deviations (1.4826 · median absolute deviation, but at least LEAST_STD). Start and
stop are the first and last step of a foot, since steady walking is reached within the first stride (Brenière & Do 1986,
J. Biomech. 19:1035). A bout ends where no foot touches the ground anew for LONGEST_STEP_S.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

Label = Literal["steady", "start", "stop", "turn", "stumble", "irregular", "standing", "one_leg", "cut"]
LABELS: tuple[Label, ...] = get_args(Label)

LONGEST_STANCE_S = 2.0
LONG_SWING_S = 1.0
LONGEST_STEP_S = 2.0  # from a contact to the next one of any foot
FAR = 4.0
LEAST_STD = {"stance_s": 0.02, "step_s": 0.02, "peak_force_n": 0.02, "impulse_n_s": 0.03}  # of the median
LEAST_STD_Y_M = 0.001
TIMING = ("stance_s", "step_s")
FEWEST_TURN, MOST_STUMBLE = 3, 4  # steps in a row
SAME_SIDE = 0.75  # of the steps of a turn
_USUAL_STANCE_S = 2.0

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Walking:
    """n stances of both feet in order of contact; NaN: not known."""

    is_left: NDArray[np.bool_]  # (n,)
    begin_s: Array  # (n,) contact, or the first cycle of a stance that is cut
    end_s: Array
    is_cut: NDArray[np.bool_]
    figures: dict[str, Array]  # stance_s, step_s, peak_force_n, impulse_n_s, cop_mean_y_m, each (n,)


def label_steps(walking: Walking) -> NDArray[np.str_]:
    """Return the label of every stance, (n,)."""
    n = len(walking.begin_s)
    labels = np.full(n, "steady", "<U9")
    stance_s = walking.end_s - walking.begin_s
    usual = stance_s[stance_s <= _USUAL_STANCE_S]
    longest_s = min(LONGEST_STANCE_S, 2 * float(np.median(usual))) if len(usual) else LONGEST_STANCE_S
    labels[walking.is_cut] = "cut"
    for at in np.flatnonzero(stance_s > longest_s).tolist():
        labels[at] = "one_leg" if _longest_swing_s(walking, at) >= LONG_SWING_S else "standing"
    deviation = _deviation(walking, labels)
    departs = np.any([np.abs(of_figure) > FAR for of_figure in deviation.values()], axis=0)
    for bout in _bouts(walking, labels):
        inner = _label_ends(walking, labels, departs, bout)
        _label_runs(walking, labels, departs, deviation, inner)
    return labels


def _longest_swing_s(walking: Walking, at: int) -> float:
    """Return the longest swing in s of the other foot during the stance `at`; 0 where that foot is not recorded."""
    other = walking.is_left != walking.is_left[at]
    if not other.any():
        return 0.0
    begin_s, end_s = float(walking.begin_s[at]), float(walking.end_s[at])
    overlap = other & (walking.end_s > begin_s) & (walking.begin_s < end_s)
    moments = [begin_s]
    for number in np.flatnonzero(overlap).tolist():
        moments += [float(walking.begin_s[number]), float(walking.end_s[number])]
    moments.append(end_s)
    return max(after - before for before, after in zip(moments[::2], moments[1::2], strict=True))


def _deviation(walking: Walking, labels: NDArray[np.str_]) -> dict[str, Array]:
    """Return by figure the deviation (n,) from the median of the foot's walking steps, in standard deviations.

    It is 0 where a figure is not known.
    """
    deviations = {}
    for name, values in walking.figures.items():
        deviation = np.zeros(len(values))
        for is_left in (True, False):
            of_foot = (walking.is_left == is_left) & (labels == "steady") & np.isfinite(values)
            if not of_foot.any():
                continue
            median = float(np.median(values[of_foot]))
            std = 1.4826 * float(np.median(np.abs(values[of_foot] - median)))
            least = LEAST_STD_Y_M if name == "cop_mean_y_m" else LEAST_STD[name] * abs(median)
            deviation[of_foot] = (values[of_foot] - median) / max(std, least, np.finfo(float).tiny)
        deviations[name] = deviation
    return deviations


def _bouts(walking: Walking, labels: NDArray[np.str_]) -> list[NDArray[np.intp]]:
    """Return the rows of the walking steps of each bout; pauses, standing and cuts separate bouts."""
    bouts: list[list[int]] = []
    last_s = -np.inf
    longest_s = LONGEST_STEP_S if len(set(walking.is_left.tolist())) == 2 else 2 * LONGEST_STEP_S
    for at, label in enumerate(labels.tolist()):
        if label != "steady":
            if label != "cut":
                last_s = -np.inf
            continue
        if walking.begin_s[at] - last_s > longest_s:
            bouts.append([])
        bouts[-1].append(at)
        last_s = float(walking.begin_s[at])
    return [np.array(bout) for bout in bouts]


def _label_ends(
    walking: Walking, labels: NDArray[np.str_], departs: NDArray[np.bool_], bout: NDArray[np.intp]
) -> NDArray[np.intp]:
    """Label starts and stops of `bout` in place; return the rows between them."""
    labels_of_ends: tuple[tuple[Label, NDArray[np.intp]], ...] = (("start", bout), ("stop", bout[::-1]))
    inner = set(bout.tolist())
    for label, order in labels_of_ends:
        seen: set[bool] = set()
        for at in order.tolist():
            is_left = bool(walking.is_left[at])
            if is_left in seen and not departs[at]:
                break
            if len(seen) == 2 and not departs[at]:
                break
            seen.add(is_left)
            if at in inner:
                labels[at] = label
                inner.discard(at)
    return np.array(sorted(inner), np.intp)


def _label_runs(
    walking: Walking,
    labels: NDArray[np.str_],
    departs: NDArray[np.bool_],
    deviation: dict[str, Array],
    inner: NDArray[np.intp],
) -> None:
    """Label the steps of `inner` that depart, in place: those in a row, or one apart, are of one kind."""
    runs: list[list[int]] = []
    for position, at in enumerate(inner.tolist()):
        if not departs[at]:
            continue
        if runs and position - runs[-1][-1] <= 2:
            runs[-1] += range(runs[-1][-1] + 1, position + 1)
        else:
            runs.append([position])
    for run in runs:
        steps = inner[run]
        side = deviation["cop_mean_y_m"][steps]
        mistimed = np.any([np.abs(deviation[name][steps]) > FAR for name in TIMING])
        leaning = np.abs(side) > FAR / 2
        same_side = max(np.count_nonzero(leaning & (side > 0)), np.count_nonzero(leaning & (side < 0)))
        both_feet = len(set(walking.is_left[steps].tolist())) == len(set(walking.is_left.tolist()))
        if len(steps) >= FEWEST_TURN and same_side >= SAME_SIDE * len(steps) and both_feet:
            labels[steps] = "turn"
        elif len(steps) <= MOST_STUMBLE and mistimed:
            labels[steps] = "stumble"
        else:
            labels[steps] = "irregular"
