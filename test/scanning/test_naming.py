"""Objects of a second scan keep their names: by their place, or, when they were lost, by their volume."""

import numpy as np

from poise.scanning import ScannedBody, names_of


def body(x: float, volume: float = 1e-4) -> ScannedBody:
    return ScannedBody(np.array([x, 0.0, 0.03]), volume)


def test_a_second_scan_of_a_table_gives_the_same_names_in_any_order() -> None:
    rng = np.random.default_rng(1)
    first = [body(0.1 * place) for place in range(5)]
    names = names_of(first, {}, "object")
    assert names == ["object", "object_2", "object_3", "object_4", "object_5"]
    known = dict(zip(names, first, strict=True))
    for _ in range(20):
        order = rng.permutation(5)
        off = [ScannedBody(first[row].centre + rng.normal(scale=1e-3, size=3), 1.05e-4) for row in order]
        assert names_of(off, known, "object") == [names[row] for row in order]


def test_what_was_lost_is_found_by_its_volume_and_the_new_gets_a_free_name() -> None:
    known = {"object": body(0.0), "object_2": ScannedBody(None, 2e-4)}
    found = [body(0.5, 5e-4), body(0.3, 2.1e-4), body(0.004)]
    assert names_of(found, known, "object", ["object_3"]) == ["object_4", "object_2", "object"]


def test_of_two_that_are_near_one_place_the_nearer_keeps_the_name() -> None:
    assert names_of([body(0.015), body(0.001)], {"cup": body(0.0)}, "cup") == ["cup_2", "cup"]
