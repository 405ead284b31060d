"""config.yaml into frozen structs: which boards on which buses make up the insoles, and what is published.

`insole-config/1`. The structs' defaults are the built-in configuration; the repository's config.yaml says the
same, with every key explained.
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

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"  # loopback: nobody else reads along unless the config says so
DEFAULT_PORT = 7447
DEFAULT_SHIFT = 3  # of the only public launch file of this insole (SkinInsolesWearableDevice.xml)
DEFAULT_NO_LOAD = 240  # 0xF0: the host's default, and what the public insole recordings rest at
BUILT_IN_BOARDS = 3  # front, middle, rear: what the built-in layout is made for


@dataclass(frozen=True, slots=True)
class Bus:
    """A CAN interface: `channel` is its name everywhere else, `driver` is python-can's or `socketcan`."""

    EXPECTED: ClassVar[str] = "a text driver:channel, such as socketcan:can0"

    driver: str
    channel: str

    def __str__(self) -> str:
        """As it stands in the file."""
        return f"{self.driver}:{self.channel}"

    @classmethod
    def parse(cls, text: str) -> Bus | None:
        """The bus that `text` names, None if it does not name one."""
        driver, _, channel = text.partition(":")
        if not driver.isidentifier() or not channel or any(letter.isspace() for letter in channel):
            return None
        return cls(driver, channel)


@dataclass(frozen=True, slots=True, kw_only=True)
class Board(Section):
    """One board (MTB): where it is, and the settings it streams with."""

    address: Address
    interface: str  # channel of one of the buses
    period_ms: Annotated[int, within(1, 255)] = 20  # one byte of the board's configuration command
    shift: Annotated[int, within(0, 7)] = DEFAULT_SHIFT
    no_load: Annotated[int, within(1, 255)] = DEFAULT_NO_LOAD
    skin_type: Literal[0, 1, 2, 3, 7, 8] = 0  # temperature compensation of the firmware; 7 is raw test mode


@dataclass(frozen=True, slots=True, kw_only=True)
class Insole(Section):
    """One insole; without `layout` its boards are the front, the middle and the rear one, in this order."""

    foot: Foot
    layout: Path | None = None  # None: the built-in approximation
    calibration: Path | None = None  # None: the built-in default
    zero: Path | None = None  # None: the one that `insole zero` stored last, if there is one
    model: Literal["static", "dynamic"] = "dynamic"  # of a calibration with effects
    boards: Annotated[tuple[Board, ...], at_least(1)]

    @property
    def addresses(self) -> tuple[int, ...]:
        """Of the boards, in the order of the file."""
        return tuple(board.address for board in self.boards)


@dataclass(frozen=True, slots=True, kw_only=True)
class Publish(Section):
    """When a cycle is published, and when what is in it counts as stale."""

    slack_ms: Annotated[float, within(0, 1000)] = 5.0
    rate_hz: Annotated[float, within(0.1, 1000)] = 50.0
    stale_after_ms: Annotated[float, within(1, 60_000)] = 200.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact(Section):
    """What counts as being touched."""

    # The paper left activations below 30 counts out; that drops real pressure, so it is off unless asked for.
    activation_threshold_count: Annotated[float, within(0, 255)] = 0.0
    min_force_n: Annotated[float, within(0, 10_000)] = 20.0  # below it, the CoP is null
    min_pressure_pa: Annotated[float, within(0, 10_000_000)] = 20_000.0  # from it on, a taxel is contact area


@dataclass(frozen=True, slots=True, kw_only=True)
class Boards(Section):
    """What the daemon may do to the boards."""

    configure: bool = False  # False: not one frame is sent to any bus


@dataclass(frozen=True, slots=True, kw_only=True)
class Zenoh(Section):
    """How the daemon is reached."""

    mode: Literal["peer", "client", "router"] = "peer"
    listen: tuple[Endpoint, ...] = (DEFAULT_ENDPOINT,)
    connect: tuple[Endpoint, ...] = ()
    config_file: Path | None = None  # Zenoh's own configuration, for certificates and access rules


def _built_in_insoles() -> tuple[Insole, ...]:
    # The six addresses are public, which of them are left is not: this split is an assumption.
    feet: tuple[tuple[Foot, tuple[int, ...]], ...] = (("left", (5, 6, 7)), ("right", (8, 9, 10)))
    return tuple(
        Insole(foot=foot, boards=tuple(Board(address=a, interface="can0") for a in addresses))
        for foot, addresses in feet
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Config(Section):
    """All that the daemon is told."""

    rig: Annotated[str, matching(r"[A-Za-z0-9_-]+", " of letters, digits, - and _")] = "insole1"
    buses: Annotated[tuple[Bus, ...], at_least(1)] = (Bus("socketcan", "can0"),)
    insoles: Annotated[tuple[Insole, ...], at_least(1)] = field(default_factory=_built_in_insoles)
    publish: Publish = Publish()
    contact: Contact = Contact()
    boards: Boards = Boards()
    zenoh: Zenoh = Zenoh()


def load(path: str | PathLike[str] | None = None) -> Config:
    """The configuration `path` says, or the built-in one; DocumentError lists all that is wrong with it.

    Relative paths in it are relative to the folder it is in.
    """
    return Config() if path is None else read(path, Config, FORMAT, _check)


def check_insoles(reading: Reading) -> None:
    """Report a foot or a board's address that stands twice; for every file that has `insoles`."""
    feet: dict[str, Key] = {}
    for key, insole in reading.of(Insole):
        if insole.foot in feet:
            first = spell(feet[insole.foot])
            reading.problem((*key, "foot"), f"the {insole.foot} foot stands twice, first in {first}")
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
                (*key, "connect"), "a client is reached through the router it connects to: expected its endpoint"
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
        first = next(spell(other) for other, earlier in buses[: i + 1] if earlier.channel == bus.channel)
        if first != spell(key):
            reading.problem(key, f"two buses with the channel {bus.channel}, the other is {first}")
    written = reading.document.get("buses", [])
    if not isinstance(written, list) or len(written) > len(buses):
        return  # the bus that is wrong may be the one a board means
    channels = [bus.channel for _, bus in buses] or [bus.channel for bus in Config().buses]
    interfaces = [((*key, "interface"), board.interface) for key, board in reading.of(Board)]
    if "insoles" not in reading.document:
        interfaces = [(("insoles",), _built_in_insoles()[0].boards[0].interface)]
    for key, interface in interfaces:
        if interface not in channels:
            known = ", ".join(channels)
            reading.problem(key, f'the interface "{interface}" is no channel of the buses, which are: {known}')
