"""Walks with a force shoe: concealed effects are named, placed and modelled, and nothing else is found."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import insole_daemon
from insole_daemon.cli import app
from insole_daemon.diagnosis.audit import audit
from insole_daemon.diagnosis.compensation import of_walk
from insole_daemon.diagnosis.load_estimate import LoadEstimate
from insole_daemon.diagnosis.observations.walk import observe_walk
from insole_daemon.diagnosis.operators import flows, frictions, plays, relay
from insole_daemon.errors import DiagnosisError, UndecidableError
from insole_daemon.physics import calibration as calibrations
from insole_daemon.recording import counts as counts_file
from insole_daemon.recording.loading import load

from ..chamber import LAYOUT, SLOTS, Sensors
from ..chamber import write as write_chamber
from ..variations import MASKED, varied, without_a_board
from .shoe import DT_S, Array, change_force, late, write


def diagnose(folder: Path, out: Path, *options: str) -> dict:
    done = CliRunner().invoke(app, ["diagnose", str(folder), "--out", str(out), *options])
    assert done.exit_code == 0, (done.output, done.exception)
    return json.loads((out / "diagnosis.json").read_text())


def diagnose_any(folder: Path, out: Path, *options: str) -> dict:
    """As `diagnose`, whatever the verdict."""
    done = CliRunner().invoke(app, ["diagnose", str(folder), "--out", str(out), *options])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.output
    assert done.exit_code in (0, 1, 3), (done.output, done.exception)
    return json.loads((out / "diagnosis.json").read_text())


def solid(p: Array) -> Array:
    return 0.85 * p + 0.15 * late(p, 0.4)


def test_effects_together_are_named_modelled_and_shown(tmp_path):
    folder = write(tmp_path / "walk", lambda p: late(solid(p), 0.03), delay_s=0.03)
    found = diagnose(folder, tmp_path / "out")
    assert found["verdict"] == "explained"
    by_word = {each["effect"]: each for each in found["findings"]}
    assert set(by_word) == {"delay", "lag", "viscoelasticity"}
    assert {each["where"]["scope"] for each in found["findings"]} == {"insole"}
    assert by_word["delay"]["parameters"]["delay_s"]["value"] == pytest.approx(0.03, abs=0.006)
    assert by_word["lag"]["parameters"]["tau_s"]["value"] == pytest.approx(0.03, abs=0.006)
    assert by_word["viscoelasticity"]["parameters"]["a"]["value"] == pytest.approx(0.15, rel=0.25)
    assert by_word["viscoelasticity"]["heldout"]["unit"] == found["heldout"]["unit"] == "N"
    assert found["heldout"]["after"] < 0.2 * found["heldout"]["before"]
    assert found["heldout"]["m_y"]["after"] < 0.3 * found["heldout"]["m_y"]["before"]
    assert "crosstalk" in {each["effect"] for each in found["not_identifiable"]}
    layout = insole_daemon.load(folder)["left"].layout
    model = calibrations.load(tmp_path / "out" / "model.json", layout)
    assert [each.law.word for each in model.effects] == ["viscoelasticity", "lag", "delay"]
    assert "error of the force" in (tmp_path / "out" / "report.html").read_text()


def test_fast_viscoelasticity_is_reported_beside_a_lag(tmp_path):
    folder = write(tmp_path / "walk", lambda p: late(0.87 * p + 0.13 * late(p, 0.1), 0.035), seconds=40.0)
    found = diagnose(folder, tmp_path / "out")
    by_word = {each["effect"]: each["parameters"] for each in found["findings"]}
    assert set(by_word) == {"lag", "viscoelasticity"}
    # Which of the two has how much of the answer, only steeper edges would show.
    assert by_word["lag"]["tau_s"]["value"] == pytest.approx(0.035, abs=0.006)
    assert found["heldout"]["after"] < 1.15 * found["heldout"]["floor"]


@pytest.mark.parametrize("clock", ["can", "own"])
def test_a_null_has_no_finding(tmp_path, clock):
    found = diagnose(write(tmp_path / "walk", clock=clock), tmp_path / "out")
    assert found["verdict"] == "no mismatch"
    assert not found["findings"]


@pytest.mark.parametrize("faults", [[], ["dead_taxels"]], ids=["alone", "beside_a_dead_taxel"])
def test_a_model_without_any_effect_has_the_error_of_the_one_handed_in(tmp_path, faults):
    def folded_hum(t_s: Array, read: Array) -> None:
        read += 2.0 * np.sign(np.sin(2.0 * np.pi * 0.37 * t_s))[:, None]
        if faults:
            read[:, 0] = 97.0

    found = diagnose_any(write(tmp_path / "walk", touch=folded_hum, clock="own"), tmp_path / "out")
    assert [each["effect"] for each in found["findings"]] == ["unknown", *faults]
    for channel in (found["heldout"], found["heldout"]["m_x"], found["heldout"]["m_y"]):
        assert channel["after"] == channel["before"]


def test_standing_before_a_walk_is_no_rezero(tmp_path):
    found = diagnose(write(tmp_path / "walk", seconds=40.0, stands_s=9.0), tmp_path / "out")
    assert not found["findings"]


def test_a_wrong_rate_of_the_shoes_clock_is_reported(tmp_path):
    walk = write(tmp_path / "walk", clock="own", seconds=40.0)
    rows = (walk / "reference.csv").read_text().splitlines()
    at = rows[0].split(",").index("time_s")
    for i, row in enumerate(rows[1:], 1):
        cells = row.split(",")
        cells[at] = repr(float(cells[at]) * 1.004)
        rows[i] = ",".join(cells)
    (walk / "reference.csv").write_text("\n".join(rows) + "\n")
    (finding,) = diagnose_any(walk, tmp_path / "out")["findings"]
    assert finding["effect"] == "clock"
    assert finding["parameters"]["rate"]["value"] == pytest.approx(0.004, abs=2e-4)


def test_an_effect_of_one_board_is_placed_at_that_board(tmp_path):
    where = np.repeat(LAYOUT.identities[:, 0] == 7, 12)
    found = diagnose(write(tmp_path / "walk", solid, where), tmp_path / "out")
    (finding,) = found["findings"]
    assert finding["effect"] == "viscoelasticity"
    assert finding["parameters"]["a"]["value"] == pytest.approx(0.15, rel=0.1)
    assert finding["where"] == {"scope": "board", "ids": [[7]]}


def test_an_offset_of_the_reference_is_reported(tmp_path):
    walk = write(tmp_path / "walk")
    change_force(walk, lambda force_n: force_n + 5.0)
    (finding,) = diagnose_any(walk, tmp_path / "out")["findings"]
    assert finding["effect"] == "reference_fault"
    said_n = float(finding["sentence"].split("reads ")[1].split(" N")[0])
    assert said_n == pytest.approx(5.0, abs=0.5)


def test_a_drift_of_the_reference_from_its_zero_is_one_fault(tmp_path):
    walk = write(tmp_path / "walk")
    change_force(walk, lambda force_n: force_n - np.linspace(0.0, 60.0, len(force_n)))
    (finding,) = diagnose_any(walk, tmp_path / "out")["findings"]
    assert finding["effect"] == "reference_fault"


def test_a_preload_is_no_offset_of_a_reference_that_is_zero_in_the_air(tmp_path):
    found = diagnose_any(write(tmp_path / "walk", lambda p: p + 5e3), tmp_path / "out")
    (finding,) = found["findings"]
    assert finding["effect"] == "preload"
    assert finding["parameters"]["p0_pa"]["value"] == pytest.approx(5e3, rel=0.15)


def test_a_creep_larger_than_the_immediate_response_is_undone(tmp_path):
    def creeping(p: Array) -> Array:
        return 0.25 * p + 0.25 * (late(p, 0.7) + late(p, 6.0) + late(p, 30.0))

    found = diagnose_any(write(tmp_path / "walk", creeping, seconds=60.0), tmp_path / "out")
    (finding,) = found["findings"]
    assert finding["effect"] == "creep"
    assert finding["where"]["scope"] == "insole"
    assert sum(finding["parameters"]["a"]["value"]) == pytest.approx(0.75, abs=0.08)
    assert found["heldout"]["after"] < 0.08 * found["heldout"]["before"]


def test_a_delay_is_measured_beside_a_creep(tmp_path):
    """Columns that are computed from the reference move with it."""

    def creeping(p: Array) -> Array:
        return 0.7 * p + sum(0.075 * late(p, tau_s) for tau_s in (0.5, 2.0, 8.0, 32.0))

    found = diagnose_any(write(tmp_path / "walk", creeping, delay_s=0.014, seconds=40.0), tmp_path / "out")
    by_word = {each["effect"]: each for each in found["findings"]}
    assert set(by_word) == {"creep", "delay"}
    assert by_word["delay"]["parameters"]["delay_s"]["value"] == pytest.approx(0.014, abs=0.002)


def test_activated_creep_is_named_beside_a_lag(tmp_path):
    """A flow that is the faster, the farther it is from equilibrium (Eyring): no sum of relaxations describes it."""

    def flowing(p: Array) -> Array:
        return late(p - 0.3 * flows(p, np.array([60.0]), np.array([25e3]), DT_S)[0], 0.02)

    found = diagnose_any(write(tmp_path / "walk", flowing, seconds=40.0), tmp_path / "out")
    by_word = {each["effect"]: each for each in found["findings"]}
    assert set(by_word) == {"creep", "lag"}
    assert by_word["lag"]["parameters"]["tau_s"]["value"] == pytest.approx(0.02, abs=0.004)


@pytest.mark.parametrize(
    ("sensor", "word", "shares"),
    [
        (lambda p: 0.91 * p + sum(0.0975 * late(p, tau_s) for tau_s in (0.5, 2.0, 8.0, 32.0)), "creep", [0.075] * 4),
        (lambda p: 0.6 * p + 0.6 * late(p, 0.3), "viscoelasticity", 0.5),
    ],
)
def test_a_model_leaves_of_another_walk_what_was_held_out(tmp_path, sensor, word, shares):
    """Also if the calibration was made while the memory acted, so that its curves are 20 or 30 % too high."""
    another = write(tmp_path / "another", sensor, seconds=60.0)
    walk = write(tmp_path / "walk", sensor, seconds=40.0)
    (finding,) = (found := diagnose_any(walk, tmp_path / "out", "--verify", str(another)))["findings"]
    assert finding["effect"] == word
    assert finding["parameters"]["a"]["value"] == pytest.approx(shares, rel=0.12)
    verified = json.loads((tmp_path / "out" / "verification.json").read_text())
    assert verified["after"] < 1.3 * found["heldout"]["after"]


@pytest.mark.parametrize(("up_pa", "down_pa"), [(30e3, 30e3), (20e3, 60e3)])
def test_friction_that_grows_with_the_load_is_named_hysteresis(tmp_path, up_pa, down_pa):
    """The friction of Dahl (1968) between layers that the load presses together; no sum of plays describes it."""

    def rubbing(p: Array) -> Array:
        return p - 25e3 / (up_pa + down_pa) * p / p.max() * frictions(p, np.array([up_pa]), np.array([down_pa]))[0]

    another = write(tmp_path / "another", rubbing, seconds=30.0)
    found = diagnose_any(write(tmp_path / "walk", rubbing), tmp_path / "out", "--verify", str(another))
    assert [each["effect"] for each in found["findings"]] == ["hysteresis"]
    assert found["heldout"]["after"] < 1.5 * found["heldout"]["floor"]
    verified = json.loads((tmp_path / "out" / "verification.json").read_text())
    assert verified["after"] < 0.7 * verified["before"]
    (effect,) = json.loads((tmp_path / "out" / "model.json").read_text())["effects"]
    assert all(half_pa > 0.0 for half_pa in effect["parameters"]["half_pa"]["value"])


def test_a_rezero_under_the_foot_is_detected_and_only_earlier_rows_are_used(tmp_path):
    own = np.repeat(LAYOUT.identities[:, 0] == 6, 12)

    def anew(t_s: Array, read: Array) -> None:
        at = 28.0 + np.argmax(240.0 - read[(t_s > 28.0) & (t_s < 31.0)][:, own].mean(axis=1)) * 0.02
        said = read[np.argmin(np.abs(t_s - at))].copy()
        read[np.ix_(t_s > at, own)] += 240.0 - said[own]
        held = (t_s > at) & (t_s < at + 0.1)  # meanwhile it says nothing new
        read[np.ix_(held, own)] = said[own]

    walk = write(tmp_path / "walk", solid, seconds=45.0, touch=anew, clock="own")
    found = diagnose_any(walk, tmp_path / "out")
    by_word = {each["effect"]: each for each in found["findings"]}
    assert set(by_word) == {"rezero", "viscoelasticity"}
    assert by_word["rezero"]["where"] == {"scope": "board", "ids": [[6]]}
    assert 27.9 < by_word["rezero"]["parameters"]["t_s"]["value"] < 31.2
    assert by_word["viscoelasticity"]["parameters"]["a"]["value"] == pytest.approx(0.15, rel=0.25)
    assert found["heldout"]["after"] < 0.1 * found["heldout"]["before"]


def test_a_smaller_bit_shift_is_named_and_a_gain_of_two_is_none(tmp_path):
    own = np.repeat(LAYOUT.identities[:, 0] == 6, 12)

    def shifted(t_s: Array, read: Array) -> None:
        read[:, own] = np.clip(240.0 - 2.0 * (240.0 - read[:, own]), 0.0, 255.0)

    found = diagnose_any(write(tmp_path / "shifted", touch=shifted), tmp_path / "1")
    (finding,) = found["findings"]
    assert (finding["effect"], finding["where"]) == ("bit_shift", {"scope": "board", "ids": [[6]]})
    assert found["heldout"]["after"] < 0.1 * found["heldout"]["before"]
    assert found["heldout"]["m_y"]["after"] < 0.1 * found["heldout"]["m_y"]["before"]
    twice = np.where(own, 2.0, 1.0)
    found = diagnose_any(write(tmp_path / "twice", lambda p: p * twice), tmp_path / "2")
    (finding,) = found["findings"]
    assert (finding["effect"], finding["where"]) == ("gain", {"scope": "board", "ids": [[6]]})


def test_a_bit_shift_is_named_where_the_counts_without_load_are_far_from_no_load(tmp_path):
    """They shift, too, so the board's part of the force is not half or twice as large."""
    own = np.repeat(LAYOUT.identities[:, 0] == 6, 12)
    drawn = Sensors.drawn(np.random.default_rng(3))
    sensors = replace(drawn, rest=drawn.rest - 12.0)

    def shifted(t_s: Array, read: Array) -> None:
        read[:, own] = np.clip(240.0 - 2.0 * (240.0 - read[:, own]), 0.0, 255.0)

    found = diagnose_any(write(tmp_path / "shifted", touch=shifted, sensors=sensors), tmp_path / "out")
    assert [(each["effect"], each["where"]["ids"]) for each in found["findings"]] == [("bit_shift", [[6]])]


def test_a_bit_shift_is_named_alone_if_its_readings_are_saturated_under_the_foot(tmp_path):
    """The load above the end of the range is not read, which looks like a stiffening of the board."""
    own = np.repeat(LAYOUT.identities[:, 0] == 6, 12)
    drawn = Sensors.drawn(np.random.default_rng(3))
    sensitive = replace(drawn, sensitivity=5.0 * drawn.sensitivity)

    def shifted(t_s: Array, read: Array) -> None:
        read[:, own] = np.clip(240.0 - 2.0 * (240.0 - read[:, own]), 0.0, 255.0)

    found = diagnose_any(write(tmp_path / "shifted", touch=shifted, sensors=sensitive), tmp_path / "out")
    assert [(each["effect"], each["where"]["ids"]) for each in found["findings"]] == [("bit_shift", [[6]])]


def test_a_triangle_that_reads_less_than_half_has_a_gain(tmp_path):
    """The readings are multiplied by 2.5 in the model: a column at the present ones is no approximation of that."""
    own = np.repeat(np.arange(len(LAYOUT)) == 2, 12)
    found = diagnose_any(write(tmp_path / "walk", lambda p: 0.4 * p, own), tmp_path / "out")
    (finding,) = found["findings"]
    place = {"scope": "triangle", "ids": [LAYOUT.identities[2].tolist()]}
    assert (finding["effect"], finding["where"]) == ("gain", place)
    assert finding["parameters"]["gain"]["value"] == pytest.approx(0.4, abs=0.04)


def test_a_walk_of_which_one_triangle_was_recorded_is_diagnosed(tmp_path):
    folder = write(tmp_path / "walk")
    table = counts_file.read(folder / "counts.npz", {"left": len(LAYOUT)})["left"]
    age_ms = np.full_like(table.age_ms, np.nan)
    age_ms[:, 2] = table.age_ms[:, 2]
    (folder / "counts.npz").unlink()
    counts_file.write(folder / "counts.npz", {"left": replace(table, age_ms=age_ms)})
    diagnose_any(folder, tmp_path / "out")


def test_hysteresis_is_detected_in_a_walk_that_begins_on_the_foot(tmp_path):
    walk = write(tmp_path / "walk", lambda p: p + 0.3 * plays(p, np.array([20e3]))[0], stands_s=1.0)
    found = diagnose(walk, tmp_path / "out")
    (finding,) = found["findings"]
    assert finding["effect"] == "hysteresis"
    assert finding["where"]["scope"] == "insole"
    assert found["heldout"]["after"] < 0.3 * found["heldout"]["before"]


def test_a_preload_is_detected_beside_a_loop(tmp_path):
    """The second in the air before the first step shows it, whatever the law of the loop leaves."""

    def loop_and_preload(p: Array) -> Array:
        return p - 0.15 * frictions(p, np.array([30e3]), np.array([10e3]))[0] + 3e3

    found = diagnose_any(write(tmp_path / "walk", loop_and_preload), tmp_path / "out")
    assert {finding["effect"] for finding in found["findings"]} == {"hysteresis", "preload"}
    (preload,) = [finding for finding in found["findings"] if finding["effect"] == "preload"]
    assert preload["parameters"]["p0_pa"]["value"] == pytest.approx(3e3, rel=0.3)


def test_noise_does_not_let_friction_decay_while_a_foot_stands(tmp_path):
    walk = load(write(tmp_path / "walk", stands_s=10.0))
    (foot,) = walk.feet
    estimate = LoadEstimate(observe_walk(walk, foot, foot.calibration))
    standing = (estimate.observation.t_s > 1.0) & (estimate.observation.t_s < 9.0)
    width_pa = np.array([20e3])

    def decay(pressure_pa: Array) -> float:
        friction = frictions(pressure_pa.reshape(len(pressure_pa), -1)[:, SLOTS], width_pa, width_pa)[0]
        return 1.0 - float(friction[standing].mean()) / (2.0 * width_pa[0])

    assert decay(estimate.pressure_pa) > 0.3
    assert abs(decay(estimate.held_pa)) < 0.15


def test_several_walks_give_one_diagnosis(tmp_path):
    sensors = Sensors.drawn(np.random.default_rng(1))  # of one insole
    walks = [
        write(tmp_path / name, solid, seed=seed, clock="own", sensors=sensors)
        for name, seed in (("one", 1), ("two", 2))
    ]
    found = diagnose(walks[0], tmp_path / "out", str(walks[1]))
    (finding,) = found["findings"]
    assert finding["effect"] == "viscoelasticity"
    assert finding["recordings"] == ["one", "two"]
    assert finding["contradicted_by"] == []
    assert finding["parameters"]["a"]["value"] == pytest.approx(0.15, rel=0.25)
    assert [each["recording"] for each in found["alignment"]] == ["one", "two"]
    assert [each["offset_s"] for each in found["alignment"]] == pytest.approx([3.1, 3.1], abs=0.05)


def test_contradicting_walks_are_named_and_the_majority_has_the_model(tmp_path):
    sensors = Sensors.drawn(np.random.default_rng(1))
    one, two, three = (
        write(tmp_path / name, effect, seed=seed, seconds=16.0, sensors=sensors)
        for seed, (name, effect) in enumerate((("one", lambda p: p), ("two", solid), ("three", solid)), 1)
    )
    found = diagnose(one, tmp_path / "out", str(two), str(three))
    (finding,) = found["findings"]
    assert finding["effect"] == "viscoelasticity"
    assert finding["recordings"] == ["two", "three"]
    assert finding["contradicted_by"] == ["one"]
    assert finding["parameters"]["a"]["value"] == pytest.approx(0.15, rel=0.2)
    assert found["heldout"]["after"] < 0.4 * found["heldout"]["before"]
    assert [each["recording"] for each in found["alignment"]] == ["one", "two", "three"]
    (effect,) = json.loads((tmp_path / "out" / "model.json").read_text())["effects"]
    assert effect["effect"] == "viscoelasticity"


def test_a_simulated_trial_is_diagnosed_from_its_frames(tmp_path):
    trial, effects, walk = tmp_path / "trial.yaml", tmp_path / "effects.yaml", tmp_path / "walk"
    reference = {"offset_s": 0, "rate_ppm": 0}
    trial.write_text(json.dumps({"format": "insole-trial/1", "length_s": 30, "reference": reference}))
    concealed = [
        {"effect": "viscoelasticity", "where": {"scope": "insole"},
         "parameters": {"a": {"value": 0.1, "unit": "1"}, "tau_s": {"value": 0.4, "unit": "s"}}},
        {"effect": "delay", "where": {"scope": "insole"}, "parameters": {"delay_s": {"value": 0.03, "unit": "s"}}},
    ]  # fmt: skip
    effects.write_text(json.dumps({"format": "insole-effects/1", "effects": concealed}))
    arguments = ["simulate", "t4", "--out", walk, "--seed", 4, "--trial", trial, "--effects", effects]
    done = CliRunner().invoke(app, [str(each) for each in arguments])
    assert done.exit_code == 0, (done.output, done.exception)
    recording = walk / "recording.yaml"
    recording.write_text(recording.read_text().replace("clock: own", "clock: can"))
    done = CliRunner().invoke(app, ["diagnose", str(walk), "--out", str(tmp_path / "out")])
    assert isinstance(done.exception, DiagnosisError)
    assert "--foot left" in str(done.exception)
    found = diagnose_any(walk, tmp_path / "out", "--foot", "left")
    told = [(each["effect"], each["parameters"]) for each in found["findings"]]
    assert {word for word, _ in told} >= {"viscoelasticity", "delay"}, told
    assert "lag" not in {word for word, _ in told}, told
    assert found["heldout"]["after"] < 0.2 * found["heldout"]["before"], found["heldout"]


@pytest.mark.parametrize(("cycles", "found"), [(6, []), (1, ["dead_taxels"])])
def test_a_heel_strike_is_no_loose_contact_and_a_leap_that_reverses_at_once_is(tmp_path, cycles, found):
    foot = load(write(tmp_path / "walk", seconds=12.0)).feet[0]
    counts = foot.counts.copy()
    for begin in range(100, 500, 60):
        counts[begin : begin + cycles, 0, :3] = 100
    audited = audit(replace(foot, counts=counts), "walk", steps=True)
    assert [each.effect for each in audited.findings] == found
    assert audited.usable_taxels[0, :3].all() == (not found)


def test_bad_walks_are_refused_with_a_sentence(tmp_path):
    def refused(kind: type[Exception], *folders: Path) -> str:
        done = CliRunner().invoke(app, ["diagnose", *map(str, folders), "--out", str(tmp_path / "out")])
        assert isinstance(done.exception, kind), (done.output, done.exception)
        assert not (tmp_path / "out").exists()
        return str(done.exception)

    walk = write(tmp_path / "walk", seconds=8.0)
    assert "was the shoe recorded" in refused(DiagnosisError, write(tmp_path / "still", seconds=8.0, force=0.0))
    assert "at least 3 steps" in refused(UndecidableError, write(tmp_path / "step", seconds=3.5))
    assert "--calibration" in refused(DiagnosisError, write(tmp_path / "bare", seconds=8.0, calibrated=False))
    free = write_chamber(tmp_path / "free", seconds=8.0)
    document = (free / "recording.yaml").read_text()
    (free / "recording.yaml").write_text(document[: document.index("reference:")].replace("chamber", "free"))
    assert "leave it out" in refused(DiagnosisError, walk, free)


def test_a_curve_that_stiffens_beyond_its_calibration_is_corrected(tmp_path):
    straight = write(tmp_path / "straight")
    bent = write(tmp_path / "bent", lambda p: p - 0.15 * p * (p / 2e5) ** 2)
    found = diagnose(bent, tmp_path / "out")
    assert [each["effect"] for each in found["findings"]] == ["stiffening"]
    usual = error_of_model_n(straight, straight / "calibration.json")
    assert error_of_model_n(bent, bent / "calibration.json") > 2 * usual
    assert error_of_model_n(bent, tmp_path / "out" / "model.json") < 1.2 * usual


def error_of_model_n(folder: Path, model: Path) -> float:
    """The standard deviation of the daemon's force with a model against the shoe's."""
    t_s, f_z_n = of_walk(model, folder)["left"]
    shoe = insole_daemon.load(folder)["left"].reference
    return float(np.std(f_z_n - np.interp(t_s, shoe.time_s, shoe["fz_n"])))


def contain_mean_curve(folder: Path, before_pa: Array, after_pa: Array) -> None:
    """Replace the curves of a calibration by cubic ones that return the load `before_pa` of pressures `after_pa`."""
    path = folder / "calibration.json"
    model = json.loads(path.read_text())
    for taxel in model["taxels"]:
        count = after_pa / taxel["coefficients_pa"][1]
        powers = np.vander(count, 4, increasing=True)[:, 1:]
        taxel["coefficients_pa"] = [0.0, *np.linalg.lstsq(powers, before_pa, rcond=None)[0].tolist()]
    path.write_text(json.dumps(model))


@pytest.mark.parametrize(("up_pa", "down_pa", "step_pa"), [(170e3, 60e3, 110e3), (190e3, 30e3, 100e3)])
def test_a_snap_that_acted_while_the_insole_was_calibrated_is_named_and_undone(tmp_path, up_pa, down_pa, step_pa):
    folder = write(tmp_path / "walk", lambda p: p + step_pa * relay(p, up_pa, down_pa), seconds=40.0)
    load_pa = np.linspace(0.0, 260e3, 200)
    part = np.where(load_pa > up_pa, 1.0, np.where(load_pa > down_pa, 0.5, 0.0))
    contain_mean_curve(folder, load_pa, load_pa + step_pa * part)
    found = diagnose(folder, tmp_path / "out")
    ((word, place, parameters),) = [(e["effect"], e["where"]["scope"], e["parameters"]) for e in found["findings"]]
    assert (word, place) == ("snap", "insole")
    for name, true in (("up_pa", up_pa), ("down_pa", down_pa), ("step_pa", step_pa)):
        assert parameters[name]["value"] == pytest.approx(true, abs=2.0 * parameters[name]["std"])
    assert parameters["step_pa"]["value"] == pytest.approx(step_pa, rel=0.15)
    as_handed_in = error_of_model_n(folder, folder / "calibration.json")
    assert error_of_model_n(folder, tmp_path / "out" / "model.json") < 0.3 * as_handed_in


def test_a_snap_that_stood_for_a_creep_is_removed_beside_it(tmp_path):
    """A slow creep that the calibration contains looks like a snap until the curves are corrected for it."""
    folder = write(tmp_path / "walk", lambda p: 1.25 * (0.6 * p + 0.4 * late(p, 8.0)), seconds=40.0)
    found = diagnose(folder, tmp_path / "out")
    assert [each["effect"] for each in found["findings"]] == ["creep"]
    assert found["heldout"]["after"] < 1.1 * found["heldout"]["floor"]


def test_an_uncalibrated_board_gives_no_finding_and_is_in_the_report(tmp_path):
    folder = varied(write(tmp_path / "walk"), tmp_path / "masked", without_a_board)
    found = diagnose(folder, tmp_path / "out")
    assert (found["verdict"], found["findings"]) == ("no mismatch", [])
    assert f"it does not list board {MASKED}" in (tmp_path / "out" / "report.html").read_text()
    listed = {each["board"] for each in json.loads((tmp_path / "out" / "model.json").read_text())["taxels"]}
    assert listed == {5, 6, 7} - {MASKED}
