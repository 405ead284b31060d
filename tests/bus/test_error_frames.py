"""Error frames by kind."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.bus.error_frames import KINDS, OTHER, count_kinds
from insole_daemon.bus.frames import ERROR, EXTENDED, FrameBatch


def batch(*identifiers_and_flags: tuple[int, int]) -> FrameBatch:
    n = len(identifiers_and_flags)
    return FrameBatch(
        np.arange(n),
        np.arange(n),
        np.zeros(n, np.uint8),
        np.array([pair[0] for pair in identifiers_and_flags], np.uint32),
        np.full(n, 8, np.uint8),
        np.zeros((n, 8), np.uint8),
        np.array([pair[1] for pair in identifiers_and_flags], np.uint8),
    )


@pytest.mark.parametrize(("bit", "kind"), KINDS.items())
def test_each_class_has_a_kind(bit: int, kind: str) -> None:
    counts: dict[str, int] = {}
    count_kinds(batch((bit, ERROR)), counts)
    assert counts == {kind: 1}


def test_kinds_cover_the_classes_of_the_kernel() -> None:
    assert list(KINDS) == [1 << bit for bit in range(10)]
    assert len(set(KINDS.values()) | {OTHER}) == 11


def test_counts_are_added_up_and_a_frame_may_have_several_kinds() -> None:
    counts = {"bus_off": 5, "no_ack": 1}
    count_kinds(batch((0x44, ERROR), (0x40, ERROR), (0x208, ERROR)), counts)
    assert counts == {"bus_off": 7, "no_ack": 1, "controller": 1, "protocol": 1, "error_counters": 1}


def test_a_class_without_a_name_is_counted_too() -> None:
    counts: dict[str, int] = {}
    count_kinds(batch((0x400, ERROR), (0, ERROR), (0x440, ERROR)), counts)
    assert counts == {"bus_off": 1, OTHER: 2}


def test_messages_are_not_counted() -> None:
    counts: dict[str, int] = {}
    count_kinds(batch((0x44, 0), (0x44, EXTENDED)), counts)
    count_kinds(FrameBatch.empty(), counts)
    assert counts == {}
