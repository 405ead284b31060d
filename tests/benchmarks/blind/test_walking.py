"""Walks: the wrench's convention, the numerics, the map, and the scores of the walking suite."""

import numpy as np
import pytest

from benchmarks.blind import laws, plan
from benchmarks.blind.geometry import AREA_MM2, PRESSURE_TAXELS, insole
from benchmarks.blind.rules import judge
from benchmarks.blind.tables import f1
from benchmarks.blind.untouched import compare_force
from benchmarks.blind.walking import Wrench, walk
from benchmarks.blind.walking_case import _moved
from benchmarks.blind.walking_tables import markdown, tables


@pytest.fixture(scope="module")
def strolled():
    geometry = insole("left", 5)
    return geometry, walk(np.random.default_rng(1), geometry)


def test_the_wrench_is_the_sum_over_the_taxels(strolled):
    geometry, load = strolled
    some = slice(20_000, 22_000, 100)
    pressure = load.pressure(geometry.taxel_mm)[some][:, :, PRESSURE_TAXELS].reshape(20, -1)
    at = geometry.taxel_mm[:, PRESSURE_TAXELS].reshape(-1, 2) * 1e-3
    force = pressure * AREA_MM2 * 1e-6
    wanted = np.stack([force.sum(1), (force * at[:, 1]).sum(1), -(force * at[:, 0]).sum(1)], 1)
    assert Wrench(load, geometry.taxel_mm).courses[some] == pytest.approx(wanted, rel=1e-4, abs=1e-3)
    assert wanted[:, 2].min() < 0  # the load lies before the heel


def test_a_delay_does_what_the_paper_saw(strolled):
    geometry, load = strolled
    force = Wrench(load, geometry.taxel_mm).courses[:, 0]
    assert 500 < force.max() < 950
    rmse = np.sqrt(np.mean((force[40:] - force[:-40]) ** 2))
    assert 60 < rmse < 130


def test_bouc_wen_of_many_is_that_of_each():
    load = np.cumsum(np.random.default_rng(2).normal(0, 500, (600, 3)), 0)
    each = np.stack([laws.bouc_wen(c, 9000.0) for c in load.T], 1)
    assert laws.bouc_wen_of_many(load, 9000.0) == pytest.approx(each, abs=1e-5)


def test_the_map_is_turned_about_the_centres_and_shifted():
    geometry = insole("left", 5)
    effect, at = _moved(np.random.default_rng(3), geometry, "map_transform")
    centre, was = at[:, 3], geometry.taxel_mm[:, 3]  # taxel 3 is the centre
    assert centre.mean(0) - was.mean(0) == pytest.approx([effect.shape["x_mm"], effect.shape["y_mm"]])
    before, after = was[-1] - was[0], centre[-1] - centre[0]
    turned = np.degrees(np.arctan2(*after[::-1]) - np.arctan2(*before[::-1]))
    assert (turned + 180) % 360 - 180 == pytest.approx(effect.shape["rotation_deg"])


def test_the_suite_holds_every_kind():
    kinds = {s.kind for s in plan.cases(1, "walking", 30)}
    assert kinds == {"null", "single", "together", "patch", "mapping"}
    both = plan.cases(1, "all", 120)
    assert sum(s.suite == "walking" for s in both) == 30


EVERY = [[5, t, k] for t in range(4) for k in range(10)]


def row(kind, effect, where, taxels, parameters, answer, **more):
    concealed = {"effect": effect, "where": where, "taxels": taxels, "k_floor": None, "parameters": parameters}
    truth = {"kind": kind, "effects": [concealed], "equivalent": [], "also_right": [], "taxels": EVERY}
    diagnosis = {"format": "insole-diagnosis/1", "verdict": "explained", "findings": [answer]}
    return {**judge(truth, diagnosis), "variant": "", **more}


@pytest.mark.parametrize(("said", "right"), [([[5, 0], [5, 2]], 1), ([[5, 0], [5, 1]], 0)])
def test_swapped_triangles_have_to_be_both(said, right):
    where = {"scope": "triangle", "ids": [[5, 0], [5, 2]]}
    taxels = [t for t in EVERY if t[1] in (0, 2)]
    answer = {"effect": "swapped_triangles", "where": {"scope": "triangle", "ids": said}}
    t = tables([row("mapping", "swapped_triangles", where, taxels, {}, answer)])
    assert t["swapped"]["right"] == right
    assert f"({right} of 1" in markdown(t)


@pytest.mark.parametrize(("rotation", "right"), [(3.1, 1), (3.3, 0)])
def test_a_map_has_to_be_within_the_tolerance(rotation, right):
    true = {"x_mm": [5.0], "y_mm": [-2.0], "rotation_deg": [3.0]}
    said = {"x_mm": {"value": [5.5]}, "y_mm": {"value": [-2.9]}, "rotation_deg": {"value": [rotation]}}
    answer = {"effect": "map_transform", "where": {"scope": "insole", "ids": []}, "parameters": said}
    t = tables([row("mapping", "map_transform", {"scope": "insole", "ids": []}, [], true, answer)])
    assert t["map_transform"]["right"] == right


def test_a_patch_may_miss_a_triangle_but_not_half():
    assert f1((90, 0, 20)) >= 0.8
    assert f1((50, 0, 50)) < 0.8


def test_force_is_compared_at_the_times_it_is_said_for(tmp_path):
    t_s = 1.6e9 + np.arange(500) * 0.02
    force = 300 + 300 * np.sin(np.arange(500) * 0.1)
    noise = np.random.default_rng(4).standard_normal((2, 500))
    np.savez(
        tmp_path / "scoring.npz", t_s=t_s, fz_n=force, static_fz_n=force + 30 * noise[0], oracle_fz_n=force + noise[1]
    )

    def between_the_rows(model, recording):
        return {"left": (t_s[:-1] + 0.01, (force[:-1] + force[1:]) / 2 + 2.0)}

    found = compare_force(tmp_path, "left", tmp_path / "model.json", between_the_rows)
    assert found["model"] == pytest.approx(2.0, abs=0.05)
    assert found["over_oracle"] == pytest.approx(2.0, rel=0.15)
    late = compare_force(tmp_path, "left", tmp_path / "model.json", lambda m, r: {"left": (t_s[:100], force[:100])})
    assert "expected a finite f_z" in late["failure"]
