"""A text file that lines are appended to so that neither a kill nor a full disk leaves half of one."""

from __future__ import annotations

import errno
import os
from io import FileIO
from mmap import PAGESIZE


class AppendedLines:
    """Takes whole lines, and hands them to the kernel at once.

    The kernel copies page by page and looks between two pages whether the process was killed. So no write spans more
    pages than it must: the lines that lie within a page are one, a line that lies in two is another.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Create or overwrite the file; OSError where that cannot be."""
        self._file = FileIO(path, "wb")
        self._size = 0

    def write(self, lines: bytes) -> None:
        """Append lines, each with its end; raises OSError where the disk takes no more, and keeps the whole ones."""
        at = 0
        while at < len(lines):
            end = lines.rfind(b"\n", at, at + PAGESIZE - self._size % PAGESIZE) + 1 or lines.index(b"\n", at) + 1
            written = self._file.write(lines[at:end])
            if written < end - at:  # the error itself comes with the next write, which there will not be
                self._file.truncate(self._size + max(0, lines.rfind(b"\n", at, at + written) + 1 - at))
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            at, self._size = end, self._size + written

    def tell(self) -> int:
        """Bytes so far."""
        return self._size

    def flush(self) -> None:
        """All has been handed over."""

    def fileno(self) -> int:
        """Of the file, for whoever makes it durable."""
        return self._file.fileno()

    def close(self) -> None:
        """Close the file; idempotent."""
        self._file.close()
