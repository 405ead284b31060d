"""Regions from a file."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.errors import DocumentError
from insole_daemon.mechanics.region_map import load_regions, map_regions
from insole_daemon.skin import layout as layouts
from insole_daemon.skin.geometry import PRESSURE_TAXELS

LEFT, RIGHT = layouts.builtin("left", (5, 6, 7)), layouts.builtin("right", (8, 9, 10))


def test_the_builtin_regions_share_the_whole_sole():
    for layout in (LEFT, RIGHT):
        regions = map_regions(load_regions(), layout)
        assert regions.names == (
            "heel", "midfoot", *(f"metatarsal_{number}" for number in range(1, 6)), "hallux", "toes",
        )  # fmt: skip
        assert not regions.too_small
        assert ((regions.of_taxel >= 0) == PRESSURE_TAXELS).all()


def test_the_first_metatarsal_and_the_hallux_are_medial_on_both_feet():
    for layout, medial in ((LEFT, -1.0), (RIGHT, 1.0)):
        regions = map_regions(load_regions(), layout)
        y = medial * layout.xy_m[..., 1]
        for inner, outer in (("metatarsal_1", "metatarsal_5"), ("hallux", "toes")):
            mean = [y[regions.of_taxel == regions.names.index(name)].mean() for name in (inner, outer)]
            assert mean[0] > mean[1]


def region(name, begin, end):
    return f"  - {{name: {name}, along: [{begin}, {end}], across: [0, 1]}}"


def write(tmp_path, *lines):
    path = tmp_path / "regions.yaml"
    path.write_text("\n".join(["format: insole-regions/1", "regions:", *lines]) + "\n")
    return path


def test_a_region_with_too_few_taxels_is_listed(tmp_path):
    path = write(
        tmp_path,
        "  - {name: all, along: [0.0, 0.999], across: [0, 1]}",
        "  - {name: tip, along: [0.999, 1.0], across: [0, 1]}",
    )
    regions = map_regions(load_regions(path), LEFT)
    assert regions.too_small == ("tip",)
    assert not np.any(regions.of_taxel == 1)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([region("a", 0.0, 0.6), region("b", 0.5, 1.0)], "both a and b"),
        ([region("a", 0.0, 1.6)], "along.*0 to 1"),
        ([region("a", 0.6, 0.2)], "the first less"),
        ([region("a", 0.0, 0.2), region("a", 0.5, 1.0)], "once"),
        ([region("A b", 0.0, 0.2)], "name"),
    ],
)
def test_regions_that_cannot_be_are_refused(tmp_path, lines, words):
    with pytest.raises(DocumentError, match=words):
        map_regions(load_regions(write(tmp_path, *lines)), LEFT)
