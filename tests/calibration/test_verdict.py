"""Each fault, planted on one taxel among healthy ones, gets its verdict."""

from __future__ import annotations

import pytest
from small_insole import CONFIG, LAYOUT, SEED

import insole_daemon
from insole_daemon.calibration.samples import align_by_activation, select_samples
from insole_daemon.calibration.trials import prepare_trials
from insole_daemon.calibration.verdict import HEALTHY, Verdict, judge_taxels, judge_triangle
from insole_daemon.physics.effect import Where, effect
from insole_daemon.simulation.conditions import ChamberCycles, Conditions
from insole_daemon.simulation.faults import InjectedFault
from insole_daemon.simulation.trial import Trial

BOARD, TRIANGLE = LAYOUT.triangles[0].board, LAYOUT.triangles[0].triangle


@pytest.fixture(scope="module")
def verdict_of_slot(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Verdict]:
    """Return the verdicts: taxel 1 is noisy, 2 saturates above 50 kPa, 3 has a fifth of the sensitivity; all of one
    triangle.
    """
    faults = (
        InjectedFault("noisy", 0.0, None, BOARD, TRIANGLE, 1, factor=8.0),
        InjectedFault("saturated", 0.0, None, BOARD, TRIANGLE, 2, level_pa=50e3),
    )
    numb = effect("gain", Where("taxel", ((BOARD, TRIANGLE, 3),)), gain=0.2)
    cycles = ChamberCycles(speeds_pa_s=(6e3,), cycles=2, hold_s=5.0, minor=())
    conditions = Conditions(chamber=cycles, faults=faults)
    trial = Trial("vacuum", CONFIG, [LAYOUT], seed=SEED, conditions=conditions, effects={"left": [numb]})
    recording = insole_daemon.load(trial.write(tmp_path_factory.mktemp("faulty") / "bag"))
    (ready,), _ = prepare_trials([recording], "left")
    return judge_taxels([select_samples(ready, align_by_activation(ready))])


@pytest.mark.parametrize(("taxel", "word"), [(1, "noisy"), (2, "saturating"), (3, "insensitive")])
def test_each_fault_gets_its_verdict(verdict_of_slot: dict[int, Verdict], taxel: int, word: str) -> None:
    assert verdict_of_slot[taxel].word == word
    assert verdict_of_slot[taxel].recording == "bag"


def test_a_saturating_taxel_states_since_when(verdict_of_slot: dict[int, Verdict]) -> None:
    # 50 kPa are reached 8.3 s after the load begins, at 5 s.
    assert verdict_of_slot[2].since_s == pytest.approx(5 + 50 / 6, abs=1.0)


def test_taxels_without_a_fault_are_healthy(verdict_of_slot: dict[int, Verdict]) -> None:
    assert {verdict.word for slot, verdict in verdict_of_slot.items() if slot not in (1, 2, 3)} == {"healthy"}


def test_a_triangle_gets_the_verdict_of_most_taxels() -> None:
    loose = Verdict("loose", "bag", 3.0)
    assert judge_triangle([HEALTHY] * 10) == HEALTHY
    assert judge_triangle([loose] * 6 + [HEALTHY] * 4) == Verdict("loose", "bag", 3.0, "6 of its taxels")
    mostly = judge_triangle([loose] * 2 + [HEALTHY] * 8)
    assert (mostly.word, mostly.detail) == ("healthy", "but for 2 of its taxels")
