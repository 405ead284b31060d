"""What a chamber says of effects that walks have shown: its load is known, so they are tried on it as they are.

The effect acts on the chamber's load beside what was found there, with free curves and clocks. A slow load says nothing
of what is fast: then it makes no difference, and the chamber neither shows nor contradicts it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..physics.chain import Chain
from ..physics.effect import Effect
from ..physics.law import Array
from ..skin.geometry import N_TAXELS
from .diagnosing import Diagnosis
from .fit import Hypothesis
from .groups import LEAST_EXCESS
from .observed import Load
from .opinion import Opinion


def opinions(chamber: Diagnosis, effects: Sequence[Effect]) -> Mapping[str, Opinion]:
    """By word, what the recordings of `chamber` say of `effects`, each asked with the load of its first taxel."""
    own = [each for each in chamber.effects if each.law.domain == "pressure"]
    noise = float(np.sqrt(np.mean(chamber.insole.noise_count**2)))
    found = {}
    for word in dict.fromkeys(each.law.word for each in effects):
        these = [each for each in effects if each.law.word == word]
        slots = np.concatenate([each.where.slots(chamber.insole.layout) for each in these])
        columns = np.flatnonzero(np.isin(chamber.located.slots, slots))
        without, with_it = (_left(chamber, columns, acting) for acting in (own, [*own, *these]))
        gained, names = without - with_it, np.array(chamber.insole.recordings)
        rms = tuple(noise * float(np.sqrt(np.mean(left))) for left in (without, with_it))
        found[word] = Opinion(
            tuple(names[gained > LEAST_EXCESS**2].tolist()),
            tuple(names[gained < -(LEAST_EXCESS**2)].tolist()),
            (rms[0], rms[1]),
        )
    return found


def _left(chamber: Diagnosis, columns: NDArray[np.intp], effects: Sequence[Effect]) -> Array:
    """(recordings,) mean square of readings, in units of their noise, of the taxels `columns` under these effects."""
    taxels = chamber.located.taxels.of_taxels(columns)
    slot = int(chamber.located.slots[columns[0]])
    chain = Chain(effects, chamber.insole.layout)
    observed = []
    for each in taxels.observed:
        load = each.load
        everywhere = np.broadcast_to(load.pressure_pa[..., None], (len(load.t_s), len(chamber.insole.layout), N_TAXELS))
        felt = chain.forward()(everywhere, load.t_s - load.start_s).reshape(len(load.t_s), -1)[:, slot, None]
        observed.append(replace(each, load=Load(load.start_s, load.step_s, felt, load.clock)))
    fitted = Hypothesis(replace(taxels, observed=tuple(observed)), ()).fit()
    square = np.mean(fitted.residual**2, axis=1)
    return np.bincount(taxels.recording, square) / np.bincount(taxels.recording)
