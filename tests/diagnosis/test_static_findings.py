"""Static effects of the whole insole that the companions of a memory have taken up."""

from __future__ import annotations

import pytest

import insole_daemon
from insole_daemon.diagnosis.load_estimate import KnownLoad
from insole_daemon.diagnosis.model.blocks import block_design
from insole_daemon.diagnosis.model.nuisance import USUAL, Priors
from insole_daemon.diagnosis.model.refine import refine
from insole_daemon.diagnosis.model.regression import Timing
from insole_daemon.diagnosis.observing import observed
from insole_daemon.diagnosis.select.heldout_errors import heldout_errors
from insole_daemon.diagnosis.select.search import SubsetSearch
from insole_daemon.diagnosis.static_findings import static_findings

from .chamber import relaxing, write


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """A chamber with a memory and a loss of gain."""

    def weaker(t_s, counts):
        counts[:] = 240.5 - 0.85 * (240.5 - counts)

    folder = write(tmp_path_factory.mktemp("chamber") / "bag", relaxing(0.3, 0.8), touch=weaker, seconds=40.0)
    recording = insole_daemon.load(folder)
    (found,) = observed([recording], recording.feet, None, lambda text: None, ())
    return found


def found(seen, priors):
    """Return the static findings beside the viscoelasticity of the whole insole, and the words without one."""
    design = block_design(KnownLoad(seen), seen.weight_variance**-0.5, priors)
    search = SubsetSearch(design)
    memories = [
        search.fit([k]) for k, each in enumerate(design.candidates)
        if each.word == "viscoelasticity" and each.where.scope == "insole"
    ]  # fmt: skip
    refined = refine(design, max(memories, key=lambda fitted: fitted.gain).chosen)
    findings, taken_up = static_findings(refined, heldout_errors(refined, (0,), Timing()))
    return [finding.effect for finding in findings], taken_up


def test_companions_of_a_memory_leave_a_loss_of_gain(seen):
    assert found(seen, USUAL) == (["gain"], ("gain",))


def test_a_simulated_load_that_may_be_off_hides_it(seen):
    assert found(seen, Priors(share=0.04)) == ([], ())
