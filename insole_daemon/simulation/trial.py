"""A simulated trial: a scenario on simulated insoles, written as a recording or played on a bus."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..bus.frames import FrameBatch
from ..config import Config
from ..errors import SimulationError
from ..physics.draws import Drawn, Draws
from ..physics.portable import exp
from ..recording.copies import InsoleContents
from ..recording.writer import ReferenceContents, write
from ..skin.bus_load import Stream, bus_load, check_fits
from ..skin.layout import Layout
from . import instruments
from .conditions import Conditions, check_conditions
from .effects_file import Effects
from .emulator import Emulator
from .foot import Places
from .reference_insole import reference_insole
from .scenarios import check_used, length_s, scenario
from .sensed import SensedLoad, SimulatedInsole

START_NS = 1_760_000_000_000_000_000  # start of every recording, since a simulated trial has no date
ENDLESS_S = 60.0  # length of a recording of an endless scenario
_INTERFACE = "can0"


class Trial:
    """A scenario on simulated insoles; same arguments, same bytes.

    `insoles` have the true static curves; `load` is the load on them.
    """

    def __init__(
        self,
        name: str,
        config: Config,
        layouts: Sequence[Layout],
        *,
        effects: Effects | None = None,
        conditions: Conditions | None = None,
        seed: int = 0,
    ) -> None:
        """Prepare the scenario `name` on the feet of `config` that have a layout.

        `effects` are those of the true sensors, by foot. Raises SimulationError if there is no such scenario or it does
        not use such conditions, BusError if one bus cannot carry the boards.
        """
        self.scenario = scenario(name)
        self.conditions = conditions or Conditions()
        check_conditions(self.conditions)
        check_used(name, self.conditions)
        self._name, self._seed = name, seed
        self._config = replace(
            config, insoles=tuple(i for i in config.insoles if any(i.foot == layout.foot for layout in layouts))
        )
        check_boards_and_bus(self._config, layouts)
        constants = reference_insole()
        boards = {insole.foot: insole.boards for insole in config.insoles}
        self.insoles = [
            SimulatedInsole(
                layout,
                boards[layout.foot],
                constants.calibration(layout, boards[layout.foot], seed),
                (effects or {}).get(layout.foot, ()),
            )
            for layout in layouts
        ]
        self._check_clock()
        places: Places = {insole.layout.foot: insole.chain.xy_m for insole in self.insoles}
        self.load = self.scenario.load(layouts, places, self.conditions, seed)
        # The noise depends on the trial; the insole depends on the seed alone.
        self._noise_key = zlib.crc32(f"{name} {self.conditions.take}".encode())
        self.emulator = Emulator(
            self._config,
            layouts,
            SensedLoad(self.load, self.insoles, self.temperature_c),
            seed=seed,
            noise_key=self._noise_key,
            nominal_sensors=True,
            shifts={board: of for insole in self.insoles for board, of in insole.real_shifts().items()},
            jitter=self._values_by_board("jitter"),
            loss=self._values_by_board("loss"),
            generation=self.conditions.generation,
            faults=self.conditions.faults,
            cdc_hz={board: of["rate_hz"] for board, of in self._values_by_board("sample_and_hold").items()},
            temperature_c=self.temperature_c,
        )

    def _values_by_board(self, word: str) -> dict[int, Mapping[str, float]]:
        return {board: values for insole in self.insoles for board, values in insole.values_by_board(word).items()}

    def _check_clock(self) -> None:
        """Raise SimulationError if both a clock effect and a chosen clock are given."""
        chosen = self.conditions.reference
        if chosen.offset_s is None and chosen.rate_ppm is None:
            return
        if any(_has_clock_effect(insole) for insole in self.insoles):
            raise SimulationError(
                "reference.offset_s and rate_ppm: expected either these or the effect clock, found both: "
                "leave one of them out"
            )

    def temperature_c(self, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n,) the insoles' temperature: the chosen course, else a worn shoe warms up and a chamber does not."""
        if self.conditions.temperature is not None:
            return self.conditions.temperature(t_s)
        constants = reference_insole()
        if self.scenario.kind == "chamber":
            return np.full_like(t_s, constants.rest_c)
        return constants.rest_c + constants.shoe_warms_k * (1.0 - exp(-t_s / constants.shoe_warms_in_s))

    def length_s(self, seconds: float | None = None) -> float | None:
        """Return how long to play if `seconds` are requested, None for ever; SimulationError if the load is shorter."""
        return length_s(self._name, self.conditions, seconds, None)

    def write(
        self,
        folder: str | PathLike[str],
        seconds: float | None = None,
        progress: Callable[[float], None] = lambda share: None,
    ) -> Path:
        """Write the trial as the recording `folder` and return its path; `seconds` None: all of it.

        `progress` is called with the fraction simulated. Raises SimulationError if `seconds` exceeds the load,
        FileError if the folder cannot be written.
        """
        duration_s = length_s(self._name, self.conditions, seconds, ENDLESS_S)
        assert duration_s is not None
        boards = {insole.foot: insole.boards for insole in self._config.insoles}
        return write(
            folder,
            kind=self.scenario.kind,
            can_origin="simulated",
            insoles=[
                InsoleContents(
                    insole.layout.foot,
                    [replace(board, interface=_INTERFACE) for board in boards[insole.layout.foot]],
                    insole.layout,
                    insole.calibration,
                )
                for insole in self.insoles
            ],
            frames=with_progress(self.emulator.batches(START_NS, duration_s), START_NS, duration_s, progress),
            interfaces=(_INTERFACE,),
            reference=[self._simulate_reference(insole, duration_s) for insole in self.insoles],
            # The source names neither effects nor faults, because a diagnosis has to find them.
            source=f"insole simulate {self._name} --seed {self._seed}",
        )

    def _simulate_reference(self, insole: SimulatedInsole, seconds: float) -> ReferenceContents:
        """Simulate the reference of one foot."""
        foot = insole.layout.foot
        chosen = self.conditions.reference
        drawn = instruments.draw_clock(Draws(self._seed, Drawn.CLOCK), chosen)
        return instruments.simulate_readings(
            foot,
            self.load,
            seconds,
            START_NS * 1e-9,
            insole.chain.reference_s if _has_clock_effect(insole) else drawn,
            self.temperature_c,
            Draws(self._seed, Drawn.INSTRUMENT, 0 if foot == "left" else 1, self._noise_key),
            chosen,
        )


def with_progress(
    batches: Iterable[FrameBatch], start_ns: int, seconds: float, progress: Callable[[float], None]
) -> Iterator[FrameBatch]:
    """Yield the `batches` of a trial of `seconds` from `start_ns` on; `progress` gets the share done after each."""
    for batch in batches:
        yield batch
        if len(batch):
            progress(min(1.0, float(batch.t_ns[-1] - start_ns) * 1e-9 / seconds))


def _has_clock_effect(insole: SimulatedInsole) -> bool:
    return any(effect.law.word == "clock" for effect in insole.effects)


def check_boards_and_bus(config: Config, layouts: Sequence[Layout]) -> None:
    """Raise SimulationError if boards lack triangles of a layout, BusError if one bus cannot carry them."""
    streams = []
    for layout in layouts:
        boards = [board for insole in config.insoles if insole.foot == layout.foot for board in insole.boards]
        addresses = {board.address for board in boards}
        unknown = sorted({triangle.board for triangle in layout.triangles} - addresses)
        if unknown:
            raise SimulationError(
                f"the layout of the {layout.foot} foot: triangles[].board: expected the boards of this foot "
                f"({', '.join(map(str, sorted(addresses))) or 'none is configured'}), found {unknown[0]}: "
                "configure the board, or remove its triangles from the layout"
            )
        for board in boards:
            triangles = [t.triangle for t in layout.triangles if t.board == board.address]
            if len(set(triangles)) < len(triangles) or any(not 0 <= triangle <= 15 for triangle in triangles):
                raise SimulationError(
                    f"the layout of the {layout.foot} foot: board {board.address}: expected triangles 0 to 15, each "
                    f"once, found {sorted(triangles)}: a board has 16 of them"
                )
            streams.append(Stream(board.address, len(triangles), board.period_ms))
    check_fits(bus_load(_INTERFACE, streams))
