"""Laws that come nearest to what real materials do."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import insole_daemon
from insole_daemon.cli import app
from insole_daemon.diagnosis.model.blocks import block_design
from insole_daemon.diagnosis.model.load import KnownLoad
from insole_daemon.diagnosis.model.nearest_laws import nearest_laws
from insole_daemon.diagnosis.observing import observed

from ..chamber import DT_S, Array, write


def creeping_faster_under_load(t_s: Array, p: Array) -> Array:
    """A tenth of the answer comes late, on two time scales, each a tenth as long under the full load as under none."""
    z, out = np.zeros(2), np.empty_like(p)
    for i, now in enumerate(p):
        z += (now - z) * DT_S / (np.array([6.0, 60.0]) * 10.0 ** (-now / p.max()))
        out[i] = 0.9 * now + 0.1 * z.mean()
    return out


def test_creep_that_depends_on_the_load_is_named_and_the_law_nearest_to_it_helps(tmp_path):
    folder = write(tmp_path / "bag", creeping_faster_under_load)
    done = CliRunner().invoke(app, ["diagnose", str(folder), "--out", str(tmp_path / "out")])
    assert done.exit_code in (0, 1), done.output
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert [each["effect"] for each in said["findings"]] == ["creep"]
    heldout = said["heldout"]
    assert heldout["after"] ** 2 - heldout["floor"] ** 2 < 0.3 * (heldout["before"] ** 2 - heldout["floor"] ** 2)


@pytest.fixture(scope="module")
def design(tmp_path_factory):
    recording = insole_daemon.load(write(tmp_path_factory.mktemp("chamber") / "bag", seconds=40.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    whole = block_design(KnownLoad(seen), seen.weight_variance**-0.5)
    creep = next(k for k, c in enumerate(whole.candidates) if c.word == "creep" and c.where.scope == "insole")
    return whole.subset([creep])


def test_the_law_nearest_to_a_law_is_itself(design):
    (creep,) = design.candidates
    shares = np.zeros(len(design.atom))
    shares[creep.columns] = 0.02 + 0.01 * np.arange(len(creep.columns))
    assert nearest_laws(design, shares) == pytest.approx(shares, abs=2e-3)


def test_what_no_law_has_is_described_by_the_law_as_nearly_as_it_can_be(design):
    (creep,) = design.candidates
    words = np.array(creep.companion_words)
    left_out = creep.companions[words == "uneven_creep"][-1:]  # activated, which is late on every time scale
    shares = np.zeros(len(design.atom))
    shares[left_out] = 0.1
    found = nearest_laws(design, shares)
    assert found[left_out] == 0.0
    assert found[creep.columns].min() >= 0.0

    def square(each: Array) -> float:
        return float(each @ design.gram @ each)

    assert square(shares - found) < 0.2 * square(shares)
