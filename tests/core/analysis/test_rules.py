"""Rules of the analysis, on numbers that can be worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scene_kit import GLASS, LAMBERT, MIRROR, Stage, at, ball, quad

from phrt.analysis.rules import (
    EVIDENCE_PIXELS,
    INVISIBLE_MEAN,
    INVISIBLE_PEAK,
    KIND_FACTORS,
    LARGEST_FACTOR,
    LEAST_FACTOR,
    LEAST_PIXELS,
    LEAST_PROBES,
    changes_nothing,
    factors,
    kinds_of,
    measured_factors,
    rule_factors,
)
from phrt.model import Material
from phrt.scene import Scene, SceneObject
from phrt.world import World

NAN = float("nan")


@pytest.mark.parametrize(
    ("material", "kind"),
    [
        (MIRROR, "mirror"),
        (replace(MIRROR, roughness=0.2), "glossy"),
        (replace(MIRROR, roughness=0.8), "rough"),
        (GLASS, "glass"),
        (replace(GLASS, roughness=0.3), "glass"),
        (LAMBERT, "rough"),
        (replace(LAMBERT, roughness=0.2), "glossy"),
        (Material("sign", unlit=True, roughness=0.0), "unlit"),
    ],
)
def test_a_kind_is_told_from_the_material(material: Material, kind: str) -> None:
    world = World(Stage().add("/it", ball(0.5, 1), material).scene)
    assert kinds_of(world)[1] == kind
    assert kind in KIND_FACTORS


def test_of_several_materials_the_most_telling_one_names_the_kind() -> None:
    made = Stage().add("/vase", ball(0.5, 1), LAMBERT).add("/other", quad(), MIRROR)
    made.scene.meshes[0].triangle_material[:3] = 1
    assert kinds_of(World(made.scene)) == ["unlit", "mirror", "mirror"]


def test_small_objects_count_half_by_rule() -> None:
    made = (
        Stage().add("/floor", quad(100, 100)).add("/marble", ball(0.01, 1), MIRROR).add("/globe", ball(1.0, 1), MIRROR)
    )
    world = World(made.scene)
    assert rule_factors(world, kinds_of(world))[1:].tolist() == [1.0, 1.0, 2.0]


def test_a_measured_factor_is_the_root_of_the_change_per_pixel_over_that_of_the_picture() -> None:
    # 100 pixels change by 0.4, 300 by 0.1, none of the rest; the mean over 400 is 0.175.
    found = measured_factors(np.array([9.0, 40.0, 30.0, 0.0, 0.0]), np.array([0.0, 100.0, 300.0, 0.0, 0.0]))
    np.testing.assert_allclose(found[1:3], np.sqrt([0.4 / 0.175, 0.1 / 0.175]))
    assert np.isnan(found[[0, 3, 4]]).all(), "what was not seen was not measured, the background included"


def test_a_measured_factor_has_bounds() -> None:
    found = measured_factors(np.array([0.0, 1000.0, 0.0]), np.array([0.0, 1.0, 1e6]))
    assert found[1:].tolist() == [LARGEST_FACTOR, LEAST_FACTOR]


def test_where_nothing_changes_anything_all_are_alike() -> None:
    assert measured_factors(np.zeros(3), np.array([0.0, 10.0, 20.0]))[1:].tolist() == [1.0, 1.0]
    assert np.isnan(measured_factors(np.zeros(3), np.zeros(3))).all()


def objects(*tags: tuple[str, ...]) -> Scene:
    return Scene("s", objects=[SceneObject(f"/{k}", 0, 0, tags=own) for k, own in enumerate(tags)])


def test_little_evidence_counts_little() -> None:
    scene, rule = objects((), ()), np.array([1.0, 1.0, 1.0])
    kinds = ["rough", "mirror", "glass"]
    pixels = np.array([0.0, EVIDENCE_PIXELS, 3 * EVIDENCE_PIXELS])
    found = factors(np.array([NAN, 3.0, 2.0]), pixels, rule, kinds, scene)
    # What is expected of them is what was measured, as each is alone of its kind.
    np.testing.assert_allclose(found, [1.0, 3.0, 2.0])
    same = factors(np.array([NAN, 3.0, 2.0]), pixels, rule, ["rough", "mirror", "mirror"], scene)
    np.testing.assert_allclose(same[1:], [(3 + 2.5) / 2, 0.75 * 2 + 0.25 * 2.5])


def test_what_no_probe_shows_is_taken_as_what_is_like_it() -> None:
    scene = objects(("gold",), ("iron",), ("gold", "coin"), ("tin",), ())
    kinds = ["rough", "mirror", "mirror", "mirror", "mirror", "glass"]
    measured = np.array([NAN, 3.0, 1.0, NAN, NAN, NAN])
    rule = np.array([1.0, 2.0, 2.0, 2.0, 2.0, 1.5])
    pixels = np.array([0.0, 1e9, 1e9, 0.0, 0.0, 0.0])
    found = factors(measured, pixels, rule, kinds, scene)
    assert found[3] == 3.0, "a tag and the kind in common"
    assert found[4] == 2.0, "the kind in common: the mean of both"
    assert found[5] == 1.5, "nothing in common: the rule"


def one(
    seen: int = LEAST_PROBES, pixels: float = LEAST_PIXELS, mean: float = 0.0, peak: float = 0.0, marked: float = 0.0
) -> bool:
    column = np.array([[0.0], [1.0]])
    found = changes_nothing(
        np.array([0, seen]), column * pixels, column * mean * pixels, column * peak, column * marked
    )
    assert not found[0, 0]
    return bool(found[1, 0])


def test_an_effect_is_ruled_out_only_where_enough_was_seen_and_nothing_changed() -> None:
    assert one()
    assert one(mean=INVISIBLE_MEAN * 0.99, peak=INVISIBLE_PEAK * 0.99)
    assert not one(mean=INVISIBLE_MEAN * 1.01)
    assert not one(peak=INVISIBLE_PEAK * 1.01), "one pixel that changes is enough"
    assert not one(marked=1.0), "nor what a fallback shows as well"
    assert not one(seen=LEAST_PROBES - 1)
    assert not one(pixels=LEAST_PIXELS - 1)
    assert not one(pixels=0.0)


def test_places_of_objects_do_not_matter_to_kinds() -> None:
    made = Stage().add("/far", ball(0.5, 1), GLASS, at(1e6, 0, 0)).add("/near", quad(), LAMBERT)
    assert kinds_of(World(made.scene))[1:] == ["glass", "rough"]
