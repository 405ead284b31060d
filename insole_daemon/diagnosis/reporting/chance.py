"""The null distribution: what a search finds where nothing is, with what was found here."""

from __future__ import annotations

import numpy as np

from ...report import page
from ...report.plot import Axis, Plot
from ..candidates import candidates
from ..diagnosing import Diagnosis
from ..evidence import Taxels, gather
from ..fit import Hypothesis
from ..nulls import Nulls, nulls
from .untouched import Untouched

_BINS = 24


def of(diagnosis: Diagnosis, seen: Untouched) -> Nulls:
    """Nulls of the recordings on the taxels of `seen`."""
    insole = diagnosis.insole
    admitted = {
        word: each for word, each in candidates(insole.excitation).items() if each.needs(insole.excitation) is None
    }
    if seen.named is not None:
        return nulls(seen.named.group.evidence, seen.named.naming.null.fitted, admitted)
    taxels = Taxels(diagnosis.observed, insole.slots, insole.noise_count)
    group = gather(taxels, diagnosis.located.taxels.jumps)
    return nulls(group.evidence, Hypothesis(group.evidence, ()).fit(), admitted)


def shown(found: Nulls, seen: Untouched) -> str:
    """The distribution, what was observed in it, and what that means."""
    gains, observed = 100 * found.gains, 100 * found.observed
    low, high = min(0.0, float(gains.min())), max(float(gains.max()), observed)
    edges = np.linspace(low, low + 1.05 * (float(gains.max()) - low) or 1.0, _BINS + 1)
    number, _ = np.histogram(gains, edges)
    top = float(number.max()) * 1.08
    figures = []
    for whole in (False, True):
        end = 1.08 * high if whole else float(edges[-1])
        if whole and observed < edges[-1]:
            break
        plot = Plot(
            Axis("held-out mean square that the best effect takes away, %", low, end), Axis("nulls", 0.0, top), 480, 220
        )
        for a, b, n in zip(edges[:-1], edges[1:], number.tolist(), strict=True):
            plot.band(np.array([a, b]), np.zeros(2), np.full(2, float(n)), 4)
        if low <= observed <= end:
            plot.line(np.full(2, observed), np.array([0.0, top]), 1, f"observed: {observed:.2f} % ({found.best})")
        caption = "The same, with what was observed." if whole else f"{len(gains)} recordings in which nothing is."
        figures.append(page.figure(plot.svg("null distribution"), caption))
    enough = np.sqrt(max(found.observed, 0.0)) * float(np.sqrt(np.mean(seen.before**2)))
    text = (
        f"{len(gains)} times the static model's own readings under this load, with noise as in this recording, were "
        f"searched for the best single effect. It takes away {np.median(gains):.2f} % of the held-out mean square in "
        f"the middle and {gains.max():.2f} % at the most; of what was recorded, {observed:.2f} % ({found.best}): "
        f"p ≤ {found.p_value:.3f}. "
    )
    if seen.named is None:
        text += (
            f"Be that chance or not, it moves the mean of all taxels by {enough:.3f} counts, which is not worth a word."
        )
    return page.paragraph(text) + page.row(*figures)
