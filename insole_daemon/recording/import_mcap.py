"""Restore a recording from an MCAP file that `insole export` wrote."""

from __future__ import annotations

from pathlib import Path

from ..errors import FileError
from ..untrusted import quoted
from .document import FILE
from .lab import need
from .writer import whole_folder


def import_mcap(source: Path, out: Path) -> Path:
    """Write the recording `out` from the attachments of `source`; FileError if they are not a recording."""
    reader_module = need("mcap.reader", "mcap", "importing MCAP")
    try:
        with open(source, "rb") as file:
            files = {
                attachment.name: attachment.data for attachment in reader_module.make_reader(file).iter_attachments()
            }
    except Exception as error:  # mcap raises exceptions of many types
        what = f"{type(error).__name__}: {error}"
        raise FileError(f"{source}: expected an MCAP file, found one that cannot be read: {what}") from error
    if FILE not in files or not all(map(_is_plain_name, files)):
        raise FileError(
            f"{source}: expected an MCAP file with a recording in its attachments, as 'insole export' writes it, "
            f"found {quoted(list(files)) if files else 'no attachment'}"
        )
    with whole_folder(out) as folder:
        for name, content in files.items():
            (folder / name).write_bytes(content)
    return out


def _is_plain_name(name: str) -> bool:
    """Return whether `name` is a visible file in the folder itself, so that nothing is written outside it."""
    return name != "" and Path(name).name == name and name.isprintable() and not name.startswith(".")
