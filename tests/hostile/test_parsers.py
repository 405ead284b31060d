"""Whatever comes from outside is read or refused in the project's own words: no crash, no hang, no flood of memory.

The targets are those of the coverage-guided fuzzing (`python -m benchmarks.decode.fuzz.run`), here with drawn inputs.
"""

from __future__ import annotations

import json
import time

import pytest
import yaml
from hypothesis import HealthCheck, given, settings

from benchmarks.decode.fuzz.targets import TARGETS
from insole_daemon.errors import InsoleError
from tests.hostile.damage import bent, damaged

LONGEST_CPU_S = 1.0


def refusal(name: str, data: bytes) -> str | None:
    """What it says of `data`, None where it takes them."""
    began = time.process_time()
    try:
        TARGETS[name].take(data)
        message = None
    except InsoleError as error:
        message = str(error)
    assert message != "", "it is refused without a word"
    assert time.process_time() - began < LONGEST_CPU_S
    return message


@pytest.mark.parametrize("name", TARGETS)
def test_valid_input_is_accepted(name):
    for seed in TARGETS[name].seeds():
        assert refusal(name, seed) is None


@pytest.mark.parametrize("name", TARGETS)
def test_invalid_input_is_refused_with_a_message(name):
    @settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
    @given(damaged(TARGETS[name].seeds()))
    def refuses(data):
        refusal(name, data)

    refuses()


@pytest.mark.parametrize("name", ["config-yaml", "recording-yaml", "layout-yaml", "calibration-json", "zero-json"])
def test_documents_with_other_content_are_refused_with_a_message(name):
    """JSON is YAML; of damaged bytes few are one any more."""
    documents = [yaml.safe_load(seed) for seed in TARGETS[name].seeds()]

    @settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
    @given(bent(documents))
    def refuses(document):
        refusal(name, json.dumps(document).encode())

    refuses()
