"""Options and helpers that several verbs share."""

from __future__ import annotations

import _thread
import signal
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ..config import Bus

ConfigFile = Annotated[
    Path | None, typer.Option("--config", help="config.yaml; without it, the built-in default is used.")
]
Connect = Annotated[
    str, typer.Option("--connect", help="Zenoh endpoint of the daemon: tcp/host:port, host:port or host.")
]
ZenohFile = Annotated[
    Path | None,
    typer.Option("--zenoh-config", help="Zenoh configuration file, which names the client certificate."),
]
RigName = Annotated[str, typer.Option("--rig", help="Name of the rig, if one endpoint leads to several.")]
Force = Annotated[bool, typer.Option("--force", help="Replace what this command wrote there before.")]
Calibrations = Annotated[
    list[Path] | None,
    typer.Option("--calibration", help="In place of the recording's own: calibration or model.json, one a foot."),
]
Seconds = Annotated[float | None, typer.Option("--seconds", min=0.1, help="End after this time.")]
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", help="Existing Dask scheduler, tcp:// or tls://; its workers must see the same files."),
]
TlsCa = Annotated[Path | None, typer.Option("--tls-ca", help="Certificate authority of the scheduler.")]
TlsCert = Annotated[Path | None, typer.Option("--tls-cert", help="Certificate of this client.")]
TlsKey = Annotated[Path | None, typer.Option("--tls-key", help="Key of that certificate.")]


class Which(StrEnum):
    """The insoles of a verb."""

    left = "left"
    right = "right"
    both = "both"


class OneFoot(StrEnum):
    """A single insole."""

    left = "left"
    right = "right"


def _bus(text: str) -> Bus:
    bus = Bus.parse(text)
    if bus is None:
        raise typer.BadParameter(f"expected {Bus.EXPECTED}, found {text!r}")
    return bus


_BUS = typer.Option("--bus", parser=_bus, metavar="DRIVER:CHANNEL", help="Bus on which the frames are sent.")
BusName = Annotated[Bus, _BUS]
OptionalBusName = Annotated[Bus | None, _BUS]


def refuse_existing_file(path: Path | None, force: bool) -> None:
    """Raise FileError if `path` is a folder, or exists and `force` is False."""
    from ..errors import FileError

    if path is None or not path.exists():
        return
    if path.is_dir():
        raise FileError(f"{path}: expected the name of a file, found a folder")
    if not force:
        raise FileError(f"{path}: is already there; choose another name, or replace it with --force")


def replace_folder(path: Path, force: bool, is_own: Callable[[Path], bool]) -> AbstractContextManager[None]:
    """Return a context in which the folder `path` is free to be written.

    Raises FileError if something exists there and `force` is False, or if `is_own` returns False for it: then no
    repeatable command has written it. The old folder is restored if the block fails.
    """
    from ..errors import FileError
    from ..files import set_aside

    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        if not force:
            raise FileError(f"{path}: is already there; choose another name, or replace it with --force")
        if not path.is_dir() or not is_own(path):
            raise FileError(
                f"{path}: --force replaces only what this command wrote before, and this is something else; "
                "choose another name"
            )
    return set_aside([path])


def is_repeatable(folder: Path) -> bool:
    """Return whether `insole simulate` or `insole import` wrote the recording `folder`, so that it can be repeated."""
    from ..documents import Reading
    from ..errors import DocumentError
    from ..recording.document import FILE

    try:
        document = Reading(folder / FILE).document
    except DocumentError:
        return False
    return isinstance(document, dict) and "source" in (document.get("extensions") or {})


def write_whole(path: Path, text: str) -> None:
    """Write a file, all or nothing; FileError if it cannot be written."""
    from ..errors import FileError
    from ..files import write_text

    try:
        write_text(path, text)
    except OSError as error:
        raise FileError(f"{path}: cannot be written: {error.strerror or error}") from error


def tls_of(ca: Path | None, cert: Path | None, key: Path | None) -> tuple[Path, Path, Path] | None:
    """Return the three files of a TLS client, or None without any; BadParameter if only some are given."""
    if ca is None and cert is None and key is None:
        return None
    if ca is None or cert is None or key is None:
        raise typer.BadParameter("TLS needs all three: --tls-ca, --tls-cert and --tls-key")
    return ca, cert, key


def name_next(command: str) -> None:
    """Print the command that a person may want next, at the end or when a long-running command starts."""
    print(f"insole: next: {command}", file=sys.stderr)


def on_end(stop: Callable[[], object]) -> None:
    """Call `stop` on SIGTERM and SIGINT, in its own thread.

    A signal handler runs in the main thread between any two steps. There `stop` could wait for ever for a lock that the
    interrupted step holds, or wake that step just before it begins to wait.
    """
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: _thread.start_new_thread(stop, ()))
