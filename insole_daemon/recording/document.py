"""Read and write recording.yaml, which lists the files of one trial (`insole-recording/1`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml

from ..config import Address, Foot
from ..documents import Key, Reading, Section, at_least, spell, within

FORMAT = "insole-recording/1"
FILE = "recording.yaml"

Kind = Literal["chamber", "shoe", "bench", "free"]
CanOrigin = Literal["recorded", "simulated", "reencoded"]
Clock = Literal["own", "can"]

# Columns of the reference besides time_s; more may follow.
REFERENCE_COLUMNS: Mapping[Kind, tuple[str, ...]] = {
    "chamber": ("pressure_pa",),
    "shoe": ("fz_n", "mx_nm", "my_nm"),
    "bench": ("reference",),
    "free": (),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedBoard(Section):
    """A board and the settings it streamed with; unknown settings are left out of the file and None here."""

    address: Address
    interface: str | None = None
    period_ms: Annotated[int, within(1, 255)] | None = None
    shift: Annotated[int, within(0, 7)] | None = None
    no_load: Annotated[int, within(1, 255)] | None = None
    skin_type: Literal[0, 1, 2, 3, 7, 8] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedInsole(Section):
    """One insole of the trial; files that are not known are None."""

    foot: Foot
    layout: Path | None = None  # None: the built-in approximation for its three boards
    calibration: Path | None = None
    zero: Path | None = None
    boards: Annotated[tuple[RecordedBoard, ...], at_least(1)]

    @property
    def addresses(self) -> tuple[int, ...]:
        """Return the addresses of the boards, in the order of the file."""
        return tuple(board.address for board in self.boards)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedReference(Section):
    """The reference instrument of one foot."""

    foot: Foot
    file: Path
    clock: Clock


@dataclass(frozen=True, slots=True, kw_only=True)
class Document(Section):
    """The content of recording.yaml, with exactly one of `can` and `counts`."""

    kind: Kind
    can: Path | None = None
    counts: Path | None = None
    can_origin: CanOrigin
    invented: tuple[str, ...] = ()  # a sentence per item that was not measured
    insoles: Annotated[tuple[RecordedInsole, ...], at_least(1)]
    reference: tuple[RecordedReference, ...] = ()

    @property
    def files(self) -> tuple[Path, ...]:
        """Return every file that is named, in the order of the file; counts may be a folder."""
        of_insoles = [path for insole in self.insoles for path in (insole.layout, insole.calibration, insole.zero)]
        named = [self.can, self.counts, *of_insoles, *(reference.file for reference in self.reference)]
        return tuple(path for path in named if path is not None)


def check(reading: Reading) -> None:
    """Report where the sections of a recording.yaml contradict each other."""
    document = reading.document
    given = [key for key in ("can", "counts") if document.get(key) is not None]
    if len(given) != 1:
        found = "both" if given else "neither"
        reading.problem(
            ("counts",) if given else ("can",),
            f"expected one of can (a candump log) and counts (an .npz where no frames were kept), found {found}",
        )
    if document.get("can_origin") == "reencoded" and not document.get("invented"):
        reading.problem(
            ("invented",),
            "missing key: expected a list of what was invented, since can_origin is reencoded "
            "(made from published numbers)",
        )
    _check_insoles(reading)
    _check_references(reading)


def _check_insoles(reading: Reading) -> None:
    """Report feet or boards that are listed twice, and insoles without a layout."""
    feet: dict[str, Key] = {}
    for key, insole in reading.of(RecordedInsole):
        if insole.foot in feet:
            where = spell(feet[insole.foot])
            reading.problem((*key, "foot"), f"the {insole.foot} foot is listed twice, first in {where}")
        feet.setdefault(insole.foot, key)
        if insole.layout is None and len(insole.boards) != 3:
            reading.problem(
                (*key, "layout"),
                "missing key: expected a layout file, or three boards (front, middle, rear) "
                f"for the built-in layout, found {len(insole.boards)}",
            )
    first: dict[int, Key] = {}
    for key, board in reading.of(RecordedBoard):
        if board.address in first:
            where = spell(first[board.address])
            reading.problem((*key, "address"), f"two boards on address {board.address}, the other is {where}")
        first.setdefault(board.address, key)


def _check_references(reading: Reading) -> None:
    """Report references that are missing, superfluous, listed twice, or of a foot that is not recorded."""
    kind = reading.document.get("kind")
    references = reading.of(RecordedReference)
    written = reading.document.get("reference")
    if kind == "free" and written:
        reading.problem(
            ("reference",),
            "expected none, since kind is free: set kind to chamber, shoe or bench, or remove the reference",
        )
    elif isinstance(kind, str) and kind in REFERENCE_COLUMNS and kind != "free" and not written:
        reading.problem(
            ("reference",), f"missing key: a recording of kind {kind} has a reference; without one its kind is free"
        )
    feet = {insole.foot for _, insole in reading.of(RecordedInsole)}
    first: dict[str, Key] = {}
    for key, reference in references:
        if reference.foot in first:
            where = spell(first[reference.foot])
            reading.problem((*key, "foot"), f"the {reference.foot} foot has two references, the first is {where}")
        first.setdefault(reference.foot, key)
        if feet and reference.foot not in feet:
            known = " and the ".join(sorted(feet))
            reading.problem(
                (*key, "foot"),
                f"the reference of the {reference.foot} foot, but the recorded foot is the {known}: "
                "correct the foot, or remove the reference",
            )


def dump(document: Mapping[str, Any]) -> str:
    """Return the text of a recording.yaml with the content of `document`, keys in its order, without None."""
    return yaml.safe_dump(_drop_none({"format": FORMAT, **document}), sort_keys=False, allow_unicode=True, width=120)


def _drop_none(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _drop_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_drop_none(item) for item in value]
    return value
