"""Accuracy of detected steps in simulated walking, and false steps in standing.

    python -m benchmarks.physics.gait

The truth is the force of the simulated person: contact is when it rises from 0, toe-off when it returns to 0. Light
steps count too, at the start and end of a trial when the person is lowered to the ground and lifted off it. Standing is
the time between. The simulation has boards, bus, digitiser, noise, the daemon's reader and the true static calibration;
`ordinary` adds viscoelasticity, hysteresis, a delay of the bus and the converters' 27 Hz hold, which are not in the
calibration.

Takes about 10 minutes.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import insole_daemon
from benchmarks.physics.paper_phenomenon import ordinary
from insole_daemon.config import Config
from insole_daemon.mechanics.gait import Gait, GaitEvent
from insole_daemon.recording.loading import Recording
from insole_daemon.recording.steps import replay_gait_events
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.conditions import Conditions
from insole_daemon.simulation.foot import Person
from insole_daemon.simulation.scenarios.standing import ALOFT_S, STEP_S
from insole_daemon.simulation.trial import START_NS, Trial

WALKING, STANDING = ("t4", "t5", "t6"), ("stand", "t1", "t2", "t3")
MASSES_KG = (45.0, 63.0, 95.0)
NEAR_S = 0.15  # an event farther from the truth is another one
_TRUE_EVERY_S = 0.001
_CONFIG = Config()
_LAYOUTS = [load_layout(insole) for insole in _CONFIG.insoles]


@dataclass(frozen=True, slots=True)
class Score:
    """Of one recording."""

    n_true: int
    n_matched: int
    wrong: int  # events that match no true one
    error_ms: list[float]
    delay_ms: list[float]  # from the truth until the cycle that reported it


def truth(load: Person, seconds: float) -> dict[tuple[str, str], np.ndarray]:
    """(n,) s of every contact and toe-off, by foot and kind."""
    t_s = np.arange(0, seconds, _TRUE_EVERY_S)
    times_s = {}
    for layout in _LAYOUTS:
        pressed = np.diff((load.force_n(layout.foot, t_s) > 0).astype(np.int8))
        for kind, change in (("initial_contact", 1), ("toe_off", -1)):
            times_s[layout.foot, kind] = t_s[1:][pressed == change]
    return times_s


def score(events: list[GaitEvent], true_times_s: dict[tuple[str, str], np.ndarray]) -> Score:
    """Match each true event to the nearest reported one; each is matched once."""
    hits, wrong, error_ms, delay_ms = 0, 0, [], []
    for (foot, kind), times in true_times_s.items():
        own = [event for event in events if (event.foot, event.kind) == (foot, kind)]
        at_s = np.array([(event.t_ns - START_NS) * 1e-9 for event in own])
        unmatched = set(range(len(own)))
        for true_s in times.tolist():
            near = min(unmatched, key=lambda i: abs(at_s[i] - true_s), default=None)
            if near is not None and abs(at_s[near] - true_s) <= NEAR_S:
                unmatched.remove(near)
                hits += 1
                error_ms.append((at_s[near] - true_s) * 1e3)
                delay_ms.append((at_s[near] - true_s + own[near].noticed_after_s) * 1e3)
        wrong += len(unmatched)
    return Score(sum(map(len, true_times_s.values())), hits, wrong, error_ms, delay_ms)


def trials(names: tuple[str, ...], physics: bool) -> Iterator[tuple[str, Trial, Recording]]:
    """Each name with each mass, another insole and another walk each time."""
    effects = {layout.foot: ordinary() for layout in _LAYOUTS} if physics else {}
    for seed, (name, mass_kg) in enumerate((name, mass_kg) for name in names for mass_kg in MASSES_KG):
        conditions = Conditions(mass_kg=mass_kg)
        trial = Trial(name, _CONFIG, _LAYOUTS, effects=effects, conditions=conditions, seed=seed)
        with tempfile.TemporaryDirectory() as folder:
            yield name, trial, insole_daemon.load(trial.write(Path(folder) / name))


def main() -> None:
    for physics in (False, True):
        scores = []
        for _, trial, recording in trials(WALKING, physics):
            assert isinstance(trial.load, Person)
            seconds = (int(recording.feet[0].t_ns[-1]) - START_NS) * 1e-9
            scores.append(score(replay_gait_events(recording.feet), truth(trial.load, seconds)))
        error_ms = np.array([each for one in scores for each in one.error_ms])
        delay_ms = np.array([each for one in scores for each in one.delay_ms])
        n_true, n_matched = sum(one.n_true for one in scores), sum(one.n_matched for one in scores)
        print(
            f"walking, {'ordinary physics' if physics else 'noise only'}: {n_matched} of {n_true} found "
            f"({n_matched / n_true:.2%}), {sum(one.wrong for one in scores)} that are not there; timing error "
            f"median {np.median(np.abs(error_ms)):.1f} ms, 95 % {np.percentile(np.abs(error_ms), 95):.1f} ms, mean "
            f"{error_ms.mean():+.1f} ms; told after median {np.median(delay_ms):.1f} ms, "
            f"95 % {np.percentile(delay_ms, 95):.1f} ms",
            flush=True,
        )
        wrong, minutes = 0, 0.0
        for name, _, recording in trials(STANDING, physics):
            first_ns, last_ns = (int(recording.feet[0].t_ns[at]) for at in (0, -1))
            aloft_ns = 0 if name == "stand" else round((ALOFT_S + STEP_S) * 1e9)
            wrong += sum(
                first_ns + aloft_ns <= event.t_ns <= last_ns - aloft_ns for event in replay_gait_events(recording.feet)
            )
            minutes += (last_ns - first_ns - 2 * aloft_ns) / 60e9
        print(f"standing {minutes:.0f} minutes: {wrong} events", flush=True)
    cost()


def cost() -> None:
    """CPU time of a cycle, walking: what the live path pays."""
    for _, _, recording in trials(("t4",), False):
        rows = [(foot, at) for at in range(500, 1500) for foot in recording.feet]
        gait = Gait(_LAYOUTS)
        began = time.process_time()
        for foot, at in rows:
            assert foot.wrench is not None
            assert foot.pressure_pa is not None
            t_ns = int(foot.t_ns[at])
            gait.update(foot.foot, t_ns, t_ns, float(foot.wrench.f_z_n[at]), foot.pressure_pa[at], foot.valid[at])
        print(f"CPU of a cycle and foot: {(time.process_time() - began) / len(rows) * 1e6:.1f} µs")
        return


if __name__ == "__main__":
    main()
