"""Failures of a command: one message on stderr, an exit status, and never a traceback."""

from __future__ import annotations

import errno
import os
import sys
import threading
import time
import traceback
from pathlib import Path

from ..errors import InsoleError

UNEXPECTED = 70  # EX_SOFTWARE of sysexits.h
INTERRUPTED = 130  # 128 + SIGINT, as shells count
_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
_FILE = (errno.ENOENT, errno.EISDIR, errno.ENOTDIR, errno.EACCES, errno.EPERM, errno.EEXIST, *_DISK)


def explain(error: BaseException) -> tuple[str, int]:
    """Return the message for `error` and the exit status; write a crash report if the error is unexpected."""
    if isinstance(error, InsoleError):
        return str(error), error.exit_status
    if isinstance(error, ModuleNotFoundError) and error.name is not None:
        from ..extras import extra_of, install_command

        extra = extra_of(error.name)
        if extra is not None:
            package = error.name.partition(".")[0]
            return f"this command needs {package}, which is not installed: {install_command(extra)}", 3
    if isinstance(error, OSError) and error.errno in _FILE and (error.filename is not None or error.errno in _DISK):
        where = f"{error.filename}: " if error.filename is not None else ""
        return f"{where}{error.strerror}", 4
    return f"{_summary(error)}. This is a defect of insole; {_written(error)}", UNEXPECTED


def report_threads() -> None:
    """Report an exception that ends a thread on one line, like the failure of a command."""

    def hook(arguments: threading.ExceptHookArgs) -> None:
        if arguments.exc_value is not None and arguments.exc_type is not SystemExit:
            print(f"insole: {explain(arguments.exc_value)[0]}", file=sys.stderr, flush=True)

    threading.excepthook = hook


def discard_output() -> None:
    """Discard the buffered stdout, because nobody reads it or the disk is full."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _summary(error: BaseException) -> str:
    text = str(error).strip().partition("\n")[0]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _written(error: BaseException) -> str:
    """Write the crash report and return its location, as the second half of a sentence."""
    import platform
    import tempfile

    from .. import __version__
    from ..service.state import state_folder

    text = (
        f"insole-daemon {__version__}, Python {platform.python_version()}, {platform.platform()}\n"
        f"arguments: {sys.argv[1:]}\n\n{''.join(traceback.format_exception(error))}"
    )
    name = f"crash-{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}.txt"
    for folder in (state_folder(), Path(tempfile.gettempdir())):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
        except OSError:
            continue
        return f"the details are in {folder / name}, please send them to us"
    return "the details could not be written: there is no room for them, or no permission"
