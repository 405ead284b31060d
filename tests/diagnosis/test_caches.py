"""Memory that a diagnosis of several recordings gives back."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import insole_daemon
from insole_daemon.diagnosis.caches import forget_cached
from insole_daemon.diagnosis.pipeline import diagnose

from .chamber import write


@dataclass(frozen=True, eq=False)
class Squares:
    numbers: tuple[int, ...]

    @cached_property
    def squares(self) -> list[int]:
        return [n * n for n in self.numbers]


def test_what_was_cached_is_forgotten_and_computed_again():
    owner = Squares((2, 3))
    before = owner.squares
    forget_cached(owner)
    assert vars(owner) == {"numbers": (2, 3)}
    assert owner.squares == before
    assert owner.squares is not before


def test_the_result_of_a_recording_keeps_no_cached_arrays(tmp_path):
    recording = insole_daemon.load(write(tmp_path / "bag", seconds=30.0))
    (result,) = diagnose([recording], None, lambda text: None).results
    observation = result.faults.observation
    assert vars(observation).keys() == {field.name for field in fields(observation)}
