"""What may stand beside `unknown`."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from insole_daemon.diagnosis.backward_elimination import is_believed
from insole_daemon.diagnosis.unexplained import least_gain_beside_unknown
from insole_daemon.physics.effect import Where

OF_WALK = cast(Any, None)  # its errors and design do not matter: force and moments are judged by what is left


@pytest.mark.parametrize(("gain", "is_reported"), [(5.0, False), (10.0, True)])
def test_an_effect_of_a_walk_leaves_no_more_than_the_misfit_of_its_law(gain, is_reported):
    assert (gain > least_gain_beside_unknown(OF_WALK, OF_WALK, unexplained=1.0)) == is_reported


@pytest.mark.parametrize(("margins", "left", "is_reported"), [((0.1, 0.2), 0.3, False), ((40.0, 20.0), 0.01, True)])
def test_the_terms_of_a_walk_are_probably_there(margins, left, is_reported):
    """A set of several weak terms that leave much stands for an effect that no term describes."""
    of_insole = SimpleNamespace(word="gain", where=Where())
    design = SimpleNamespace(candidates=(of_insole,) * len(margins))
    kept = SimpleNamespace(
        best=None, order=(0, 1), figures=SimpleNamespace(residual_fraction=left), refined=SimpleNamespace(design=design)
    )
    search = SimpleNamespace(margin=lambda best, i: margins[i])
    assert is_believed(cast(Any, search), cast(Any, kept)) == is_reported
