"""A design of a short chamber recording without effects."""

from __future__ import annotations

import pytest

import insole_daemon
from insole_daemon.diagnosis.load_estimate import KnownLoad
from insole_daemon.diagnosis.model.blocks import block_design
from insole_daemon.diagnosis.observing import observed

from ..chamber import write


@pytest.fixture(scope="module")
def design(tmp_path_factory):
    recording = insole_daemon.load(write(tmp_path_factory.mktemp("chamber") / "bag", seconds=40.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    return block_design(KnownLoad(seen), seen.weight_variance**-0.5)
