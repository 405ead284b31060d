"""Files that are written all or nothing, and read up to a size."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path`: whatever happens, there is the file that was there before, or the new one.

    Raises OSError where it cannot be written, and then leaves nothing behind.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    # In the same folder: a rename is atomic only within one file system.
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with open(unfinished, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(unfinished, path)
    except OSError:
        with contextlib.suppress(OSError):
            unfinished.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)  # else the rename itself may not survive
    finally:
        os.close(folder)


def read_at_most(path: Path, most_bytes: int) -> bytes:
    """The content of `path`; OSError where it cannot be read or is longer, without reading more than that."""
    with open(path, "rb") as file:
        content = file.read(most_bytes + 1)
        if len(content) > most_bytes:
            found_mb = max(len(content), os.fstat(file.fileno()).st_size) / 1e6
            what = f"expected at most {most_bytes / 1e6:.1f} MB, found {found_mb:.1f} MB: is it the file that is meant?"
            raise OSError(errno.EFBIG, what)
    return content


_WHY = {
    errno.ENOENT: "there is no such file; check the path",
    errno.ENOTDIR: "there is no such file; check the path",
    errno.EISDIR: "it is a folder; name a file",
    errno.EACCES: "this user may not; check its permissions",
}


def unreadable(error: OSError) -> str:
    """Return why a file cannot be read, and what to do about it."""
    return f"cannot be read: {_WHY.get(error.errno or 0) or error.strerror or error}"


@contextlib.contextmanager
def unfinished(path: Path) -> Iterator[Path]:
    """A path beside `path` to write a file to, which takes its place in the end, or leaves nothing behind."""
    beside = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        yield beside
        with open(beside, "rb") as file:
            os.fsync(file.fileno())
        os.replace(beside, path)
    except BaseException:
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)
        raise


@contextlib.contextmanager
def set_aside(paths: Iterable[Path]) -> Iterator[None]:
    """Take files and folders away for the block: removed where it ends well, put back where it fails."""
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
