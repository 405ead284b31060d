"""Fit a term in each triangle alone, to the residual of a set: where is its gain, and how large is it elsewhere?"""

from __future__ import annotations

import numpy as np

from ...physics.law import Array
from ..model.blocks import BlockDesign
from ..model.regression import PlacedTerm
from ..model.solve import RIDGE


def of_each_triangle(design: BlockDesign, term: PlacedTerm, cross: Array) -> tuple[Array, Array, Array]:
    """Return inner products (T, k), Gram matrices (T, k, k) and shares (T, k) of a term with k columns.

    `cross` (T, K): inner products of all atoms with a residual (`BlockDesign.residual_cross`). Each triangle is a
    regression of its own; its gain is the inner product of its rows of the first and of the third.
    """
    atoms = design.atom[term.columns]
    r, gram = cross[:, atoms], design.atoms.gram[:, atoms][:, :, atoms]
    diagonal = RIDGE * np.einsum("tkk->tk", gram) + 1e-12
    gram = gram + diagonal[..., None] * np.eye(len(atoms))
    return r, gram, np.linalg.solve(gram, r[..., None])[..., 0]
