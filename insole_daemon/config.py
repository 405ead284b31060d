"""The configuration `insole-config/1` as frozen structs: buses, boards, insoles, and publication.

The structs' defaults are the built-in configuration. The repository's config.yaml has the same values and explains
every key.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from .documents import Key, Reading, Section, at_least, matching, read, spell, within

FORMAT = "insole-config/1"

Foot = Literal["left", "right"]
Address = Annotated[int, within(1, 14)]  # 0 is the host, 15 is everyone
Endpoint = Annotated[str, matching(r"[a-z][a-z0-9_-]*/\S+", " such as tcp/127.0.0.1:7447")]

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"  # loopback: other hosts cannot connect unless the configuration permits it
DEFAULT_PORT = 7447
DEFAULT_SHIFT = 3  # of the only public launch file of this insole (SkinInsolesWearableDevice.xml)
DEFAULT_NO_LOAD = 240  # 0xF0: the host's default, and the unloaded count of the public insole recordings
BUILT_IN_BOARDS = 3  # front, middle, rear: the boards of the built-in layout


@dataclass(frozen=True, slots=True)
class Bus:
    """A CAN interface: `channel` is its name in messages and for boards, `driver` is python-can's or `socketcan`."""

    EXPECTED: ClassVar[str] = "a text driver:channel, such as socketcan:can0"

    driver: str
    channel: str

    def __str__(self) -> str:
        """The bus as written in the file."""
        return f"{self.driver}:{self.channel}"

    @classmethod
    def parse(cls, text: str) -> Bus | None:
        """Return the bus that `text` names, or None if it does not name one."""
        driver, _, channel = text.partition(":")
        if not driver.isidentifier() or not channel or any(letter.isspace() for letter in channel):
            return None
        return cls(driver, channel)


@dataclass(frozen=True, slots=True, kw_only=True)
class Board(Section):
    """One board (MTB): its address, its interface and its settings."""

    address: Address
    interface: str  # channel of one of the buses
    period_ms: Annotated[int, within(1, 255)] = 20  # one byte of the board's configuration command
    shift: Annotated[int, within(0, 7)] = DEFAULT_SHIFT
    no_load: Annotated[int, within(1, 255)] = DEFAULT_NO_LOAD
    skin_type: Literal[0, 1, 2, 3, 7, 8] = 0  # temperature compensation of the firmware; 7 is raw test mode


@dataclass(frozen=True, slots=True, kw_only=True)
class Insole(Section):
    """One insole; without `layout` its boards are the front, middle and rear one, in this order."""

    foot: Foot
    layout: Path | None = None  # None: the built-in approximation
    calibration: Path | None = None  # None: the built-in default
    zero: Path | None = None  # None: the one that `insole zero` stored last, if any
    model: Literal["static", "dynamic"] = "dynamic"  # of a calibration with effects
    boards: Annotated[tuple[Board, ...], at_least(1)]

    @property
    def addresses(self) -> tuple[int, ...]:
        """Addresses of the boards, in the order of the file."""
        return tuple(board.address for board in self.boards)


@dataclass(frozen=True, slots=True, kw_only=True)
class Publish(Section):
    """Timing of the cycles, and the age from which readings are stale."""

    slack_ms: Annotated[float, within(0, 1000)] = 5.0
    rate_hz: Annotated[float, within(0.1, 1000)] = 50.0
    stale_after_ms: Annotated[float, within(1, 60_000)] = 200.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact(Section):
    """Thresholds of contact."""

    # The paper left out activations below 30 counts. That drops real pressure, so the default is 0.
    activation_threshold_count: Annotated[float, within(0, 255)] = 0.0
    min_force_n: Annotated[float, within(0, 10_000)] = 20.0  # below it, the CoP is null
    min_pressure_pa: Annotated[float, within(0, 10_000_000)] = 20_000.0  # from it on, a taxel is contact area


@dataclass(frozen=True, slots=True, kw_only=True)
class Boards(Section):
    """Permissions of the daemon on the boards."""

    configure: bool = False  # False: not one frame is sent to any bus


@dataclass(frozen=True, slots=True, kw_only=True)
class Zenoh(Section):
    """The daemon's Zenoh session."""

    mode: Literal["peer", "client", "router"] = "peer"
    listen: tuple[Endpoint, ...] = (DEFAULT_ENDPOINT,)
    connect: tuple[Endpoint, ...] = ()
    config_file: Path | None = None  # Zenoh's own configuration, for certificates and access rules


def _built_in_insoles() -> tuple[Insole, ...]:
    # The six addresses are public, but not which of them are left: this split is an assumption.
    feet: tuple[tuple[Foot, tuple[int, ...]], ...] = (("left", (5, 6, 7)), ("right", (8, 9, 10)))
    return tuple(
        Insole(foot=foot, boards=tuple(Board(address=a, interface="can0") for a in addresses))
        for foot, addresses in feet
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Config(Section):
    """The complete configuration of the daemon."""

    rig: Annotated[str, matching(r"[A-Za-z0-9_-]+", " of letters, digits, - and _")] = "insole1"
    buses: Annotated[tuple[Bus, ...], at_least(1)] = (Bus("socketcan", "can0"),)
    insoles: Annotated[tuple[Insole, ...], at_least(1)] = field(default_factory=_built_in_insoles)
    publish: Publish = Publish()
    contact: Contact = Contact()
    boards: Boards = Boards()
    zenoh: Zenoh = Zenoh()


def load(path: str | PathLike[str] | None = None) -> Config:
    """Return the configuration in file `path`, or the built-in one; DocumentError lists all its problems.

    Relative paths in it are relative to its folder.
    """
    return Config() if path is None else read(path, Config, FORMAT, _check)


def check_insoles(reading: Reading) -> None:
    """Report a foot or a board's address that is listed twice; for every file with `insoles`."""
    feet: dict[str, Key] = {}
    for key, insole in reading.of(Insole):
        if insole.foot in feet:
            first = spell(feet[insole.foot])
            reading.problem((*key, "foot"), f"the {insole.foot} foot is listed twice, first in {first}")
        feet.setdefault(insole.foot, key)
    boards: dict[int, Key] = {}
    for key, board in reading.of(Board):
        if board.address in boards:
            first = spell(boards[board.address])
            reading.problem(
                (*key, "address"),
                f"two boards on address {board.address}, the other is {first}: "
                "an address is unique within a rig, on both feet",
            )
        boards.setdefault(board.address, key)


def _check(reading: Reading) -> None:
    check_insoles(reading)
    for key, zenoh in reading.of(Zenoh):
        if zenoh.mode == "client" and not zenoh.connect:
            reading.problem(
                (*key, "connect"), "a daemon in mode client needs the endpoint of its router here: expected one"
            )
    for key, insole in reading.of(Insole):
        n = len(reading.document["insoles"][key[1]]["boards"])  # wrong ones count too
        if insole.layout is None and n != BUILT_IN_BOARDS:
            reading.problem(
                (*key, "layout"),
                f"missing key: expected a layout file, or {BUILT_IN_BOARDS} boards (front, middle, rear) "
                f"for the built-in layout, found {n}",
            )
    buses = reading.of(Bus)
    for i, (key, bus) in enumerate(buses):
        first = next(spell(same) for same, earlier in buses[: i + 1] if earlier.channel == bus.channel)
        if first != spell(key):
            reading.problem(key, f"two buses with the channel {bus.channel}, the other is {first}")
    written = reading.document.get("buses", [])
    if not isinstance(written, list) or len(written) > len(buses):
        return  # an invalid bus may be the one that a board names
    channels = [bus.channel for _, bus in buses] or [bus.channel for bus in Config().buses]
    interfaces = [((*key, "interface"), board.interface) for key, board in reading.of(Board)]
    if "insoles" not in reading.document:
        interfaces = [(("insoles",), _built_in_insoles()[0].boards[0].interface)]
    for key, interface in interfaces:
        if interface not in channels:
            channels_text = ", ".join(channels)
            reading.problem(key, f'the interface "{interface}" is not a channel of the buses: {channels_text}')
