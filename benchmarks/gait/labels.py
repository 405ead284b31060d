"""Accuracy of step labels in simulated walks with turns, stumbles, standing and a lifted foot.

    python -m benchmarks run gait.labels [SEEDS]

Takes 2 minutes with 2 seeds.

Every stance of the plan is matched with the stance of the table that it overlaps most. One that is not found, or is
found and not in the plan, counts as wrong.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import insole_daemon
from benchmarks.physics.paper_phenomenon import ordinary
from insole_daemon.config import Config
from insole_daemon.mechanics.gait.steps import Steps
from insole_daemon.physics.effect import Effect
from insole_daemon.recording.copies import InsoleContents
from insole_daemon.recording.writer import write
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.planned_walk import PlannedStance, PlannedWalk, plan_walk
from insole_daemon.simulation.reference_insole import reference_insole
from insole_daemon.simulation.sensed import SensedLoad, SimulatedInsole
from insole_daemon.simulation.trial import START_NS

PLANS = {
    "turns": ["stand 5", "walk 20", "turn left 5", "walk 20", "turn right 5", "walk 20", "stand 4"],
    "stumble": ["stand 4", "walk 25", "stumble", "walk 25", "stand 4"],
    "standing": ["stand 6", "walk 14", "stand 6", "walk 14", "stand 6", "walk 14", "stand 3"],
    "one foot lifted": ["lift left 5", "walk 16", "lift right 5", "walk 16", "stand 3"],
}


def record(plan: Sequence[PlannedStance], seed: int, folder: Path, effects: Sequence[Effect] = ()) -> Path:
    """Write the recording of a person of this plan on insoles with the true static calibration."""
    config = Config()
    layouts = [load_layout(insole) for insole in config.insoles]
    boards = {insole.foot: insole.boards for insole in config.insoles}
    insoles = [
        SimulatedInsole(
            layout, boards[layout.foot], reference_insole().calibration(layout, boards[layout.foot], seed), effects
        )
        for layout in layouts
    ]
    places = {insole.layout.foot: insole.chain.xy_m for insole in insoles}
    load = PlannedWalk(layouts, plan, seed=seed, places=places)
    sensed = SensedLoad(load, insoles, lambda t_s: np.full_like(t_s, reference_insole().rest_c))
    shifts = {board: of for insole in insoles for board, of in insole.real_shifts().items()}
    emulator = Emulator(config, layouts, sensed, seed=seed, nominal_sensors=True, shifts=shifts)
    seconds = max(stance.toe_off_s for stance in plan) + 2.0
    return write(
        folder,
        kind="free",
        can_origin="simulated",
        insoles=[
            InsoleContents(
                insole.layout.foot,
                [replace(board, interface="can0") for board in boards[insole.layout.foot]],
                insole.layout,
                insole.calibration,
            )
            for insole in insoles
        ],
        frames=emulator.batches(START_NS, seconds),
        interfaces=("can0",),
    )


def judge(steps: Steps, plan: Sequence[PlannedStance], offset_s: float = 0.0) -> list[tuple[str, str]]:
    """(label in the plan, label in the table) of every stance; "none" where there is none."""
    pairs, used = [], set()
    for stance in plan:
        begin_s = np.nan_to_num(steps["contact_s"], nan=-np.inf) - offset_s
        end_s = np.nan_to_num(steps["toe_off_s"], nan=np.inf) - offset_s
        shared_s = np.minimum(end_s, stance.toe_off_s) - np.maximum(begin_s, stance.contact_s)
        shared_s[steps["foot"] != stance.foot] = -1.0
        at = int(shared_s.argmax()) if len(shared_s) else -1
        if at < 0 or shared_s[at] <= 0 or at in used:
            pairs.append((stance.label, "none"))
        else:
            used.add(at)
            pairs.append((stance.label, str(steps["label"][at])))
    pairs += [("none", str(steps["label"][at])) for at in range(len(steps)) if at not in used]
    return pairs


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    for words, effects in (("noise only", ()), ("ordinary physics", ordinary())):
        print(f"{words}\n| walk | stances | labels right | wrong ones |\n|---|---|---|---|")
        for name, kinds in PLANS.items():
            pairs = []
            for seed in range(seeds):
                plan = list(plan_walk(kinds, seed))
                with tempfile.TemporaryDirectory() as folder:
                    recording = insole_daemon.load(record(plan, seed, Path(folder) / "walk", effects))
                    pairs += judge(recording.steps, plan)
            wrong = Counter(f"{truth} as {label}" for truth, label in pairs if truth != label)
            mistakes = ", ".join(f"{count} {what}" for what, count in wrong.most_common()) or "none"
            right = 1 - sum(wrong.values()) / len(pairs)
            print(f"| {name} | {len(pairs)} | {right:.1%} | {mistakes} |", flush=True)


if __name__ == "__main__":
    main()
