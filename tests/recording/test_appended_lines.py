"""Appended lines stay complete after a kill or on a full disk."""

from __future__ import annotations

import errno
import os
from io import FileIO
from mmap import PAGESIZE

import pytest

from insole_daemon.recording import appended_lines
from insole_daemon.recording.appended_lines import AppendedLines


def lines(n, length=47):
    return b"".join((b"%d" % i).ljust(length) + b"\n" for i in range(n))


@pytest.fixture
def writes(monkeypatch):
    """Collect the single writes to the kernel."""
    seen = []

    class Seen(FileIO):
        def write(self, data):
            seen.append(bytes(data))
            return super().write(data)

    monkeypatch.setattr(appended_lines, "FileIO", Seen)
    return seen


def test_lines_reach_the_file_at_once_in_writes_within_a_page(tmp_path, writes):
    path, text = tmp_path / "can.log", lines(1000)
    log = AppendedLines(path)
    for first in range(0, len(text), 48 * 50):
        log.write(text[first : first + 48 * 50])
        assert path.stat().st_size == log.tell()
    assert path.read_bytes() == text
    at = 0
    for write in writes:
        assert write.endswith(b"\n")
        pages = (at + len(write) - 1) // PAGESIZE - at // PAGESIZE
        assert pages == 0 or write.count(b"\n") == 1, "of what lies in two pages only a single line is one write"
        at += len(write)
    assert len(writes) < 2 * len(text) / PAGESIZE + len(text) / (48 * 50) + 2
    log.close()


def test_lines_longer_than_a_page_are_written(tmp_path):
    with_long = b"short\n" + b"x" * (2 * PAGESIZE) + b"\nshort\n"
    log = AppendedLines(tmp_path / "can.log")
    log.write(with_long)
    log.close()
    assert (tmp_path / "can.log").read_bytes() == with_long


@pytest.mark.parametrize("taken", [0, 20, 48, 100])
def test_a_full_disk_keeps_only_complete_lines(tmp_path, monkeypatch, taken):
    class Full(FileIO):
        def write(self, data):
            if self.tell() < 48:
                return super().write(data)
            return super().write(data[:taken])

    monkeypatch.setattr(appended_lines, "FileIO", Full)
    log = AppendedLines(tmp_path / "can.log")
    log.write(lines(1))
    with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
        log.write(lines(5))
    log.close()
    assert (tmp_path / "can.log").read_bytes() == lines(1) + lines(5)[: taken // 48 * 48]
