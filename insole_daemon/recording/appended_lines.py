"""Append lines to a text file so that neither a kill nor a full disk leaves an incomplete line."""

from __future__ import annotations

import errno
import os
from io import FileIO
from mmap import PAGESIZE


class AppendedLines:
    """A file that takes whole lines and passes them to the kernel at once.

    The kernel copies page by page and checks between two pages whether the process was killed. So a write crosses a
    page boundary only if a single line does: the lines within a page are one write, a line across two pages is another.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Create or overwrite the file; OSError if that fails."""
        self._file = FileIO(path, "wb")
        self._size = 0

    def write(self, lines: bytes) -> None:
        """Append lines, each with its newline. On a full disk raise OSError and keep only the complete lines."""
        start = 0
        while start < len(lines):
            end = (
                lines.rfind(b"\n", start, start + PAGESIZE - self._size % PAGESIZE) + 1 or lines.index(b"\n", start) + 1
            )
            written = self._file.write(lines[start:end])
            if written < end - start:  # a short write reports no error, only the next one would
                self._file.truncate(self._size + max(0, lines.rfind(b"\n", start, start + written) + 1 - start))
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            start, self._size = end, self._size + written

    def tell(self) -> int:
        """Return the bytes so far."""
        return self._size

    def flush(self) -> None:
        """Do nothing: every write has reached the kernel."""

    def fileno(self) -> int:
        """Return the descriptor, for syncing the file to the disk."""
        return self._file.fileno()

    def close(self) -> None:
        """Close the file; idempotent."""
        self._file.close()
