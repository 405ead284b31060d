"""The benchmark's own insole: 28 triangles on a lattice of equilateral cells, eight rows from heel to toe."""

from dataclasses import dataclass

import numpy as np

CELL_MM = 33.46  # side of a tiling cell; neighbouring centres are CELL / sqrt(3) apart
AREA_MM2 = 32.4
PADS = (6, 10)
PRESSURE_TAXELS = tuple(k for k in range(12) if k not in PADS)

# Taxel k in its triangle's frame, mm, as published with the taxel maps of the skin.
_TAXEL_MM = np.array(
    [
        (6.533, 0.0),
        (9.8, -5.66),
        (3.267, -5.66),
        (0.0, 0.0),
        (-3.267, -5.66),
        (-9.8, -5.66),
        (-6.51, -3.75),
        (-6.533, 0.0),
        (-3.267, 5.66),
        (0.0, 11.317),
        (0.0, 7.532),
        (3.267, 5.66),
    ]
)
# Triangles in a row, the row's middle (y, mm) on a left foot, and the board it belongs to (0 front, 1 middle, 2 rear).
_ROWS = [
    (3, 0.0, 2),
    (4, 0.0, 2),
    (4, 1.5, 2),
    (2, 6.0, 1),
    (3, 6.0, 1),
    (4, 2.0, 0),
    (4, -2.0, 0),
    (4, -5.0, 0),
]
_PATCHES = ("front", "middle", "rear")
_SLOTS = ((0, 1, 2, 3, 5, 8, 9, 11, 12, 13, 14, 15), (4, 5, 6, 7, 15), (0, 2, 3, 4, 6, 7, 9, 10, 12, 13, 14))


@dataclass(frozen=True)
class Geometry:
    """Positions and addresses of the triangles, in the order of the layout file."""

    foot: str
    address: np.ndarray  # (28,) of the board
    slot: np.ndarray  # (28,) triangle number on its board
    board: np.ndarray  # (28,) 0 front, 1 middle, 2 rear
    centre_mm: np.ndarray  # (28, 2)
    rotation_deg: np.ndarray  # (28,)
    taxel_mm: np.ndarray  # (28, 12, 2)

    @property
    def addresses(self) -> list[int]:
        """Addresses of the three boards, ascending."""
        return sorted({int(a) for a in self.address})

    def document(self) -> str:
        """Text of the file `layout.yaml`, format `insole-layout/1`."""
        rows = [
            f"  - {{board: {self.address[i]}, triangle: {self.slot[i]}, patch: {_PATCHES[self.board[i]]}, "
            f"x_mm: {self.centre_mm[i, 0]:.2f}, y_mm: {self.centre_mm[i, 1]:.2f}, "
            f"rotation_deg: {self.rotation_deg[i]:.1f}, mirrored: false}}"
            for i in range(len(self.slot))
        ]
        head = ["format: insole-layout/1", f"foot: {self.foot}", f"taxel_area_mm2: {AREA_MM2}", "triangles:"]
        return "\n".join(head + rows) + "\n"


def build_insole(foot: str, first_address: int) -> Geometry:
    """Build an insole of `foot`; its front board has `first_address`, the others have the next two addresses."""
    side = 1.0 if foot == "left" else -1.0
    height = CELL_MM * np.sqrt(3) / 2
    triangles = []
    for row, (n, middle_y, board) in enumerate(_ROWS):
        for k in range(n):
            points_to_toe = (k + row) % 2 == 0
            x = row * height + height * (1 / 3 if points_to_toe else 2 / 3) + 8.0
            y = side * (middle_y + (k - (n - 1) / 2) * CELL_MM / 2)
            triangles.append((board, x, y, -90.0 if points_to_toe else 90.0))
    triangles.sort(key=lambda triangle: (triangle[0], triangle[1], triangle[2]))
    board = np.array([triangle[0] for triangle in triangles])
    slot = np.concatenate([_SLOTS[b] for b in range(3)])
    centre_mm = np.array([(triangle[1], triangle[2]) for triangle in triangles])
    rotation_deg = np.array([triangle[3] for triangle in triangles])
    angle = np.radians(rotation_deg)
    matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]).transpose(2, 0, 1)
    taxel_mm = centre_mm[:, None, :] + np.einsum("tij,kj->tki", matrix, _TAXEL_MM)
    return Geometry(foot, first_address + board, slot, board, centre_mm, rotation_deg, taxel_mm)
