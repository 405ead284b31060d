"""Which findings on faults of the readings stand beside those of effects."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from insole_daemon.diagnosis.finding import Finding
from insole_daemon.diagnosis.one_recording import _fault_findings
from insole_daemon.physics.effect import Where
from insole_daemon.skin import layout as layouts

LAYOUT = layouts.builtin("left", (5, 6, 7))
FIRST, SECOND = (Where("triangle", (tuple(identity),)) for identity in LAYOUT.identities[:2].tolist())


def finding(effect, where):
    return Finding(effect=effect, foot="left", where=where, sentence="", recordings=("walk",))


@pytest.mark.parametrize(
    ("unknown_at", "is_of_readings", "is_reported"),
    [(FIRST, False, False), (FIRST, True, False), (SECOND, False, True), (Where(), False, True)],
)
def test_a_burst_of_noise_is_a_part_of_an_unknown_effect_at_its_place(unknown_at, is_of_readings, is_reported):
    burst, unknown = finding("noise_burst", FIRST), finding("unknown", unknown_at)
    faults = SimpleNamespace(
        findings=(burst, unknown) if is_of_readings else (burst,),
        odd_taxels=SimpleNamespace(findings=()),
        observation=SimpleNamespace(layout=LAYOUT),
    )
    effects = [] if is_of_readings else [unknown]
    reported = _fault_findings(faults, SimpleNamespace(), effects, SimpleNamespace(before=[1.0], after=[1.0]))
    assert (burst in reported) == is_reported
