"""The four regions of a sole: heel, midfoot, forefoot and toes, by the length of the sensed area.

Heel and midfoot end at 27 % and 55 % of the length from the heel, the masks customary in plantar pressure (hindfoot
73 to 100 % and midfoot 45 to 73 % from the toes; after Cavanagh & Rodgers 1987, J. Biomech. 20:547). Where the toes
begin differs between feet; 80 % is an approximation.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ..skin.geometry import PRESSURE_TAXELS
from ..skin.layout import Layout

Region = Literal["heel", "midfoot", "forefoot", "toes"]
REGIONS: tuple[Region, ...] = get_args(Region)
ENDS = (0.27, 0.55, 0.80)  # of the length, from the rearmost taxel to the foremost


def regions(layout: Layout) -> NDArray[np.int8]:
    """Return the number in REGIONS of every pressure taxel of `layout`, (n_triangles, 12); -1 on thermal pads."""
    x = layout.xy_m[..., 0]
    rear, front = x[:, PRESSURE_TAXELS].min(), x[:, PRESSURE_TAXELS].max()
    along = (x - rear) / (front - rear)
    number: NDArray[np.int8] = np.searchsorted(ENDS, along, side="right").astype(np.int8)
    number[:, ~PRESSURE_TAXELS] = -1
    return number
