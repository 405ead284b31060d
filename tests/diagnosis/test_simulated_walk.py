"""A walk against a simulated one of the same trial: placement, nulls, the model, bad input."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from insole_daemon import config as configs
from insole_daemon.cli import app
from insole_daemon.diagnosis import prediction
from insole_daemon.diagnosis.load_error import largest_but_one_board
from insole_daemon.diagnosis.load_estimate import KnownLoad, TaxelLoad
from insole_daemon.diagnosis.model.blocks import BlockDesign, block_design
from insole_daemon.diagnosis.observations.load_field import Move
from insole_daemon.diagnosis.observations.pad_temperature import pad_course
from insole_daemon.diagnosis.observations.reading_faults import reading_faults
from insole_daemon.diagnosis.observations.readings import read_triangles
from insole_daemon.diagnosis.observations.rezeros import correct_rezeros
from insole_daemon.diagnosis.observations.taxel_faults import correct_taxels
from insole_daemon.diagnosis.observing import observed
from insole_daemon.diagnosis.operators import low_pass
from insole_daemon.diagnosis.select.thresholds import refine_thresholds
from insole_daemon.diagnosis.terms import lag
from insole_daemon.errors import DiagnosisError
from insole_daemon.physics import calibration as calibrations
from insole_daemon.physics.effect import Effect, Where, effect
from insole_daemon.recording import counts as counts_file
from insole_daemon.recording.counts import CountsTable
from insole_daemon.recording.loading import load
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.conditions import Conditions, TemperatureCourse
from insole_daemon.simulation.trial import Trial
from insole_daemon.skin.layout import Layout

CONFIG = configs.load(None)
WHOLE = load_layout(CONFIG.insoles[0])
# Half of the triangles are enough to tell places apart, and the search takes half the time.
LAYOUT = Layout("left", WHOLE.taxel_area_m2, WHOLE.area_meaning, WHOLE.triangles[::2], WHOLE.xy_m[::2])
SECONDS = 30.0
SWAP = tuple(tuple(each) for each in WHOLE.identities[[3, 15]].tolist())


def walk(
    folder: Path,
    *effects: Effect,
    take: int = 1,
    scenario: str = "t4",
    seconds: float = SECONDS,
    layout: Layout = LAYOUT,
    warmth: TemperatureCourse | None = None,
) -> Path:
    """The trial as a recording of an insole with these effects; another take has other noise."""
    chosen, conditions = {"left": tuple(effects)}, Conditions(take=take, temperature=warmth)
    trial = Trial(scenario, CONFIG, [layout], effects=chosen, conditions=conditions, seed=11)
    trial.write(folder, seconds)
    return folder


@pytest.fixture(scope="module")
def plain(tmp_path_factory) -> Path:
    return walk(tmp_path_factory.mktemp("plain") / "simulation", take=0)


@pytest.fixture(scope="module")
def plain_whole(tmp_path_factory) -> Path:
    """The simulation of a whole insole."""
    return walk(tmp_path_factory.mktemp("whole") / "simulation", take=0, layout=WHOLE)


def diagnosed(folder: Path, simulation: Path, out: Path) -> list[dict]:
    """The findings of a diagnosis that explains the recording."""
    done = CliRunner().invoke(app, ["diagnose", str(folder), "--simulation", str(simulation), "--out", str(out)])
    assert done.exit_code == 0, done.output
    said = json.loads((out / "diagnosis.json").read_text())
    assert said["against"] == "simulation"
    return said["findings"]


def test_a_null_has_no_finding_and_its_model_predicts_the_counts(tmp_path, plain_whole):
    folder, out = walk(tmp_path / "walk", layout=WHOLE), tmp_path / "out"
    assert [each["sentence"] for each in diagnosed(folder, plain_whole, out)] == []
    told = json.loads((out / "diagnosis.json").read_text())["not_identifiable"]
    assert "map_transform" not in [each["effect"] for each in told]
    expected = prediction.of_folder(out / "model.json", folder, plain_whole)["left"]
    left = load(folder).feet[0].counts - expected
    assert np.sqrt(np.nanmean(left**2)) < 1.2


def design_of(folder: Path, simulation: Path) -> BlockDesign:
    recording = load(folder)
    (seen,) = observed([recording], list(recording.feet), None, lambda text: None, (load(simulation),))
    return block_design(KnownLoad(seen), reading_faults(recording.feet[0], seen).weights_of(seen))


def test_a_taxel_that_a_displaced_insole_explains_has_no_gain_of_its_own(tmp_path, plain):
    recording = load(walk(tmp_path / "walk"))
    (seen,) = observed([recording], list(recording.feet), None, lambda text: None, (load(plain),))
    shift_pa = seen.field.change_by(Move(x_mm=1.0, y_mm=1.5)).at(seen.reference_s)
    from_median_pa = shift_pa - np.median(np.where(seen.usable, shift_pa, 0.0), axis=2, keepdims=True)
    shift_count = from_median_pa / np.maximum(seen.slope_pa, 1e-9)
    in_proportion = np.abs(np.sum(shift_count * seen.expected_count, axis=0))
    most = np.where(seen.usable, in_proportion / np.sqrt(np.sum(seen.expected_count**2, axis=0) + 1.0), 0.0)
    shift_count[:, most < most.max()] = 0.0

    def found(activation_count: np.ndarray) -> list[tuple[str, tuple]]:
        odd = correct_taxels(replace(seen, activation_count=activation_count), seen.usable)[1]
        return [(finding.effect, finding.where.ids) for finding in odd.findings]

    assert found(seen.activation_count + shift_count) == []
    loaded = int(np.argmax(np.where(seen.usable, np.sum(seen.expected_count**2, axis=0), 0.0)))
    with_gain = seen.activation_count.copy()
    with_gain[:, loaded // 12, loaded % 12] *= 1.2
    assert found(with_gain) == [("gain", ((*seen.layout.identities[loaded // 12].tolist(), loaded % 12),))]


@pytest.mark.parametrize("together", [0, 1])
def test_a_triangle_that_snaps_as_one_is_told_from_taxels_that_snap_alone(tmp_path, plain_whole, together):
    where = Where("triangle", (tuple(WHOLE.identities[7].tolist()),))
    snap = effect("snap", where, up_pa=4e4, down_pa=2e4, step_pa=4e4, together=together)
    design = design_of(walk(tmp_path / "walk", snap, layout=WHOLE), plain_whole)
    settings = [setting for (_, place), setting in refine_thresholds(design).items() if place == where]
    assert bool(settings) == bool(together), "thresholds of taxels that switch alone stay on the grid"
    for setting in settings:
        assert setting["together"] == 1.0
        assert setting["up_pa"] == pytest.approx(4e4, rel=0.1)
        assert setting["down_pa"] == pytest.approx(2e4, rel=0.1)


def with_pace_of_its_own(folder: Path, plain: Path, most_s: float) -> Path:
    """The simulation `plain`, whose steps come up to `most_s` earlier or later than the walk's."""
    shutil.copytree(plain, folder)
    recording = load(plain)
    (foot,) = recording.feet
    t_s = (foot.t_ns - foot.t_ns[0]) * 1e-9
    moved_s = np.clip(t_s + most_s * np.sin(2 * np.pi * t_s / 11.0), 0.1, t_s[-1] - 0.1)
    moved = np.stack([readings.at(moved_s) for readings in read_triangles(recording, foot)], axis=1)
    moved = np.rint(np.nan_to_num(moved)).astype(np.uint8)
    counts_file.write(folder / "counts.npz", {"left": CountsTable(foot.t_ns, moved)})
    (folder / "can.log").unlink()
    document = folder / "recording.yaml"
    document.write_text(document.read_text().replace("can: can.log", "counts: counts.npz"))
    return folder


def test_a_walk_in_another_pace_than_its_simulation_has_no_finding(tmp_path, plain):
    simulation = with_pace_of_its_own(tmp_path / "simulation", plain, most_s=0.03)
    assert [each["effect"] for each in diagnosed(walk(tmp_path / "walk"), simulation, tmp_path / "out")] == []


def test_what_one_board_alone_shows_is_no_error_of_the_load(tmp_path, plain_whole):
    walked = walk(tmp_path / "walk", layout=WHOLE)
    null = design_of(walked, plain_whole)
    other = design_of(walked, with_pace_of_its_own(tmp_path / "simulation", plain_whole, most_s=0.03))
    of_one_board = np.where((WHOLE.identities[:, 0] == 7)[:, None], other.y, null.y)
    none, one, every = (largest_but_one_board(replace(null, y=y)) for y in (null.y, of_one_board, other.y))
    assert one <= none < every


@pytest.mark.parametrize(("shift_mm", "rotation_deg"), [((5.0, -3.0), 2.0), ((12.0, -9.0), 7.0)])
def test_a_displaced_map_is_detected(tmp_path, plain, shift_mm, rotation_deg):
    """Also one of a centimetre, which is no straight line: most triangles then bear the load of a neighbour."""
    askew = effect("map_transform", Where(), x_mm=shift_mm[0], y_mm=shift_mm[1], rotation_deg=rotation_deg, scale=1.0)
    (found,) = diagnosed(walk(tmp_path / "walk", askew), plain, tmp_path / "out")
    assert found["effect"] == "map_transform"
    assert found["explains"] > 0.99
    values = {name: each["value"] for name, each in found["parameters"].items()}
    assert (values["x_mm"], values["y_mm"]) == pytest.approx(shift_mm, abs=1.0)
    assert values["rotation_deg"] == pytest.approx(rotation_deg, abs=0.5)
    assert values["scale"] == pytest.approx(1.0, abs=0.02)


def test_counts_after_the_end_of_a_simulation_are_predicted_by_continuing_the_walk(tmp_path):
    short, folder = walk(tmp_path / "simulation", take=0, seconds=17.2), walk(tmp_path / "walk", seconds=18.0)
    foot = load(folder).feet[0]
    (calibration,) = folder.glob("*calibration*")
    expected = prediction.of_folder(calibration, folder, short)["left"]
    assert np.isfinite(expected[:, :, :6]).all()
    t_s = (foot.t_ns - foot.t_ns[0]) * 1e-9
    after, moment = t_s > 17.3, np.searchsorted(t_s, 17.1)
    left = np.sqrt(np.nanmean((foot.counts - expected)[after] ** 2))
    still = np.sqrt(np.nanmean((foot.counts - expected[moment])[after] ** 2))
    assert left < 0.6 * still, (left, still)


def test_swapped_triangles_are_detected(tmp_path, plain_whole):
    out, swap = tmp_path / "out", effect("swapped_triangles", Where(), pair=SWAP)
    (found,) = diagnosed(walk(tmp_path / "walk", swap, layout=WHOLE), plain_whole, out)
    assert found["effect"] == "swapped_triangles"
    assert found["where"] == {"scope": "triangle", "ids": [list(each) for each in SWAP]}
    assert found["confidence"] > 0.9
    (effect_of_model,) = calibrations.load(out / "model.json", WHOLE).effects
    assert effect_of_model.law.word == "swapped_triangles"
    assert effect_of_model.where.ids == SWAP


def test_an_effect_of_all_taxels_is_placed_on_the_insole_and_is_no_displaced_map(tmp_path, plain):
    folder = walk(tmp_path / "walk", effect("viscoelasticity", Where(), a=0.12, tau_s=0.4))
    (found,) = diagnosed(folder, plain, tmp_path / "out")
    assert found["effect"] == "viscoelasticity"
    assert found["where"] == {"scope": "insole", "ids": []}
    assert found["parameters"]["a"]["value"] == pytest.approx(0.12, abs=0.03)
    assert found["parameters"]["tau_s"]["value"] == pytest.approx(0.4, rel=0.3)


def test_a_loop_that_closes_as_the_load_vanishes_is_one(tmp_path, plain):
    board = Where("board", ((5,),))
    closing = effect("hysteresis", board, r_pa=[12e3, 24e3], w=[0.3, 0.3], half_pa=[80e3, 80e3])
    (found,) = diagnosed(walk(tmp_path / "walk", closing), plain, tmp_path / "out")
    assert (found["effect"], found["where"]) == ("hysteresis", {"scope": "board", "ids": [[5]]})
    values = {name: np.array(found["parameters"][name]["value"]) for name in ("w", "half_pa")}
    assert values["w"][values["half_pa"] > 0].sum() > 0.2


def test_a_preload_is_placed_under_the_straps(tmp_path, plain_whole):
    along = WHOLE.xy_m[..., 0].mean(axis=1)
    p0_pa = 15e3 + 25e3 * np.exp(-(((along - np.median(along)) / 0.06) ** 2))
    places = [Where("triangle", (tuple(identity),)) for identity in WHOLE.identities.tolist()]
    straps = [effect("preload", place, p0_pa=value) for place, value in zip(places, p0_pa.tolist(), strict=True)]
    (found,) = diagnosed(walk(tmp_path / "walk", *straps, layout=WHOLE), plain_whole, tmp_path / "out")
    assert found["effect"] == "preload"
    assert found["parameters"]["p0_pa"]["value"] == pytest.approx(p0_pa.mean(), rel=0.1)
    model = json.loads((tmp_path / "out" / "model.json").read_text())["effects"]
    of_triangle = {tuple(each["where"]["ids"][0]): each["parameters"]["p0_pa"]["value"] for each in model}
    in_model_pa = np.array([of_triangle[tuple(identity)] for identity in WHOLE.identities.tolist()])
    assert np.abs(in_model_pa / p0_pa - 1.0).max() < 0.3


def test_a_gain_that_the_temperature_changes_is_no_error_of_the_load(tmp_path):
    warmth = TemperatureCourse(t_s=(0.0, 15.0, 30.0), temperature_c=(24.0, 27.0, 24.5))
    simulation = walk(tmp_path / "simulation", take=0, layout=WHOLE, warmth=warmth)
    warmed = effect("temperature", Where(), count_per_k=0.0, gain_per_k=0.045, t0_c=29.0)
    (found,) = diagnosed(walk(tmp_path / "walk", warmed, layout=WHOLE, warmth=warmth), simulation, tmp_path / "out")
    assert (found["effect"], found["where"]) == ("temperature", {"scope": "insole", "ids": []})


def test_the_thermal_pads_show_a_temperature_that_moves_the_counts_more_than_the_load_does(tmp_path, plain):
    warmth = TemperatureCourse(t_s=(0.0, 15.0, 30.0), temperature_c=(24.0, 32.0, 24.0))
    warmed = effect("temperature", Where(), count_per_k=3.5, gain_per_k=0.0, t0_c=24.0)
    recording = load(walk(tmp_path / "walk", warmed, warmth=warmth))
    (seen,) = observed([recording], list(recording.feet), None, lambda text: None, (load(plain),))
    course = pad_course(seen, ())
    assert course is not None
    assert np.corrcoef(course, np.abs(seen.t_s - 15.0))[0, 1] > 0.99


def test_a_smaller_bit_shift_is_detected(tmp_path, plain):
    board = int(LAYOUT.identities[0, 0])
    shifted = effect("bit_shift", Where("board", ((board,),)), shift=2)
    (found,) = diagnosed(walk(tmp_path / "walk", shifted), plain, tmp_path / "out")
    assert (found["effect"], found["where"]) == ("bit_shift", {"scope": "board", "ids": [[board]]})
    assert found["parameters"]["shift"]["value"] == 2


def test_half_the_gain_with_usual_noise_is_no_bit_shift(tmp_path, plain_whole):
    board = int(WHOLE.identities[0, 0])
    half = effect("gain", Where("board", ((board,),)), gain=0.5)
    (found,) = diagnosed(walk(tmp_path / "walk", half, layout=WHOLE), plain_whole, tmp_path / "out")
    assert (found["effect"], found["where"]) == ("gain", {"scope": "board", "ids": [[board]]})


def test_crosstalk_beyond_the_next_taxels_is_detected(tmp_path, plain_whole):
    spread = [effect("crosstalk", Where(), k=0.4)] * 4
    (found,) = diagnosed(walk(tmp_path / "walk", *spread, layout=WHOLE), plain_whole, tmp_path / "out")
    assert found["effect"] == "crosstalk"


def test_a_simulation_of_a_part_of_the_trial_is_used(tmp_path):
    part = walk(tmp_path / "simulation", take=0, seconds=20.0)
    assert diagnosed(walk(tmp_path / "walk"), part, tmp_path / "out") == []


def test_a_load_that_ends_after_the_simulation_is_no_rezero(tmp_path, plain):
    part = walk(tmp_path / "simulation", take=0, seconds=20.0)
    recording, simulation = load(plain), load(part)
    (seen,) = observed([recording], list(recording.feet), None, lambda text: None, [simulation])
    known = seen.reference.is_known(seen.reference_s)
    end = int(np.flatnonzero(known)[-1])
    expected = np.where(seen.usable, 20.0, 0.0) * np.ones_like(seen.activation_count)
    activation = np.where((np.arange(len(known)) <= end + 1)[:, None, None], expected, 0.0)
    seen = replace(seen, activation_count=activation)
    vars(seen)["expected_count"] = expected  # the last simulated load, as beyond its end
    assert correct_rezeros(recording.feet[0], seen)[1] == []


def test_a_rezero_while_the_load_rises_is_corrected_though_readings_in_the_air_are_cut_off(tmp_path, plain):
    recording = load(walk(tmp_path / "walk"))
    (seen,) = observed([recording], list(recording.feet), None, lambda text: None, (load(plain),))
    baseline_count = seen.calibration.baseline_count + 10.0  # near the top of the range
    seen = replace(seen, calibration=replace(seen.calibration, baseline_count=baseline_count))
    boards = tuple(replace(board, no_load=255) for board in recording.feet[0].boards)
    foot = replace(recording.feet[0], boards=boards)
    own = (seen.layout.identities[:, 0] == 7)[:, None] & seen.usable
    load_count = seen.expected_count[:, own].mean(axis=1)
    rises = (seen.t_s > 12.0) & (seen.t_s < 18.0) & (load_count > 6.0)
    at = int(np.argmax(np.where(rises, np.gradient(load_count), 0.0)))
    lost = np.where(own, seen.activation_count[at] - (baseline_count - 255.0), 0.0)
    activation = seen.activation_count.copy()
    activation[at:] -= lost
    activation = np.where(own, np.maximum(activation, baseline_count - 255.0), activation)
    rezeroed = replace(seen, activation_count=activation)
    assert rezeroed.cut_off[at:, own].mean() > 0.5, "in the air"
    _, (finding,) = correct_rezeros(foot, rezeroed)
    assert (finding.effect, finding.where) == ("rezero", Where("board", ((7,),)))
    assert finding.parameters["t_s"].value == pytest.approx(seen.t_s[at], abs=0.2)
    assert finding.parameters["shift_count"].value == pytest.approx(lost[own].mean(), abs=1.0)


def test_the_lag_of_a_board_follows_the_load_of_each_of_its_taxels(tmp_path, plain):
    recording = load(plain)
    (seen,) = observed([recording], list(recording.feet), None, lambda text: None, [load(plain)])
    setting = {"tau_s": 0.02}
    column = lag.TERM.column_of(TaxelLoad(seen), setting).by_triangle[..., 0]
    own = TaxelLoad(seen).by_triangle
    for triangle, taxel in np.argwhere(seen.usable)[[0, 7, 40]]:
        course = own[:, triangle, [taxel]]
        expected = course - low_pass(course, seen.step_s, setting["tau_s"])
        assert column[:, triangle, [taxel]] == pytest.approx(expected)


def test_the_error_with_a_lag_is_that_of_each_taxel_and_not_of_its_triangle(tmp_path, plain):
    late = effect("lag", Where(), tau_s=0.06)
    (found,) = diagnosed(walk(tmp_path / "walk", late), plain, tmp_path / "out")
    assert found["effect"] == "lag"
    heldout = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["heldout"]
    assert heldout["after"] < 1.02 * heldout["floor"] < 0.7 * heldout["before"]


def test_a_simulation_of_another_trial(tmp_path, plain):
    other = walk(tmp_path / "other", scenario="t1")
    arguments = ["diagnose", str(plain), "--simulation", str(other), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, arguments)
    assert isinstance(done.exception, DiagnosisError)
    assert "other" in str(done.exception)


def test_a_simulation_of_another_layout(tmp_path, plain):
    other = tmp_path / "other"
    shutil.copytree(plain, other)
    (path,) = other.glob("*layout*")
    text = path.read_text()
    path.write_text(text.replace("x_mm: 17", "x_mm: 18", 1))
    done = CliRunner().invoke(app, ["diagnose", str(plain), "--simulation", str(other), "--out", str(tmp_path / "out")])
    assert isinstance(done.exception, DiagnosisError)
    assert "layout" in str(done.exception)
