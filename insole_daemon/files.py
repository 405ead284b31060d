"""Writing of files, all or nothing, and reading up to a size."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path`, all or nothing: afterwards the file is either the old or the complete new one.

    Raises OSError if it cannot be written; no partial file remains.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    # In the same folder: a rename is atomic only within one file system.
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with open(temporary, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)  # else the rename itself may not survive
    finally:
        os.close(folder)


def read_at_most(path: Path, most_bytes: int) -> bytes:
    """Return the content of `path`; OSError if it cannot be read or is longer than `most_bytes`."""
    with open(path, "rb") as file:
        content = file.read(most_bytes + 1)
        if len(content) > most_bytes:
            found_mb = max(len(content), os.fstat(file.fileno()).st_size) / 1e6
            reason = f"expected at most {most_bytes / 1e6:.1f} MB, found {found_mb:.1f} MB: is this the right file?"
            raise OSError(errno.EFBIG, reason)
    return content


_REASONS = {
    errno.ENOENT: "there is no such file; check the path",
    errno.ENOTDIR: "there is no such file; check the path",
    errno.EISDIR: "it is a folder; name a file",
    errno.EACCES: "this user has no permission; check the permissions of the file",
}


def unreadable(error: OSError) -> str:
    """Return the reason why a file cannot be read, and what to do."""
    return f"cannot be read: {_REASONS.get(error.errno or 0) or error.strerror or error}"


@contextlib.contextmanager
def unfinished(path: Path) -> Iterator[Path]:
    """Yield a temporary path for writing; at the end its file replaces `path`, or is removed after an error."""
    temporary = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        yield temporary
        with open(temporary, "rb") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


@contextlib.contextmanager
def set_aside(paths: Iterable[Path]) -> Iterator[None]:
    """Rename files and folders during the block; remove them if it succeeds, restore them if it fails."""
    aside = {path: path.absolute().with_name(f".{path.name}.{os.getpid()}.old") for path in paths if path.exists()}
    for path, old in aside.items():
        os.rename(path, old)
    try:
        yield
    except BaseException:
        for path, old in aside.items():
            os.rename(old, path)
        raise
    for old in aside.values():
        if old.is_dir():
            shutil.rmtree(old)
        else:
            old.unlink()
