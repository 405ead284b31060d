"""Memory that a diagnosis gives back."""

from __future__ import annotations

import platform
import subprocess
import sys
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.caches import forget_cached
from insole_daemon.diagnosis.pipeline import diagnose

from .chamber import write

FREED = """
import resource
import numpy as np
from insole_daemon.diagnosis.caches import reuse_freed_memory

def resident_mb():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize() / 1e6

def page_faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

reuse_freed_memory()
np.ones(1_000_000)
faults_before = page_faults()
for _ in range(20):
    np.ones(1_000_000)
faults = page_faults() - faults_before
np.ones(3_000_000)  # freed at once, after which the C library would keep arrays of this size
before = resident_mb()
arrays = [np.ones(3_000_000) for _ in range(20)]
del arrays[:-1]
print(resident_mb() - before, faults * resource.getpagesize() / 8e6)
"""


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
    forget_cached(owner, kept=("squares",))
    assert "squares" in vars(owner)


def test_the_result_of_a_recording_keeps_no_cached_arrays_of_its_rows(tmp_path):
    recording = insole_daemon.load(write(tmp_path / "bag", seconds=30.0))
    (result,) = diagnose([recording], None, lambda text: None).results
    for observation in (result.faults.observation, result.seen):
        cached = vars(observation).keys() - {field.name for field in fields(observation)}
        sizes = {name: np.size(vars(observation)[name]) for name in cached}
        assert not [name for name, size in sizes.items() if size >= len(observation.t_s)]


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries have no such option")
def test_freed_arrays_are_used_again_and_the_largest_return_to_the_system_although_later_ones_are_in_use():
    done = subprocess.run([sys.executable, "-c", FREED], capture_output=True, text=True, check=True)
    kept_mb, cleared_again = map(float, done.stdout.split())
    assert kept_mb < 40.0  # of 480
    assert cleared_again < 2.0  # of 20 arrays
