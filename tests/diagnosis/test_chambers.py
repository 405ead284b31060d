"""Effects applied to chamber recordings by hand, and the findings on them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis import pipeline
from insole_daemon.diagnosis.result import Diagnosis, RecordingResult
from insole_daemon.diagnosis.timings import clock_findings
from insole_daemon.diagnosis.verifying import verify
from insole_daemon.errors import DiagnosisError
from insole_daemon.physics.effect import Where
from insole_daemon.recording.loading import FootRecording

from . import chamber
from .chamber import BEGAN_S, LAYOUT, SLOTS, WHOLE, Array, relaxing, write


def diagnose(*folders: Path) -> Diagnosis:
    return pipeline.diagnose([insole_daemon.load(folder) for folder in folders], None, lambda text: None)


def loaded(folder: Path) -> tuple[FootRecording, Array]:
    """Return the foot in `folder`, and the reference's pressure at its cycles (n,), Pa."""
    foot = insole_daemon.load(folder).feet[0]
    reference = foot.reference
    assert reference is not None
    assert reference.time_s is not None
    return foot, np.interp(foot.t_ns * 1e-9, reference.time_s, reference["pressure_pa"])


def calibrate(folder: Path, trial: Path) -> None:
    """Give `folder` a calibration with the mean curves of the readings in `trial`."""
    foot, pressure = loaded(trial)
    document = json.loads((folder / "calibration.json").read_text())
    rows = {tuple(identity): row for row, identity in enumerate(foot.layout.identities.tolist())}
    for each in document["taxels"]:
        read = foot.counts[:, rows[each["board"], each["triangle"]], each["taxel"]].astype(float)
        activation = each["baseline_count"] - read
        each["coefficients_pa"] = np.polynomial.polynomial.polyfit(activation, pressure, 3).tolist()
    (folder / "calibration.json").write_text(json.dumps(document))


def of_rows(*rows: int) -> np.ndarray:
    """Return the taxels (72,) of these triangles of LAYOUT."""
    return np.isin(np.arange(72) // 12, rows)


def identities(*rows: int) -> set[tuple[int, ...]]:
    return {tuple(LAYOUT.identities[row].tolist()) for row in rows}


def test_a_memory_of_three_triangles_is_placed_and_measured(tmp_path):
    found = diagnose(write(tmp_path / "bag", relaxing(0.3, 0.8), of_rows(0, 2, 5)))
    (finding,) = found.findings
    assert finding.effect == "viscoelasticity"
    assert set(finding.where.ids) == identities(0, 2, 5)
    assert finding.parameters["a"].value == pytest.approx(0.3, rel=0.1)
    assert finding.parameters["tau_s"].value == pytest.approx(0.8, rel=0.15)
    assert found.verdict == "explained"


def test_a_creep_that_delays_nearly_the_whole_response_is_measured(tmp_path):
    """No usual material does; a bound of the delayed part would leave a mismatch that other terms describe."""
    taus_s = (2.0, 8.0, 32.0)

    def creeping(t_s: Array, p: Array) -> Array:
        return p + sum(relaxing(0.3, tau_s)(t_s, p) - p for tau_s in taus_s)

    (finding,) = diagnose(write(tmp_path / "bag", creeping, seconds=60.0)).findings
    assert finding.effect == "creep"
    a, tau_s = (finding.parameters[name].value for name in ("a", "tau_s"))
    assert tau_s[:3] == pytest.approx(taus_s)
    assert a[:3] == pytest.approx([0.3, 0.3, 0.3], rel=0.05)
    assert sum(a[3:]) < 0.02


def test_a_strong_creep_that_moves_the_edges_is_no_wrong_clock(tmp_path):
    def creeping(t_s: Array, p: Array) -> Array:
        return p + sum(relaxing(share, tau_s)(t_s, p) - p for share, tau_s in ((0.5, 6.0), (0.4, 30.0)))

    found = diagnose(write(tmp_path / "bag", creeping, seconds=60.0))
    (finding,) = found.findings
    assert finding.effect == "creep"
    assert sum(finding.parameters["a"].value) == pytest.approx(0.9, abs=0.05)
    assert found.clocks[0, 0] == pytest.approx(0.0)


def test_a_loop_beside_a_strong_creep_is_found(tmp_path):
    """It explains far less than the law of a creep may leave, and nearly all of what this creep leaves."""

    def creeping(t_s: Array, p: Array) -> Array:
        return p + sum(relaxing(0.3, tau_s)(t_s, p) - p for tau_s in (3.0, 40.0))

    def effect(t_s: Array, p: Array) -> Array:
        return creeping(t_s, p) - (p - chamber.bouc_wen(0.6, 30e3)(t_s, p))

    found = diagnose(write(tmp_path / "bag", effect, seconds=60.0))
    assert {each.effect for each in found.findings} == {"creep", "hysteresis"}
    assert found.heldout["after"] < 1.15 * found.heldout["floor"]


def test_a_memory_that_is_stronger_in_some_triangles_is_one_effect(tmp_path):
    """Materials are not the same everywhere: the rest of a strong memory is no drift or memory of single triangles."""
    strength = np.repeat([1.1, 0.92, 1.05, 0.95, 1.08, 0.9], 12)
    found = diagnose(write(tmp_path / "bag", relaxing(0.5, 8.0), strength))
    (finding,) = found.findings
    assert finding.effect in ("creep", "viscoelasticity")
    assert finding.where.scope == "insole"
    assert found.heldout["after"] < 0.3 * found.heldout["before"]


def test_a_change_with_temperature_that_is_stronger_in_some_triangles_is_one_effect(tmp_path):
    strength = np.repeat([1.25, 0.8, 1.15, 0.85, 1.2, 0.8], 12)

    def warmed(t_s: Array) -> Array:
        return 25.0 + 4.0 * np.sin(2.0 * np.pi * t_s / 55.0)

    def warm(t_s: Array, counts: Array) -> None:
        counts += 2.5 * strength * (warmed(t_s) - 25.0)[:, None]

    (finding,) = diagnose(write(tmp_path / "bag", touch=warm, temperature=warmed)).findings
    assert finding.effect == "temperature"
    assert finding.where.scope == "insole"
    assert abs(finding.parameters["count_per_k"].value) == pytest.approx(2.5, rel=0.1)


def test_a_strong_memory_is_detected_although_the_calibration_contains_it(tmp_path):
    """The calibration has the mean curves of readings with memory, which must not be named gain or baseline."""
    folder = write(tmp_path / "bag", relaxing(0.45, 3.0))
    calibrate(folder, folder)
    found = diagnose(folder)
    (finding,) = found.findings
    assert finding.effect == "viscoelasticity"
    assert finding.where.scope == "insole"
    assert finding.parameters["a"].value == pytest.approx(0.45, rel=0.15)
    assert found.heldout["after"] < 0.7 * found.heldout["before"]


def test_a_baseline_of_a_board_is_detected_beside_a_strong_memory_that_the_calibration_contains(tmp_path):
    """Loose curves absorb both, but the memory changes the curves of all boards alike."""
    rows = np.flatnonzero(LAYOUT.identities[:, 0] == 6)

    def shift(t_s: np.ndarray, counts: np.ndarray) -> None:
        counts[:, of_rows(*rows)] += 4.0

    folder = write(tmp_path / "bag", relaxing(0.45, 3.0), touch=shift)
    calibrate(folder, write(tmp_path / "calibrated", relaxing(0.45, 3.0)))
    found = diagnose(folder)
    by_word = {each.effect: each for each in found.findings}
    assert set(by_word) == {"viscoelasticity", "baseline"}, [each.sentence for each in found.findings]
    assert by_word["baseline"].where.ids == ((6,),)
    assert by_word["baseline"].parameters["shift_count"].value == pytest.approx(4.0, abs=0.6)
    assert by_word["viscoelasticity"].parameters["a"].value == pytest.approx(0.45, rel=0.15)


def rubbing(up: float, down: float, widest_pa: float) -> Callable[[Array, Array], Array]:
    """Dry friction after Dahl (1968) with different stiffness up and down, which grows with the load."""

    def effect(t_s: Array, p: Array) -> Array:
        force, found, n = 0.0, np.empty_like(p), 20
        for i in range(len(p)):
            before = p[max(i - 1, 0)]
            step = (p[i] - before) / n
            stiffness = up if step > 0 else down
            for _ in range(n):
                force += stiffness * step * (1.0 - force * np.sign(step) / widest_pa)
            found[i] = p[i] - force * (0.5 + p[i] / p.max())
        return found

    return effect


def knee(knee_pa: float, span_pa: float, before: Callable[[Array, Array], Array]) -> Callable[[Array, Array], Array]:
    """Bottoming out after another effect."""

    def effect(t_s: Array, p: Array) -> Array:
        felt = before(t_s, p)
        over = np.maximum(felt - knee_pa, 0.0)
        return felt - over + over * span_pa / (span_pa + over)

    return effect


def test_a_stiffening_is_reported_beside_a_memory_that_the_calibration_contains(tmp_path):
    memory = relaxing(0.45, 3.0)
    calibrate(folder := write(tmp_path / "bag", knee(120e3, 250e3, memory)), write(tmp_path / "before", memory))
    found = diagnose(folder)
    assert {each.effect for each in found.findings} == {"viscoelasticity", "stiffening"}
    (stiffening,) = (each for each in found.findings if each.effect == "stiffening")
    assert stiffening.parameters["knee_pa"].value == pytest.approx(120e3, abs=60e3)


def test_a_stiffening_is_reported_beside_a_loop(tmp_path):
    """The companions of the loop take it up, because a calibration may contain a loop's mean curve."""
    found = diagnose(write(tmp_path / "bag", knee(120e3, 250e3, rubbing(1.0, 0.5, 30e3))))
    assert {each.effect for each in found.findings} == {"hysteresis", "stiffening"}
    (stiffening,) = (each for each in found.findings if each.effect == "stiffening")
    assert stiffening.parameters["knee_pa"].value == pytest.approx(120e3, abs=60e3)


def test_a_loss_of_gain_is_reported_beside_a_memory(tmp_path):
    def weaker(t_s: Array, counts: Array) -> None:
        counts[:] = 240.5 - 0.85 * (240.5 - counts)

    found = diagnose(write(tmp_path / "bag", relaxing(0.3, 0.8), touch=weaker))
    by_word = {each.effect: each for each in found.findings}
    assert set(by_word) == {"viscoelasticity", "gain"}, [each.sentence for each in found.findings]
    assert by_word["gain"].where.scope == "insole"
    assert by_word["gain"].parameters["gain"].value == pytest.approx(0.85, abs=0.03)


def test_a_loss_of_gain_that_a_slower_creep_may_be_is_listed_as_not_identifiable(tmp_path, monkeypatch):
    """If curves are straight, a part of the response that comes after the recording looks like a gain."""
    drawn = chamber.Sensors.drawn
    monkeypatch.setattr(chamber.Sensors, "drawn", lambda *args: replace(drawn(*args), bend=np.full(72, 1e9)))

    def weaker(t_s: Array, counts: Array) -> None:
        counts[:] = 240.5 - 0.85 * (240.5 - counts)

    def creeping(t_s: Array, p: Array) -> Array:
        return p + sum(relaxing(0.2, tau_s)(t_s, p) - p for tau_s in (2.0, 8.0, 32.0))

    (result,) = diagnose(write(tmp_path / "bag", creeping, touch=weaker)).results
    assert [each.effect for each in result.findings] == ["creep"]
    assert any(row["effect"] == "gain" and "calibration" in row["why"] for row in result.not_identifiable)


def test_loops_of_another_law_are_hysteresis_and_nothing_else(tmp_path):
    found = diagnose(write(tmp_path / "bag", rubbing(1.2, 0.3, 60e3)))
    assert [each.effect for each in found.findings] == ["hysteresis"]
    before, after, floor = (found.heldout[name] ** 2 for name in ("before", "after", "floor"))
    assert before - after > 0.8 * (before - floor)


def test_a_loop_that_closes_as_the_load_vanishes_closes_in_the_model(tmp_path):
    def closing(t_s: Array, p: Array) -> Array:
        slider, out = 0.0, np.empty_like(p)
        for i, load in enumerate(p):
            slider = min(max(slider, load - 25e3), load + 25e3)
            out[i] = load - 0.6 * (load - slider) * load / (load + 40e3)
        return out

    found = diagnose(write(tmp_path / "bag", closing, seconds=60.0))
    (finding,) = found.findings
    assert finding.effect == "hysteresis"
    assert finding.where.scope == "insole"
    assert max(finding.parameters["half_pa"].value) > 0.0
    assert found.heldout["after"] < 1.06 * found.heldout["floor"]


def test_a_lag_beside_a_memory_is_not_named_delay(tmp_path):
    def effect(t_s: Array, p: Array) -> Array:
        return relaxing(1.0, 0.15)(t_s, rubbing(0.5, 0.5, 30e3)(t_s, p))

    found = diagnose(write(tmp_path / "bag", effect))
    assert {each.effect for each in found.findings} == {"hysteresis", "lag"}
    (lag,) = (each for each in found.findings if each.effect == "lag")
    assert lag.parameters["tau_s"].value == pytest.approx(0.15, rel=0.2)


def test_memories_under_cycles_of_one_speed_are_not_decidable(tmp_path, monkeypatch):
    """The loops of a creep, a hysteresis and a viscoelasticity differ only in how they change with speed and holds."""
    t_s = np.arange(0.0, 90.0, chamber.DT_S)
    cycles_pa = 300e3 * (1.0 - np.abs((t_s / 4.0) % 2.0 - 1.0))
    monkeypatch.setattr(chamber, "load", lambda seconds: (t_s, cycles_pa))
    found = diagnose(write(tmp_path / "bag", relaxing(0.3, 0.8)))
    (finding,) = found.findings
    words = {finding.effect, *finding.alternatives}
    assert len(words) == 2
    assert words < {"creep", "hysteresis", "viscoelasticity"}
    assert "holds" in finding.sentence
    assert found.verdict == "not decidable"


def test_a_long_lag_of_a_board_is_no_viscoelasticity(tmp_path):
    board = np.repeat(LAYOUT.identities[:, 0] == 6, 12)
    found = diagnose(write(tmp_path / "bag", relaxing(1.0, 0.4), board))
    (finding,) = found.findings
    assert (finding.effect, finding.where.ids) == ("lag", ((6,),))
    assert finding.parameters["tau_s"].value == pytest.approx(0.4, rel=0.05)


def test_a_lag_as_long_as_a_cycle_is_no_viscoelasticity_beside_a_shorter_one(tmp_path):
    found = diagnose(write(tmp_path / "bag", relaxing(1.0, 0.75)))
    (finding,) = found.findings
    assert finding.effect == "lag"
    assert finding.parameters["tau_s"].value == pytest.approx(0.75, rel=0.05)


@pytest.mark.parametrize("tau_s", [0.3, 0.8])
def test_a_long_lag_beside_strong_hysteresis_is_measured(tmp_path, tau_s):
    """A timing without terms is the wrong start for the shorter lag, and terms without the lag for the longer one.

    The loop of a slow load moves the timing that is fitted without terms by more than the search finds back.
    """

    def effect(t_s: Array, p: Array) -> Array:
        return relaxing(1.0, tau_s)(t_s, rubbing(1.2, 0.3, 60e3)(t_s, p))

    found = diagnose(write(tmp_path / "bag", effect))
    by_word = {each.effect: each for each in found.findings}
    assert {"hysteresis", "lag"} <= set(by_word)
    assert by_word["lag"].parameters["tau_s"].value == pytest.approx(tau_s, rel=0.1)


def test_a_small_gain_is_measured_beside_a_baseline_of_a_board(tmp_path):
    def changed(t_s: Array, counts: Array) -> None:
        counts[:] = 240.5 - 0.97 * (240.5 - counts)
        counts[:, of_rows(2, 3)] -= 4.3

    found = diagnose(write(tmp_path / "bag", touch=changed))
    by_word = {each.effect: each for each in found.findings}
    assert set(by_word) == {"baseline", "gain"}, [each.sentence for each in found.findings]
    assert by_word["gain"].parameters["gain"].value == pytest.approx(0.97, abs=0.006)
    assert by_word["baseline"].where.ids == ((6,),)
    assert by_word["baseline"].parameters["shift_count"].value == pytest.approx(-4.3, abs=0.2)


def test_a_gain_of_a_board_is_reported_beside_a_memory_of_the_insole(tmp_path):
    def weaker(t_s: Array, counts: Array) -> None:
        own = of_rows(2, 3)
        counts[:, own] = 240.5 - 0.85 * (240.5 - counts[:, own])

    found = diagnose(write(tmp_path / "bag", relaxing(0.25, 1.5), touch=weaker))
    by_word = {each.effect: each for each in found.findings}
    assert set(by_word) == {"viscoelasticity", "gain"}, [each.sentence for each in found.findings]
    assert by_word["gain"].where.ids == ((6,),)
    assert by_word["gain"].parameters["gain"].value == pytest.approx(0.85, abs=0.03)
    assert by_word["viscoelasticity"].where.scope == "insole"


def test_a_bit_shift_is_reported_beside_strong_hysteresis(tmp_path):
    def shifted(t_s: Array, counts: Array) -> None:
        own = of_rows(2, 3)
        counts[:, own] = 240.5 - 0.5 * (240.5 - counts[:, own])  # and the noise with it

    found = diagnose(write(tmp_path / "bag", rubbing(1.2, 0.3, 60e3), touch=shifted))
    by_word = {each.effect: each for each in found.findings}
    assert set(by_word) == {"hysteresis", "bit_shift"}, [each.sentence for each in found.findings]
    assert by_word["bit_shift"].where.ids == ((6,),)
    assert by_word["bit_shift"].parameters["shift"].value == 4
    assert by_word["bit_shift"].explains > 0.0
    (own,) = found.results
    assert "bit_shift" in {effect.law.word for effect in own.effects}


def test_of_three_boards_the_one_with_another_shift_is_named_whatever_it_reads_without_load(tmp_path):
    def shifted(t_s: Array, counts: Array) -> None:
        own = of_rows(2, 3)
        counts[:, own] = 222.0 - 2.0 * (240.5 - counts[:, own])

    found = diagnose(write(tmp_path / "bag", touch=shifted))
    shifts = [each for each in found.findings if each.effect == "bit_shift"]
    assert [(each.where.ids, each.parameters["shift"].value) for each in shifts] == [(((6,),), 2)]


def test_two_relaxations_that_delay_most_of_the_response_are_viscoelasticity_without_a_delay(tmp_path):
    def relaxing_twice(t_s: Array, p: Array) -> Array:
        return relaxing(0.65, 0.25)(t_s, p) + relaxing(0.2, 2.0)(t_s, p) - p

    (finding,) = diagnose(write(tmp_path / "bag", relaxing_twice)).findings
    assert finding.effect == "viscoelasticity"
    assert finding.where.scope == "insole"


def test_a_gain_of_one_half_is_no_bit_shift(tmp_path):
    def weaker(t_s: Array, counts: Array) -> None:
        own = of_rows(2, 3)
        counts[:, own] += 0.5 * np.round(240.5 - counts[:, own].mean(axis=1, keepdims=True))  # the noise stays

    found = diagnose(write(tmp_path / "bag", touch=weaker))
    (finding,) = found.findings
    assert finding.effect == "gain"
    assert finding.where.ids == ((6,),)
    assert finding.parameters["gain"].value == pytest.approx(0.5, abs=0.05)


def test_readings_that_are_no_power_of_two_too_large_are_no_bit_shift(tmp_path):
    def larger(t_s: Array, counts: Array) -> None:
        counts[:, SLOTS] = 240.5 - 2.4 * (240.5 - counts[:, SLOTS])

    found = diagnose(write(tmp_path / "bag", touch=larger))
    assert "bit_shift" not in {each.effect for each in found.findings}


@pytest.mark.parametrize("pads_count", [230.0, 254.0])  # the latter are out of range for half of the time
@pytest.mark.parametrize("count_per_pad_count", [0.0, 0.8])
def test_without_a_thermometer_the_thermal_pads_give_the_temperature(tmp_path, count_per_pad_count, pads_count):
    pads = np.setdiff1d(np.arange(72), SLOTS)

    def warm(t_s: Array, counts: Array) -> None:
        course = 4.0 * np.sin(t_s / 14.0)
        noise = np.random.default_rng(5).normal(0.0, 1.0, (len(t_s), len(pads)))
        counts[:, pads] = pads_count + np.linspace(-3.0, 3.0, len(pads)) - course[:, None] + noise
        counts[:, SLOTS] += count_per_pad_count * course[:, None]

    found = diagnose(write(tmp_path / "bag", touch=warm, temperature=None))
    assert [each.effect for each in found.findings] == (["temperature"] if count_per_pad_count else [])
    for each in found.findings:
        assert each.parameters == {}
        assert "thermal pads" in each.sentence


@pytest.mark.parametrize(("kelvin", "word"), [(0.6, "drift"), (4.0, "temperature")])
def test_a_drift_is_temperature_only_if_the_thermometer_moves_enough(tmp_path, kelvin, word):
    """Six counts in 0.6 K are ten times as much as a sensor of this kind has."""

    def drifting(t_s: Array, counts: Array) -> None:
        counts += 6.0 * t_s[:, None] / 90.0

    found = diagnose(write(tmp_path / "bag", touch=drifting, temperature=lambda t_s: 25.0 + kelvin * t_s / 90.0))
    assert [each.effect for each in found.findings] == [word]


def test_a_rezero_under_load_is_detected_with_its_time(tmp_path):
    def zeroed(t_s: Array, counts: Array) -> None:
        own = of_rows(4, 5)
        at = int(np.argmax(t_s > 4.5))
        counts[at:, own] += 240.0 - counts[at, own]

    found = diagnose(write(tmp_path / "bag", touch=zeroed))
    (finding,) = found.findings
    assert finding.effect == "rezero"
    assert finding.where.ids == ((7,),)
    assert finding.parameters["t_s"].value == pytest.approx(4.5, abs=0.3)


def test_before_is_the_error_of_the_calibration_on_the_readings(tmp_path):
    folder = write(tmp_path / "bag", relaxing(0.3, 0.8))
    foot, load_pa = loaded(folder)
    assert foot.calibration is not None
    coefficients = foot.calibration.coefficients_pa.reshape(72, -1)
    grid = np.linspace(-5.0, 80.0, 2000)
    off = []
    for slot in SLOTS.tolist():
        curve = np.polynomial.polynomial.polyval(grid, coefficients[slot])
        expected = np.interp(load_pa, np.maximum.accumulate(curve), grid)
        off.append(
            foot.calibration.baseline_count.ravel()[slot] - expected - foot.counts.reshape(len(foot), -1)[:, slot]
        )
    inside = (foot.t_ns * 1e-9 > BEGAN_S + 1) & (foot.t_ns * 1e-9 < BEGAN_S + 89)
    before = float(np.sqrt(np.mean(np.square(np.array(off)[:, inside]))))
    assert diagnose(folder).heldout["before"] == pytest.approx(before, rel=0.04)


def test_a_recording_without_the_effect_of_another_contradicts_it(tmp_path):
    folders = write(tmp_path / "with", relaxing(0.3, 0.8)), write(tmp_path / "without", seed=1)
    (finding,) = diagnose(*folders).findings
    assert finding.recordings == ("with",)
    assert finding.contradicted_by == ("without",)


def test_only_calibrated_triangles_are_diagnosed(tmp_path):
    def drift(t_s: Array, counts: Array) -> None:
        counts += 6.0 * np.minimum(t_s / 60.0, 1.0)[:, None]

    found = diagnose(write(tmp_path / "part", touch=drift, layout=WHOLE))  # of it, `write` calibrates six triangles
    (finding,) = found.findings
    assert finding.effect == "drift"
    assert found.verdict == "explained"


def test_a_recording_without_usable_readings_is_refused(tmp_path):
    def silent(t_s: Array, counts: Array) -> None:
        counts[:] = 240.0

    with pytest.raises(DiagnosisError, match="no taxel answers the pressure"):
        diagnose(write(tmp_path / "silent", touch=silent))


def snapping(t_s: Array, p: Array, up_pa: float = 71e3, down_pa: float = 39e3) -> Array:
    on, q = False, p.copy()
    for k, value in enumerate(p.tolist()):
        on = value >= up_pa or (on and value > down_pa)
        q[k] += 60e3 * on
    return q


def test_taxels_that_snap_more_than_the_rest_of_their_triangle_are_no_finding(tmp_path):
    strength = of_rows(0, 2, 3).astype(float)
    strength[SLOTS[2:4]] = 2.0
    found = diagnose(write(tmp_path / "bag", snapping, strength))
    assert [each.effect for each in found.findings] == ["snap"]


def test_strong_snaps_between_searched_thresholds_are_snaps_and_nothing_else(tmp_path):
    found = diagnose(write(tmp_path / "bag", snapping, of_rows(0, 2, 3)))
    (finding,) = found.findings
    assert finding.effect == "snap"
    assert set(finding.where.ids) == identities(0, 2, 3)
    values = {name: each.value for name, each in finding.parameters.items()}
    assert (values["up_pa"], values["down_pa"]) == pytest.approx((71e3, 39e3), rel=0.05)
    assert values["step_pa"] == pytest.approx(60e3, rel=0.1)


def test_the_mean_curve_of_a_snap_that_the_calibration_contains_is_no_error(tmp_path):
    folder = write(tmp_path / "bag", snapping)
    calibrate(folder, folder)
    found = diagnose(folder)
    (finding,) = found.findings
    assert finding.effect == "snap"
    assert finding.parameters["up_pa"].value == pytest.approx(71e3, rel=0.05)
    assert found.heldout["after"] < 1.02 * found.heldout["floor"]


def test_the_step_of_a_snap_is_measured_although_the_calibration_contains_it(tmp_path):
    """Its curves are too flat where the snap acts, and half of the taxels switch at loads that are 4 % higher."""
    low, high = (partial(snapping, up_pa=120e3 * factor, down_pa=45e3 * factor) for factor in (1.0, 1.04))
    half = np.random.default_rng(5).random(72) < 0.5
    calibrate(folder := write(tmp_path / "bag", low, half, elsewhere=high), folder)
    found = diagnose(folder)
    (finding,) = found.findings
    assert finding.effect == "snap"
    assert finding.parameters["step_pa"].value == pytest.approx(60e3, rel=0.1)
    (model := tmp_path / "model.json").write_text(json.dumps(found.model))
    verified = verify(found.static(), model, insole_daemon.load(folder), "left")
    assert verified.before == pytest.approx(found.heldout["before"], rel=0.1)
    assert verified.after < 1.3 * found.heldout["after"]


def test_a_memory_relaxes_from_the_steps_of_snaps_although_the_calibration_contains_both(tmp_path):
    memory = relaxing(0.7, 0.6)

    def both(t_s: Array, p: Array) -> Array:
        return memory(t_s, snapping(t_s, p))

    folder = write(tmp_path / "bag", both, of_rows(0, 2), elsewhere=memory)
    calibrate(folder, write(tmp_path / "calibrated", both, of_rows(0, 2), elsewhere=memory))
    found = diagnose(folder)
    by_word = {each.effect: each for each in found.findings}
    assert set(by_word) == {"viscoelasticity", "snap"}, [each.sentence for each in found.findings]
    assert set(by_word["snap"].where.ids) == identities(0, 2)
    # Without the relaxation of the steps, 1.06 times the floor is left.
    assert found.heldout["after"] < 1.03 * found.heldout["floor"]


def test_a_wrong_declared_clock_is_corrected_beside_hysteresis(tmp_path):
    """Hysteresis is computed from the load: at wrong times it would be different, with a creep beside it."""

    def late(t_s: Array, p: Array) -> Array:
        return np.interp(t_s - 0.23, t_s, p)

    found = diagnose(write(tmp_path / "bag", rubbing(0.5, 0.5, 30e3), reference=late))
    assert {each.effect for each in found.findings} == {"hysteresis", "clock"}
    (clock,) = (each for each in found.findings if each.effect == "clock")
    assert clock.parameters["offset_s"].value == pytest.approx(0.23, abs=0.02)


def _by_row(result: RecordingResult) -> RecordingResult:
    """Return a result as if the rows of the reference had no times."""
    reference = replace(result.seen.reference, has_times=False)
    load = replace(result.design.load, observation=replace(result.seen, reference=reference))
    return replace(result, design=replace(result.design, load=load))


def test_the_rate_of_a_clock_is_reported_unless_an_unknown_effect_of_the_insole_bends_it(tmp_path):
    fast = write(tmp_path / "bag", reference=lambda t_s, p: np.interp(1.005 * t_s, t_s, p), clock="own")
    found = diagnose(fast)
    (finding,), (result,) = found.findings, found.results
    assert finding.effect == "clock"
    assert 2e-5 < finding.parameters["rate"].std < 4e-5  # of good clocks, and of the fit
    (without_times,) = clock_findings(_by_row(replace(result, findings=())))
    std_s, with_times_s = (each.parameters["offset_s"].std for each in (without_times, finding))
    assert std_s == pytest.approx(np.hypot(with_times_s, 0.02 / np.sqrt(3.0)))  # any instant of a cycle
    of_triangle = replace(finding, effect="unknown", where=Where("triangle", (tuple(LAYOUT.identities[0].tolist()),)))
    assert [each.effect for each in clock_findings(replace(result, findings=(of_triangle,)))] == ["clock"]
    assert not clock_findings(replace(result, findings=(replace(of_triangle, where=Where()),)))


def test_a_declared_clock_that_is_seconds_off_is_the_only_finding(tmp_path):
    found = diagnose(write(tmp_path / "bag", reference=lambda t_s, p: np.interp(t_s - 3.0, t_s, p)))
    (finding,) = found.findings
    assert finding.effect == "clock"
    assert finding.parameters["offset_s"].value == pytest.approx(3.0, abs=0.02)
    assert found.verdict == "explained"
    assert found.heldout["before"] > 5.0 * found.heldout["after"]


def test_a_sharp_turning_point_of_the_pressure_is_no_leap_and_a_spike_is(tmp_path):
    def zigzag(t_s: Array, p: Array) -> Array:
        return 150e3 * np.abs((t_s / 0.9) % 2.0 - 1.0)  # 167 kPa/s up and down

    def leaping(t_s: Array, p: Array) -> Array:
        p[3000:3003] += 40e3
        p[5000:5002] -= 40e3
        p[7000:7003] += 40e3
        return p

    folder = write(tmp_path / "turns", zigzag, reference=zigzag)
    assert [each.effect for each in diagnose(folder).findings] == []
    (finding,) = diagnose(write(tmp_path / "leaps", reference=leaping)).findings
    assert finding.effect == "reference_fault"
