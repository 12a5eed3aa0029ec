"""Sublayers, references, overs, variants and overrides: who wins, and what is inherited."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from phrt.description.overrides import parse_override
from phrt.errors import OptionError, PhrtWarning, SceneError
from phrt.loading import load_scene
from phrt.scene import Scene, SceneObject

Load = Callable[..., Scene]
Write = Callable[..., Path]

BALL = "prims:\n  Ball: {type: Sphere, radius: 2, tags: [base]}\n"


def the_object(scene: Scene, path: str) -> SceneObject:
    found = [entry for entry in scene.objects if entry.path == path]
    assert len(found) == 1, [entry.path for entry in scene.objects]
    return found[0]


def radius_of(scene: Scene, path: str) -> float:
    mesh = scene.meshes[the_object(scene, path).mesh]
    return float(np.linalg.norm(mesh.positions, axis=1).max())


def color_of(scene: Scene, path: str) -> tuple[float, ...]:
    mesh = scene.meshes[the_object(scene, path).mesh]
    assert len(set(mesh.triangle_material.tolist())) == 1
    return scene.materials[int(mesh.triangle_material[0])].base_color[:3]


def test_local_opinions_beat_sublayers_and_earlier_sublayers_beat_later_ones(write: Write) -> None:
    write("prims:\n  Ball: {type: Sphere, radius: 2, subdivision: 1}\n", "strong.yaml")
    write("prims:\n  Ball: {type: Sphere, radius: 5, subdivision: 2, tags: [weak]}\n", "weak.yaml")
    scene = load_scene(write("sublayers: [strong.yaml, weak.yaml]\nprims:\n  Ball: {tags: [local]}\n"))
    assert radius_of(scene, "/Ball") == pytest.approx(2)
    assert scene.triangle_count == 20 * 4
    assert the_object(scene, "/Ball").tags == ("local",)


def test_mappings_merge_key_by_key_and_lists_do_not(write: Write) -> None:
    write("prims:\n  Ball: {type: Sphere, xform: {translate: [1, 2, 3], scale: 2}}\n", "base.yaml")
    scene = load_scene(write("sublayers: [base.yaml]\nover:\n  Ball: {xform: {translate: [0, 0, 9]}}\n"))
    matrix = scene.nodes[the_object(scene, "/Ball").node].matrix
    assert np.allclose(matrix, [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 9], [0, 0, 0, 1]])


def test_a_prim_given_another_type_starts_anew(write: Write) -> None:
    write(BALL, "base.yaml")
    scene = load_scene(write("sublayers: [base.yaml]\nprims:\n  Ball: {type: Box}\n"))
    assert scene.triangle_count == 12


def test_children_and_paths_mean_the_same(load: Load) -> None:
    nested = load("prims:\n  A:\n    children:\n      B: {type: Sphere}\n")
    flat = load("prims:\n  /A/B: {type: Sphere}\n")
    assert [node.path for node in nested.nodes] == [node.path for node in flat.nodes]
    assert [node.path for node in flat.nodes[:2]] == ["/A", "/A/B"]
    assert flat.nodes[1].parent == 0


def test_json_is_read_too(write: Write) -> None:
    scene = load_scene(write('{\n\t"prims": {"Ball": {"type": "Sphere", "radius": 1e0}}\n}', "scene.json"))
    assert [entry.path for entry in scene.objects] == ["/Ball"]


def test_a_variant_wins_over_its_file_and_default_is_always_there(load: Load) -> None:
    text = BALL + "variants:\n  big:\n    over:\n      /Ball: {radius: 7}\n    prims:\n      Extra: {type: Box}\n"
    assert radius_of(load(text), "/Ball") == pytest.approx(2)
    assert radius_of(load(text, variant="default"), "/Ball") == pytest.approx(2)
    big = load(text, variant="big")
    assert (load(text).situation, big.situation) == ("default", "big")
    assert radius_of(big, "/Ball") == pytest.approx(7)
    assert len(big.objects) == 2
    assert radius_of(load(text, overrides=["variant=big"]), "/Ball") == pytest.approx(7)
    assert radius_of(load("variant: big\n" + text), "/Ball") == pytest.approx(7)


def test_a_variant_of_a_sublayer_can_be_selected_and_is_weaker_than_local_opinions(write: Write) -> None:
    write(BALL + "variants:\n  big:\n    over:\n      /Ball: {radius: 7, subdivision: 0}\n", "base.yaml")
    scene = load_scene(write("sublayers: [base.yaml]\nover:\n  /Ball: {subdivision: 1}\n"), variant="big")
    assert radius_of(scene, "/Ball") == pytest.approx(7)
    assert scene.triangle_count == 80


def test_a_referenced_description_is_placed_under_its_prim_with_its_own_paths(write: Write) -> None:
    write(
        "prims:\n  Red: {type: Material, base_color: [1, 0, 0]}\n  Ball: {type: Sphere, material: /Red}\n"
        "  Settings: {type: RenderSettings, fps: 12}\n",
        "ball.yaml",
    )
    scene = load_scene(
        write(
            "prims:\n  Left: {type: Reference, asset: ball.yaml, xform: {translate: [-1, 0, 0]}}\n"
            "  Right: {type: Reference, asset: ball.yaml}\n"
            "over:\n  /Right/Red: {base_color: [0, 1, 0]}\n  /Right/Ball: {tags: [mine]}\n"
        )
    )
    assert color_of(scene, "/Left/Ball") == (1, 0, 0)
    assert color_of(scene, "/Right/Ball") == (0, 1, 0)
    assert the_object(scene, "/Right/Ball").tags == ("mine",)
    assert scene.nodes[scene.nodes[the_object(scene, "/Left/Ball").node].parent].path == "/Left"
    assert scene.settings.fps == 30


def test_a_reference_selects_a_variant_of_what_it_names(write: Write) -> None:
    write(BALL + "variants:\n  big:\n    over:\n      /Ball: {radius: 7}\n", "ball.yaml")
    scene = load_scene(write("prims:\n  R: {type: Reference, asset: ball.yaml, variant: big}\n"))
    assert radius_of(scene, "/R/Ball") == pytest.approx(7)
    with pytest.raises(SceneError, match=r"scene.yaml:2: /R: the variant 'bib' is not one of: default, big"):
        load_scene(write("prims:\n  R: {type: Reference, asset: ball.yaml, variant: bib}\n"))


def test_opinions_are_inherited_and_the_nearest_wins(load: Load) -> None:
    scene = load(
        "prims:\n"
        "  Red: {type: Material, base_color: [1, 0, 0]}\n"
        "  Blue: {type: Material, base_color: [0, 0, 1]}\n"
        "  World:\n"
        "    material: /Red\n"
        "    importance: 2\n"
        "    effects: {shadows: never, reflections: always}\n"
        "    tags: [a]\n"
        "    casts_shadow: false\n"
        "    children:\n"
        "      Plain: {type: Sphere}\n"
        "      Own:\n"
        "        type: Sphere\n"
        "        material: /Blue\n"
        "        importance: {default: 1, night: 4}\n"
        "        effects: {shadows: auto}\n"
        "        tags: [b]\n"
        "        casts_shadow: true\n"
        "      Gone: {visible: false, children: {Hidden: {type: Sphere}}}\n"
    )
    plain, own = the_object(scene, "/World/Plain"), the_object(scene, "/World/Own")
    assert len(scene.objects) == 2
    assert color_of(scene, plain.path) == (1, 0, 0)
    assert color_of(scene, own.path) == (0, 0, 1)
    assert plain.importance == {"default": 2.0}
    assert own.importance == {"default": 1.0, "night": 4.0}
    assert plain.effects == {"shadows": "never", "reflections": "always"}
    assert own.effects == {"shadows": "auto", "reflections": "always"}
    assert (plain.tags, own.tags) == (("a",), ("a", "b"))
    assert (plain.casts_shadow, own.casts_shadow) == (False, True)


def test_equal_shapes_with_equal_materials_share_a_mesh(load: Load) -> None:
    scene = load("prims:\n  A: {type: Sphere}\n  B: {type: Sphere}\n  C: {type: Sphere, radius: 3}\n")
    assert len(scene.meshes) == 2
    assert the_object(scene, "/A").mesh == the_object(scene, "/B").mesh


def test_materials_inherit_what_they_do_not_give(load: Load) -> None:
    scene = load(
        "prims:\n  B: {type: Material, inherits: /A, roughness: 0.2}\n"
        "  A: {type: Material, base_color: [1, 0, 0], roughness: 0.9, metallic: 1}\n"
    )
    heir = next(material for material in scene.materials if material.name == "/B")
    assert (heir.base_color[:3], heir.roughness, heir.metallic) == ((1, 0, 0), 0.2, 1)


def test_overrides_are_the_strongest(load: Load) -> None:
    scene = load(
        BALL + "  Lamp: {type: SphereLight, intensity: 1}\n",
        overrides={"/Lamp.intensity": 30, "Ball.xform.translate": (1, 2, 3), "effects.shadows.samples": 4, "fps": 12},
    )
    assert scene.lights[0].light.intensity == 30
    assert scene.nodes[the_object(scene, "/Ball").node].matrix[:3, 3].tolist() == [1, 2, 3]
    assert scene.settings.effects == {"shadows": {"samples": 4}}
    assert scene.settings.fps == 12


def test_overrides_reach_the_render_settings_that_are_there(load: Load) -> None:
    scene = load("prims:\n  My: {type: RenderSettings, frames: 9}\n", overrides=["size=[64, 32]"])
    assert (scene.settings.size, scene.settings.frames) == ((64, 32), 9)


@pytest.mark.parametrize(
    ("override", "told"),
    [
        ("/Bell.radius=3", "override /Bell.radius: /Bell: over: there is no such prim. Did you mean '/Ball'?"),
        ("/Ball.radios=3", "override /Ball.radios: /Ball: unknown key 'radios'"),
        ("/Ball.radius=big", "override /Ball.radius: /Ball: radius: given 'big'; wanted a number"),
        (
            "siz=3",
            "'siz' is neither a prim nor a render setting; a prim's path begins with '/'. Did you mean 'size'?",
        ),
        (
            "Lamp.intensity=3",
            "'Lamp' is neither a prim nor a render setting; a prim's path begins with '/'. Did you mean '/Ball/Lamp'?",
        ),
        ("variant=nigt", "the variant 'nigt' is not one of: default"),
    ],
)
def test_wrong_overrides_are_named(load: Load, override: str, told: str) -> None:
    with pytest.raises(SceneError) as caught:
        load(BALL + "  Ball/Lamp: {type: SphereLight}\n", overrides=[override])
    assert told in str(caught.value)


def test_overrides_are_read_as_yaml() -> None:
    assert parse_override("/World/Lamp.intensity=3") == ("/World/Lamp.intensity", 3)
    assert parse_override("World/Lamp.color = [1, .5, 0]") == ("World/Lamp.color", [1, 0.5, 0])
    assert parse_override("/A.xform={translate: [1, 2, 3]}") == ("/A.xform", {"translate": [1, 2, 3]})
    assert parse_override("a.b=c=d") == ("a.b", "c=d")


@pytest.mark.parametrize("text", ["", "/A.b", "=3", "/A.b=", "/World/Lamp=3", "/A.b=[1"])
def test_malformed_overrides_are_option_errors(text: str) -> None:
    with pytest.raises(OptionError, match="override"):
        parse_override(text)


TWO = """\
mtllib two.mtl
o left
v 0 0 0
v 1 0 0
v 0 1 0
usemtl red
f 1 2 3
o right
v 5 0 0
v 6 0 0
v 5 1 0
usemtl blue
f 4 5 6
"""
MTL = "newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n"


@pytest.fixture
def two(write: Write) -> Path:
    write(MTL, "two.mtl")
    return write(TWO, "two.obj")


def test_a_models_objects_lie_below_the_reference_and_can_be_overridden_by_path(write: Write, two: Path) -> None:
    plain = load_scene(write("prims:\n  R: {type: Reference, asset: two.obj}\n"))
    paths = [entry.path for entry in plain.objects]
    assert len(paths) == 2
    left, right = paths
    assert left.startswith("/R/")
    scene = load_scene(
        write(
            "prims:\n  Green: {type: Material, base_color: [0, 1, 0]}\n"
            "  R: {type: Reference, asset: two.obj, tags: [all]}\n"
            f"over:\n  {left}: {{material: /Green, effects: {{shadows: never}}, tags: [left]}}\n"
            f"  {right}: {{visible: false}}\n"
        )
    )
    assert [entry.path for entry in scene.objects] == [left]
    assert color_of(scene, left) == (0, 1, 0)
    assert the_object(scene, left).effects == {"shadows": "never"}
    assert the_object(scene, left).tags == ("all", "left")


def test_a_models_materials_can_be_changed_one_by_one_or_all_together(write: Write, two: Path) -> None:
    scene = load_scene(
        write(
            "prims:\n"
            "  A: {type: Reference, asset: two.obj}\n"
            "  B: {type: Reference, asset: two.obj, all_materials: {metallic: 1.0}}\n"
            "over:\n  /B/Materials/red: {base_color: [0, 1, 0]}\n"
        )
    )
    by_path = {entry.path: entry for entry in scene.objects}
    colors = {path: color_of(scene, path) for path in by_path}
    assert [colors[path] for path in by_path if path.startswith("/A/")] == [(1, 0, 0), (0, 0, 1)]
    assert [colors[path] for path in by_path if path.startswith("/B/")] == [(0, 1, 0), (0, 0, 1)]
    metals = {path: scene.materials[scene.meshes[e.mesh].triangle_material[0]].metallic for path, e in by_path.items()}
    assert {path[:3]: metal for path, metal in metals.items()} == {"/A/": 0.0, "/B/": 1.0}


def test_a_model_referenced_twice_is_read_once_and_shared(write: Write, two: Path) -> None:
    scene = load_scene(
        write("prims:\n  A: {type: Reference, asset: two.obj}\n  B: {type: Reference, asset: ./two.obj}\n")
    )
    assert len(scene.objects) == 4
    assert len(scene.meshes) == 2
    assert len(scene.materials) == len({material.name for material in scene.materials})


def test_a_binding_to_a_models_material_works(write: Write, two: Path) -> None:
    scene = load_scene(
        write(
            "prims:\n  R: {type: Reference, asset: two.obj}\n  Ball: {type: Sphere, material: /R/Materials/blue}\n"
            "  Dark: {type: Material, inherits: /R/Materials/blue, metallic: 1}\n"
        )
    )
    assert color_of(scene, "/Ball") == (0, 0, 1)
    with pytest.raises(SceneError, match=r"there is no /R/Materials/blu; allowed: .*Did you mean '/R/Materials/blue'"):
        load_scene(
            write("prims:\n  R: {type: Reference, asset: two.obj}\n  B: {type: Box, material: /R/Materials/blu}\n")
        )


def test_an_over_that_meets_nothing_in_a_model_is_an_error(write: Write, two: Path) -> None:
    path = write("prims:\n  R: {type: Reference, asset: two.obj}\nover:\n  /R/Materials/rod: {metallic: 1}\n")
    with pytest.raises(SceneError, match=r"scene.yaml:4: .*no such prim in the referenced model. Did you mean"):
        load_scene(path)


def test_a_mesh_with_an_asset_is_one_object_with_the_models_materials(write: Write, two: Path) -> None:
    scene = load_scene(write("prims:\n  M: {type: Mesh, asset: two.obj}\n"))
    assert [entry.path for entry in scene.objects] == ["/M"]
    mesh = scene.meshes[0]
    assert len(mesh.triangles) == 2
    colors = [scene.materials[index].base_color[:3] for index in mesh.triangle_material]
    assert colors == [(1, 0, 0), (0, 0, 1)]


def test_a_split_mesh_becomes_objects_below_it(write: Write, two: Path) -> None:
    scene = load_scene(write("prims:\n  M: {type: Mesh, asset: two.obj, split: material}\n"))
    assert len(scene.objects) == 2
    assert all(entry.path.startswith("/M/") for entry in scene.objects)
    whole = load_scene(write("prims:\n  M: {type: Mesh, asset: two.obj, split: {by: material, min_triangles: 3}}\n"))
    assert [entry.path for entry in whole.objects] == ["/M"]


@pytest.mark.parametrize("name", ["spheres", "cornell", "furnace", "atrium"])
def test_the_shipped_scenes_load(name: str) -> None:
    scene = load_scene(Path(__file__).resolve().parents[3] / "scenes" / f"{name}.yaml")
    assert scene.objects
    assert scene.cameras
    assert scene.lights or any(scene.dome.color)


@pytest.mark.parametrize("variant", ["default", "hard", "rich"])
def test_the_reference_scene_is_what_it_says(assets: Path, variant: str) -> None:
    path = Path(__file__).resolve().parents[3] / "scenes" / "sponza_armadillo.yaml"
    with pytest.warns(PhrtWarning, match="normals of length zero"):
        scene = load_scene(path, search=[assets], variant=variant)
    spheres = [entry for entry in scene.objects if "sphere" in entry.tags]
    assert 50 <= len(scene.objects) <= 70
    assert [sum(kind in entry.path for entry in spheres) for kind in ("Mirror", "Glass")] == [6, 6]
    assert scene.triangle_count == 66_454 + 99_994 + 12 * 5120
    assert len(scene.lights) == 3
    assert scene.settings.frames == 300
    assert scene.duration == pytest.approx(10)
    floor = the_object(scene, "/World/Sponza/sp_00_pod")
    roughness = scene.materials[scene.meshes[floor.mesh].triangle_material[0]].roughness
    assert roughness == pytest.approx(0.18 if variant == "rich" else 0.9)
