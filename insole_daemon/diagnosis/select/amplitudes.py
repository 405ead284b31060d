"""Amplitude of effects of the material in each triangle: real materials are not the same everywhere.

A law has one amplitude for all triangles of its place. Where the material's is larger, the rest of a strong memory or
of a strong change with temperature would otherwise be selected as further effects of single triangles.
"""

from __future__ import annotations

import numpy as np

from ..model.blocks import BlockDesign
from ..model.refine import refine
from ..model.solve import is_possible, solve_shares
from .count_errors import residual_with_companions

STD = 0.1  # prior standard deviation of an amplitude, relative
MOST = 0.3  # largest deviation of an amplitude from 1
LEAST_OF_REST = 0.3  # of what the effect leaves of a triangle beyond the noise: gain of an amplitude that is used
LEAST_EXPLAINED = 0.3  # of the squared residual, by an effect of the whole insole alone, for amplitudes to be fitted


def with_amplitudes(design: BlockDesign) -> BlockDesign:
    """Return the regression with amplitudes of the material in each triangle, fitted with the insole's best effect.

    Unchanged if no such effect of the whole insole explains much, or the load is not uniform.
    """
    if not design.seen.is_uniform:
        return design
    best, most = -1, LEAST_EXPLAINED * design.total
    for k, candidate in enumerate(design.candidates):
        if candidate.where.scope == "insole" and (candidate.term.is_of_material or candidate.word == "drift"):
            shares, gain = solve_shares(design, [candidate])
            if gain > most and is_possible([candidate], shares, design.load.is_known):
                best, most = k, gain
    # A drift may follow the temperature, too.
    if best < 0 or not design.candidates[best].term.is_of_material:
        return design
    alone = refine(design, (best,))
    effect = alone.design.contribution(alone.design.candidates[0], alone.shares[0])
    square = np.sum(effect * design.nuisance.residual_of(effect), axis=1)
    residual = residual_with_companions(alone)
    change = np.sum(effect * residual, axis=1) / (square + STD**-2.0)
    lack_of_fit = np.sum(residual**2, axis=1) - np.count_nonzero(design.weights, axis=0)
    # Where an amplitude explains little of the rest, another effect is at work, which would bias it.
    change[change**2 * square < LEAST_OF_REST * lack_of_fit] = 0.0
    boards = design.seen.layout.identities[:, 0]
    for board in np.unique(boards):  # what all triangles of a board have in common is an effect of the board
        change[boards == board] -= np.median(change[boards == board])
    return design.with_amplitudes(1.0 + np.clip(change, -MOST, MOST)) if change.any() else design
