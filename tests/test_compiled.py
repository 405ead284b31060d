"""The compiled kernel: that it is there where it can be, and that nothing needs it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from insole_daemon.compiled import kernel

HERE = Path(__file__).resolve().parent.parent
HEADERS = Path(sysconfig.get_path("include")) / "Python.h"
CAN_BE_BUILT = bool(shutil.which("cc")) and HEADERS.exists() and os.environ.get("INSOLE_KERNEL") != "0"


def test_with_a_compiler_the_compiled_kernel_is_built():
    assert (kernel is not None) or not CAN_BE_BUILT, (
        "there is a compiler, and no kernel, or one of another source: 'python hatch_build.py' builds it"
    )


def test_without_the_kernel_the_package_computes_with_numpy():
    code = "from insole_daemon.service.foot import load_feet; from insole_daemon.compiled import kernel; print(kernel)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "INSOLE_KERNEL": "0"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "None\n"


def test_without_a_compiler_the_build_reports_it_and_continues(tmp_path):
    copy = tmp_path / "insole_daemon"
    copy.mkdir()
    shutil.copy(HERE / "hatch_build.py", tmp_path)
    shutil.copy(HERE / "insole_daemon" / "kernel.c", copy)
    done = subprocess.run(
        [sys.executable, "hatch_build.py"], cwd=tmp_path, env={"PATH": str(tmp_path)}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert "there is no C compiler (cc)" in done.stderr
    assert [file.name for file in copy.iterdir()] == ["kernel.c"]
    done = subprocess.run(
        [sys.executable, "hatch_build.py"], cwd=tmp_path, env={"CC": "/bin/false", "PATH": str(tmp_path)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "failed" in done.stderr
    assert [file.name for file in copy.iterdir()] == ["kernel.c"]


@pytest.mark.skipif(kernel is None, reason="no kernel: the first test above fails where there should be one")
@given(
    st.lists(
        st.one_of(
            st.none(), st.booleans(), st.integers(-(2**63), 2**64 - 1), st.integers(-200, 300),
            st.floats(allow_nan=False, allow_infinity=False), st.text(), st.binary(max_size=400),
        ),
        min_size=1, max_size=30,
    )
)  # fmt: skip
def test_the_compiled_kernel_packs_the_same_bytes_as_msgpack(values):
    names = [f"value_{number}" for number in range(len(values))]
    heads = [msgpack.packb(name) for name in names]
    heads[0] = msgpack.Packer().pack_map_header(len(names)) + heads[0]
    given_values = tuple(np.frombuffer(value, np.uint8) if isinstance(value, bytes) else value for value in values)
    assert kernel.pack(tuple(heads), given_values) == msgpack.packb(dict(zip(names, values, strict=True)))


@pytest.mark.skipif(kernel is None, reason="no kernel: the first test above fails where there should be one")
def test_large_arrays_strided_ones_and_numbers_that_are_none_are_packed():
    large, strided = np.arange(70_000, dtype=np.float32), np.arange(12, dtype=np.int64).reshape(3, 4)[:, ::2]
    packed = kernel.pack((b"\x84\xa1a", b"\xa1b", b"\xa1c", b"\xa1d"), (large, strided, float("nan"), float("inf")))
    expected = {"a": large.tobytes(), "b": strided.tobytes(), "c": None, "d": None}
    assert packed == msgpack.packb(expected)


TABLE = np.zeros(2048 * 3, np.int16)


def receiver() -> Any:
    return kernel.receiver(np.zeros((1, 16), np.uint8), np.zeros(8, np.int64), np.zeros(8, np.uint64))


def sorter() -> Any:
    return kernel.sorter(TABLE, np.zeros(256, np.uint32), np.zeros(21, np.int64), ())


def messages_of(template: bytes) -> Any:
    """Of one triangle, whose record has 64 bytes."""
    taxels, byte = np.zeros(12), np.zeros(1, np.uint8)
    reader = kernel.reader(
        (np.zeros(12, np.bool_), byte, byte, byte, taxels, taxels, taxels, np.zeros(36)), 1, 1, 0.0, 0.0
    )  # fmt: skip
    masked, valid, beyond = np.zeros((3, 12), np.uint8)
    pressure_pa, load_pa = np.zeros((2, 12), np.float32)
    work = (masked, byte, byte, valid, taxels, pressure_pa, np.zeros(1, np.float32), load_pa, beyond)
    return kernel.messages(reader, work, (template,), 5)


def inverse(*stages: tuple[Any, ...]) -> Any:
    """Of one triangle."""
    return kernel.inverse((np.full(12, np.inf), np.zeros(12), np.full(1, np.nan)), stages)


def relaxation(**other: Any) -> tuple[Any, ...]:
    """A stage on two columns, with one term, and `other` arguments in the place of good ones."""
    columns, none, numbers = np.array([3, 5]), np.zeros(0, np.int64), np.full(1, 0.5)
    arguments = {
        "kind": 0, "n_terms": 1, "columns": columns, "neighbours": none, "at_once": numbers, "first": numbers,
        "second": numbers, "memory": np.zeros(5),
    }  # fmt: skip
    return tuple((arguments | other).values())


@pytest.mark.skipif(kernel is None, reason="no kernel: the first test above fails where there should be one")
def test_a_template_is_filled_in_to_the_last_byte():
    messages = messages_of(b"\x02\x00ab\x01\x01\x00c\x10\x01\x00d\x0d\x01\x00e\x00")
    assert kernel.read_record(messages, bytes(64), True) == (0, 0, 0, 0.0, 0.0, 0.0)
    packed = kernel.pack_record(messages, bytes(64), 300, 0, (float("nan"), *[0.0] * 9))
    assert packed == (b"ab" + msgpack.packb(300) + b"c" + msgpack.packb(None) + b"d" + msgpack.packb(-5) + b"e",)


@pytest.mark.skipif(kernel is None, reason="no kernel: the first test above fails where there should be one")
def test_an_inverse_goes_only_on_in_time():
    made, count, flag = inverse(relaxation()), np.zeros(12, np.uint8), np.zeros(12, np.bool_)
    assert kernel.invert(made, np.zeros(12), count, flag, None, 2.0, np.zeros(12), flag.copy()) == 0
    assert kernel.invert(made, np.zeros(12), count, flag, None, 1.0, np.zeros(12), flag.copy()) == -1


@pytest.mark.skipif(kernel is None, reason="no kernel: the first test above fails where there should be one")
@pytest.mark.parametrize(
    "call",
    [
        lambda: kernel.pack((b"a",), (1, 2)),
        lambda: kernel.pack((b"\x81\xa1a",), (object(),)),
        lambda: kernel.pack((b"\x81\xa1a",), (2**64,)),
        lambda: kernel.slots(np.zeros(5, np.int16), *[np.zeros(1, np.uint8)] * 6),
        lambda: kernel.may_be_loose(np.zeros((2, 12), np.uint8), np.zeros(3, np.bool_), np.zeros(2, np.bool_)),
        lambda: kernel.feed(None, *[None] * 4),
        lambda: kernel.advance(None, 0),
        lambda: kernel.read(None, *[None] * 8),
        lambda: kernel.assembly((), ()),
        lambda: kernel.assembly((np.zeros(2, np.bool_),) * 13, (0,) * 7),
        lambda: kernel.reader((), 1, 1, 0.0, 0.0),
        lambda: kernel.receiver(*[np.zeros(64, np.uint8)] * 3),
        lambda: kernel.receive(None, 0, 0),
        lambda: kernel.drain(receiver(), 2, 0, 0, 0),
        lambda: kernel.drain(receiver(), 0, 0, 0, 0),
        lambda: kernel.merge((b"33",)),
        lambda: kernel.merge((None,)),
        lambda: kernel.sorter(np.zeros(5, np.int16), np.zeros(256, np.uint32), np.zeros(21, np.int64), ()),
        lambda: kernel.sorter(TABLE, np.zeros(256, np.uint32), np.zeros(21, np.int64), (receiver(),)),
        lambda: kernel.take(sorter(), b"33"),
        lambda: kernel.take(sorter(), np.zeros(33, np.uint8)),
        lambda: kernel.expected(receiver()),
        lambda: messages_of(b"\x00\x00\x25"),
        lambda: messages_of(b"\x03\x00a\x00"),
        lambda: messages_of(b"\x00\x00\x01"),
        lambda: messages_of(b"\x00\x00\x00\x00"),
        lambda: kernel.read_record(messages_of(b"\x00\x00\x00"), bytes(57), False),
        lambda: kernel.pack_record(messages_of(b"\x00\x00\x00"), bytes(56), 0, 0, (0.0,) * 10),
        lambda: kernel.pack_record(messages_of(b"\x00\x00\x19\x00\x00\x00"), bytes(64), 0, 0, (0.0,) * 9),
        lambda: kernel.pack_record(messages_of(b"\x00\x00\x00"), bytes(64), 2**63, 0, (0.0,) * 10),
        lambda: kernel.inverse((np.zeros(12), np.zeros(12)), ()),
        lambda: kernel.inverse((np.zeros(12), np.zeros(11), np.zeros(1)), ()),
        lambda: inverse(()),
        lambda: inverse(*[relaxation()] * 17),
        lambda: inverse(relaxation(kind=4)),
        lambda: inverse(relaxation(kind=2)),
        lambda: inverse(relaxation(n_terms=65)),
        lambda: inverse(relaxation(columns=np.array([3, 12]))),
        lambda: inverse(relaxation(neighbours=np.array([0, 2]), kind=2, memory=np.zeros(7))),
        lambda: inverse(relaxation(first=np.zeros(3))),
        lambda: inverse(relaxation(memory=np.zeros(6))),
        lambda: kernel.invert(inverse(), *[np.zeros(12)] * 3, None, 0.0, *[np.zeros(12)] * 2),
        lambda: kernel.sum(np.zeros(11), np.zeros(12, np.bool_), np.zeros(36), 0.0, np.zeros(12, np.float32)),
        lambda: kernel.sum(np.zeros(4), np.zeros(4, np.bool_), np.zeros(12), 0.0, np.zeros(4, np.float32)),
    ],
)
def test_arguments_that_do_not_fit_are_refused(call):
    with pytest.raises((ValueError, TypeError, OverflowError, BufferError, AttributeError)):
        call()
