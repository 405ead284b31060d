"""Sets of terms with their laws only, as the exported model has them."""

from __future__ import annotations

import json

import numpy as np
from typer.testing import CliRunner

import insole_daemon
from insole_daemon.cli import app
from insole_daemon.diagnosis.load_estimate import KnownLoad, LoadEstimate
from insole_daemon.diagnosis.model.blocks import block_design
from insole_daemon.diagnosis.model.design import design as wrench_design
from insole_daemon.diagnosis.model.refine import refine
from insole_daemon.diagnosis.observing import observed

from ..chamber import DT_S, Array, write
from ..foot.shoe import write as write_walk


def creeping_faster_under_load(t_s: Array, p: Array) -> Array:
    """Creep of a tenth of the load on two time scales, which are a tenth as long under full load as without."""
    z, out = np.zeros(2), np.empty_like(p)
    for i, now in enumerate(p):
        z += (now - z) * DT_S / (np.array([6.0, 60.0]) * 10.0 ** (-now / p.max()))
        out[i] = 0.9 * now + 0.1 * z.mean()
    return out


def test_load_dependent_creep_is_named_and_its_nearest_law_lowers_the_error(tmp_path):
    folder = write(tmp_path / "bag", creeping_faster_under_load)
    done = CliRunner().invoke(app, ["diagnose", str(folder), "--out", str(tmp_path / "out")])
    assert done.exit_code in (0, 1), done.output
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert [each["effect"] for each in said["findings"]] == ["creep"]
    heldout = said["heldout"]
    assert heldout["after"] ** 2 - heldout["floor"] ** 2 < 0.3 * (heldout["before"] ** 2 - heldout["floor"] ** 2)


def test_a_model_has_no_companions_for_the_misfit_of_laws(tmp_path):
    recording = insole_daemon.load(write(tmp_path / "bag", creeping_faster_under_load, seconds=40.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    design = block_design(KnownLoad(seen), seen.weight_variance**-0.5)
    chosen = next(k for k, c in enumerate(design.candidates) if c.word == "creep" and c.where.scope == "insole")
    refined = refine(design, (chosen,))
    (creep,) = refined.of_laws.design.candidates
    assert set(refined.design.candidates[0].companion_words) & {"uneven_creep", "earlier_load"}
    assert not set(creep.companion_words) & {"uneven_creep", "earlier_load"}
    assert len(refined.of_laws.shares[0]) == len(creep.settings)
    assert 0.0 < refined.of_laws.gain <= refined.gain


def test_a_model_of_a_walk_has_no_flows(tmp_path):
    recording = insole_daemon.load(write_walk(tmp_path / "walk", lambda p: 0.9 * p, seconds=12.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    nothing = np.zeros(len(seen.usable), np.bool_)
    whole = wrench_design(LoadEstimate(seen), seen.weight_variance**-0.5, nothing)
    with_flows = [
        k for k, c in enumerate(whole.candidates)
        if c.word == "creep" and c.where.scope == "insole" and any("scale_pa" in setting for setting in c.settings)
    ]  # fmt: skip
    refined = refine(whole, tuple(with_flows))
    (creep,) = refined.of_laws.design.candidates
    assert all(set(setting) == {"tau_s"} for setting in creep.settings)
    assert len(refined.of_laws.shares[0]) == len(creep.settings)
    np.testing.assert_array_equal(
        refined.of_laws.design.raw[:, creep.columns], refined.design.raw[:, : len(creep.settings)]
    )
