"""What is wrong with a taxel: each fault planted on one, among taxels that are healthy."""

from __future__ import annotations

import pytest
from small_insole import CONFIG, LAYOUT, SEED

import insole_daemon
from insole_daemon.calibration.samples import aligned, samples
from insole_daemon.calibration.trials import trials
from insole_daemon.calibration.verdict import HEALTHY, Verdict, of_triangle, verdicts
from insole_daemon.physics.effect import Where, effect
from insole_daemon.simulation.conditions import ChamberCycles, Conditions
from insole_daemon.simulation.faults import InjectedFault
from insole_daemon.simulation.trial import Trial

BOARD, TRIANGLE = LAYOUT.triangles[0].board, LAYOUT.triangles[0].triangle


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Verdict]:
    """Taxel 1 is noisy, 2 saturates from 50 kPa on, 3 answers with a fifth; all of one triangle."""
    faults = (
        InjectedFault("noisy", 0.0, None, BOARD, TRIANGLE, 1, factor=8.0),
        InjectedFault("saturated", 0.0, None, BOARD, TRIANGLE, 2, level_pa=50e3),
    )
    numb = effect("gain", Where("taxel", ((BOARD, TRIANGLE, 3),)), gain=0.2)
    cycles = ChamberCycles(speeds_pa_s=(6e3,), cycles=2, hold_s=5.0, minor=())
    conditions = Conditions(chamber=cycles, faults=faults)
    trial = Trial("vacuum", CONFIG, [LAYOUT], seed=SEED, conditions=conditions, effects={"left": [numb]})
    recording = insole_daemon.load(trial.write(tmp_path_factory.mktemp("faulty") / "bag"))
    (ready,), _ = trials([recording], "left")
    return verdicts([samples(ready, aligned(ready))])


@pytest.mark.parametrize(("taxel", "word"), [(1, "noisy"), (2, "saturating"), (3, "insensitive")])
def test_each_is_called_by_its_name(found: dict[int, Verdict], taxel: int, word: str) -> None:
    assert found[taxel].word == word
    assert found[taxel].recording == "bag"


def test_a_saturating_one_says_since_when(found: dict[int, Verdict]) -> None:
    # 50 kPa are reached 8.3 s after the load begins, at 5 s.
    assert found[2].since_s == pytest.approx(5 + 50 / 6, abs=1.0)


def test_the_others_are_healthy(found: dict[int, Verdict]) -> None:
    assert {each.word for slot, each in found.items() if slot not in (1, 2, 3)} == {"healthy"}


def test_a_triangle_is_what_most_of_its_taxels_are() -> None:
    loose = Verdict("loose", "bag", 3.0)
    assert of_triangle([HEALTHY] * 10) == HEALTHY
    assert of_triangle([loose] * 6 + [HEALTHY] * 4) == Verdict("loose", "bag", 3.0, "6 of its taxels")
    mostly = of_triangle([loose] * 2 + [HEALTHY] * 8)
    assert (mostly.word, mostly.detail) == ("healthy", "but for 2 of its taxels")
