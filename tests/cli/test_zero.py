"""What `insole zero` prints."""

from insole_daemon.cli.zero import _taxel_names


def test_taxels_are_named_by_triangle() -> None:
    assert _taxel_names([[5, 0, 1], [5, 0, 2], [6, 3, 0]]) == "board 5 triangle 0: 1, 2; board 6 triangle 3: 0"


def test_refusal_of_a_loaded_foot_is_one_line() -> None:
    taxels = [t for t in range(12) if t not in (6, 10)]
    whole = [[board, triangle, taxel] for board in (5, 6) for triangle in range(12) for taxel in taxels]
    assert _taxel_names(whole) == (
        "board 5 all of triangles 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11; "
        "board 6 all of triangles 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11"
    )
    scattered = [[board, triangle, 0] for board in (5, 6) for triangle in range(12)]
    assert _taxel_names(scattered).count("triangle ") == 12
    assert _taxel_names(scattered).endswith("; and taxels of 12 more triangles")
