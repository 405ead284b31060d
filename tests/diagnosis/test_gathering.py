"""One effect at several places is one finding; different strengths stay apart."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from insole_daemon.diagnosis.finding import Finding, Quantity
from insole_daemon.diagnosis.gathering import join_places
from insole_daemon.physics.effect import Where

from .chamber import LAYOUT

SEEN: Any = SimpleNamespace(layout=LAYOUT, usable=np.ones((len(LAYOUT), 12), bool))
FIRST, SECOND, THIRD = (tuple(identity) for identity in LAYOUT.identities[[0, 2, 4]].tolist())


def snap(identity: tuple[int, ...], up_pa: float, explains: float) -> Finding:
    return Finding(
        effect="snap", foot="left", where=Where("triangle", (identity,)), recordings=("bag",), explains=explains,
        sentence=f"triangle {identity[0]}.{identity[1]}: snap.", parameters={"up_pa": Quantity(up_pa, 1e3, "Pa")},
    )  # fmt: skip


def gain(identity: tuple[int, ...], value: float, explains: float) -> Finding:
    return Finding(
        effect="gain", foot="left", where=Where("triangle", (identity,)), recordings=("bag",), explains=explains,
        sentence="triangle: gain.", parameters={"gain": Quantity(value, 0.01, "1")},
    )  # fmt: skip


def test_snaps_of_triangles_are_one_finding_with_the_thresholds_of_the_strongest() -> None:
    (found,) = join_places([snap(SECOND, 50e3, 1.0), snap(FIRST, 42e3, 3.0)], SEEN)
    assert set(found.where.ids) == {FIRST, SECOND}
    assert found.explains == pytest.approx(4.0)
    up_pa = found.parameters["up_pa"]
    assert (up_pa.value, up_pa.std) == (42e3, 8e3)  # as far off as the other's is
    assert found.sentence.endswith(": snap.")
    assert found.sentence.startswith("triangles ")


def test_gains_of_different_strength_or_sign_are_not_joined() -> None:
    found = join_places([gain(FIRST, 1.2, 3.0), gain(SECOND, 1.05, 2.0), gain(THIRD, 0.8, 1.0)], SEEN)
    assert [each.where.ids for each in found] == [(FIRST,), (SECOND,), (THIRD,)]
    (joined,) = join_places([gain(FIRST, 1.2, 3.0), gain(SECOND, 1.15, 2.0)], SEEN)
    assert set(joined.where.ids) == {FIRST, SECOND}


def test_other_words_and_single_taxels_are_left_as_they_are() -> None:
    taxel = Finding(
        effect="gain", foot="left", where=Where("taxel", ((*SECOND, 3),)), recordings=("bag",), explains=1.0,
        sentence="taxel: gain.", parameters={"gain": Quantity(1.2, 0.01, "1")},
    )  # fmt: skip
    found = join_places([gain(FIRST, 1.2, 3.0), snap(FIRST, 42e3, 2.0), taxel], SEEN)
    assert [each.effect for each in found] == ["gain", "snap", "gain"]
