"""What may stand beside `unknown`."""

from __future__ import annotations

from typing import Any, cast

import pytest

from insole_daemon.diagnosis.unexplained import least_gain_beside_unknown

OF_WALK = cast(Any, None)  # its errors and design do not matter: force and moments are judged by what is left


@pytest.mark.parametrize(("gain", "is_reported"), [(5.0, False), (10.0, True)])
def test_an_effect_of_a_walk_leaves_no_more_than_the_misfit_of_its_law(gain, is_reported):
    assert (gain > least_gain_beside_unknown(OF_WALK, OF_WALK, unexplained=1.0)) == is_reported
