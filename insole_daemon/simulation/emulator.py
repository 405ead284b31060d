"""Emulate the boards of one or both feet on one bus, for a log or in real time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

import numpy as np

from ..bus.frames import FrameBatch
from ..config import Config
from ..physics.sampling import Jitter, Losses
from ..skin.layout import Layout
from .board import EmulatedBoard
from .faults import InjectedFault, check_faults
from .generation import GENERATIONS, GenerationName
from .load import Load
from .reception import Reception
from .run import BoardRun, MountedBoard
from .sensors import Temperature

# Duration of frames prepared at once when playing, which is also the delay of a command. A longer one costs less, so it
# is short only after a command, when more commands are likely.
_PREPARE_NS, _PREPARE_IN_DIALOGUE_NS, _DIALOGUE_NS = 100_000_000, 20_000_000, 1_000_000_000
_GROUP_S = 0.002  # frames due within this time are sent together
_SKIP_LATE_NS = 500_000_000  # later frames are skipped, because a real bus does not catch up
_CHUNK_NS = 1_000_000_000  # duration of frames prepared at once when writing, and the maximum when playing


class Emulator:
    """The boards of one or both feet, all on one bus whatever interface they are configured on."""

    def __init__(
        self,
        config: Config,
        layouts: Sequence[Layout],
        load: Load,
        *,
        seed: int = 0,
        streaming: bool = True,
        left_out: Collection[int] = (),
        generation: GenerationName | Mapping[int, GenerationName] | None = None,
        faults: Sequence[InjectedFault] = (),
        status_bits: bool = True,
        cdc_hz: float | Mapping[int, float] | None = None,
        temperature_c: Temperature | None = None,
        noise_key: int = 0,
        nominal_sensors: bool = False,
        shifts: Mapping[int, Mapping[int, int]] | None = None,
        jitter: Mapping[int, Mapping[str, float]] | None = None,
        loss: Mapping[int, Mapping[str, float]] | None = None,
        noise: float = 1.0,
    ) -> None:
        """Emulate the boards of those feet of `config` that have a layout, under `load`; same arguments, same frames.

        `streaming`: the boards start configured and sending; otherwise they are silent until commanded. `left_out`:
        addresses of missing boards. `generation`: of all boards, or by address ("mtb4" if not given). None is an MTB4
        without the temperature compensation of skin types 0 and 8, which adds the noise of pad 6; with `faults` or
        `temperature_c`, which the compensation changes, it is "mtb4" for all boards. `status_bits` False: the status in
        every half B is 0. `cdc_hz`: rate of the free-running converters (sampling.CDC_HZ in reality), of all boards or
        by address; None: a reading is as old as its tick. `temperature_c`: of all insoles, from seconds since power-up
        (n,) to °C (n,); None is 25 °C. `noise_key`: selects other noise on the same sensors. `nominal_sensors`: every
        sensor is the nominal line, because `load` already contains the sensors (`sensed.SensedLoad`). `shifts`: by
        board and triangle, digitisers whose shift differs from the configured one. `jitter`, `loss`: by address, the
        values of these effects on a board's frames. `noise`: factor of the reference insole's noise.
        """
        check_faults(faults, config, layouts)
        self._compensated = generation is not None or bool(faults) or temperature_c is not None
        self._generation = generation
        self._faults = tuple(faults)
        self._status_bits = status_bits
        self._cdc_hz = cdc_hz
        self._temperature_c = temperature_c
        self._noise_key, self._nominal_sensors, self._noise = noise_key, nominal_sensors, noise
        self._shifts = shifts or {}
        self._jitter, self._loss = jitter or {}, loss or {}
        self._config = config
        self._layouts = {layout.foot: layout for layout in layouts}
        self._load = load
        self._seed = seed
        self._streaming = streaming
        self._left_out = frozenset(left_out)
        self.playing_since_ns: int | None = None  # CLOCK_REALTIME of the load's t = 0 while playing

    def run(self, t_start_ns: int) -> BoardRun:
        """Return the boards, powered up at `t_start_ns`; every run starts again from the seed."""
        return BoardRun(self._create_boards(), self._load, t_start_ns)

    def frames(self, t_start_ns: int, seconds: float) -> FrameBatch:
        """Return all frames that begin within `seconds` of `t_start_ns`, stamped with the time at which they end."""
        return FrameBatch.concatenate(list(self.batches(t_start_ns, seconds)))

    def batches(self, t_start_ns: int, seconds: float) -> Iterator[FrameBatch]:
        """Yield the same frames in batches."""
        run, reception = self.run(t_start_ns), self._create_reception()
        t_end_ns = t_start_ns + round(seconds * 1e9)
        while run.now_ns < t_end_ns:
            yield reception(run.advance(min(run.now_ns + _CHUNK_NS, t_end_ns)))

    def play(
        self,
        send: Callable[[FrameBatch], None],
        stop: threading.Event,
        seconds: float | None = None,
        receive: Callable[[], FrameBatch] | None = None,
    ) -> int:
        """Send the frames when they are due, until `stop` is set or for `seconds`; return how many were sent.

        `receive` returns the frames received since its last call; the boards obey the commands among them.
        """
        self.playing_since_ns = t_start_ns = time.time_ns()
        since_start_ns = time.monotonic_ns() - t_start_ns  # waiting must use a clock that does not step
        t_end_ns = None if seconds is None else t_start_ns + round(seconds * 1e9)
        run, reception = self.run(t_start_ns), self._create_reception()
        sent, dialogue_until_ns = 0, t_start_ns
        while not stop.is_set() and (t_end_ns is None or run.now_ns < t_end_ns):
            if receive is not None and run.obey(receive()):
                dialogue_until_ns = run.now_ns + _DIALOGUE_NS
            # After a delay, prepare all missed frames at once: in short batches the emulator would never catch up.
            from_ns = max(run.now_ns, time.monotonic_ns() - since_start_ns)
            until_ns = from_ns + (_PREPARE_IN_DIALOGUE_NS if run.now_ns < dialogue_until_ns else _PREPARE_NS)
            until_ns = min(until_ns, run.now_ns + _CHUNK_NS, t_end_ns or until_ns)
            batch = reception(run.advance(until_ns))
            sent += _send_when_due(batch, run.now_ns, since_start_ns, send, stop)
        return sent

    def _create_reception(self) -> Reception:
        return Reception(
            {address: Jitter(**values, seed=self._seed, board=address) for address, values in self._jitter.items()},
            {address: Losses(**values, seed=self._seed, board=address) for address, values in self._loss.items()},
        )

    def _name_of_generation(self, address: int) -> GenerationName:
        if self._generation is None:
            return "mtb4"
        return self._generation if isinstance(self._generation, str) else self._generation.get(address, "mtb4")

    def _create_boards(self) -> list[MountedBoard]:
        """Create the emulated boards of all feet that have a layout."""
        mounted = []
        for insole in self._config.insoles:
            layout = self._layouts.get(insole.foot)
            if layout is None:
                continue
            for board in insole.boards:
                if board.address in self._left_out:
                    continue
                row_of_triangle = {t: row for (address, t), row in layout.rows.items() if address == board.address}
                emulated = EmulatedBoard(
                    board.address,
                    sorted(row_of_triangle),
                    period_ms=board.period_ms,
                    shift=board.shift,
                    no_load=board.no_load,
                    skin_type=board.skin_type,
                    seed=self._seed,
                    streaming=self._streaming,
                    generation=GENERATIONS[self._name_of_generation(board.address)],
                    compensated=self._compensated,
                    faults=self._faults,
                    status_bits=self._status_bits,
                    cdc_hz=self._cdc_hz.get(board.address) if isinstance(self._cdc_hz, Mapping) else self._cdc_hz,
                    temperature_c=self._temperature_c,
                    noise_key=self._noise_key,
                    nominal_sensors=self._nominal_sensors,
                    real_shifts=self._shifts.get(board.address),
                    noise=self._noise,
                )
                rows = np.array([row_of_triangle[triangle] for triangle in sorted(row_of_triangle)], np.intp)
                mounted.append(MountedBoard(emulated, insole.foot, rows))
        return mounted


def _send_when_due(
    batch: FrameBatch,
    until_ns: int,
    since_start_ns: int,
    send: Callable[[FrameBatch], None],
    stop: threading.Event,
) -> int:
    """Send the frames of one interval in small groups, return at its end with the number sent."""
    next_row = sent = 0
    while not stop.is_set():
        now_ns = time.monotonic_ns() - since_start_ns
        missed, due = np.searchsorted(batch.t_ns, [now_ns - _SKIP_LATE_NS, now_ns], side="right").tolist()
        next_row = max(next_row, missed)
        if due > next_row:
            send(batch[next_row:due])
            sent, next_row = sent + due - next_row, due
        if next_row == len(batch) and now_ns >= until_ns:
            break
        next_ns = int(batch.t_ns[next_row]) if next_row < len(batch) else until_ns
        stop.wait(max(_GROUP_S, (next_ns - now_ns) * 1e-9))
    return sent
