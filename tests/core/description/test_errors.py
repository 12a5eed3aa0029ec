"""Every way a scene file can be wrong, and what the user is told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from phrt.errors import AssetError, OptionError, PhrtWarning, SceneError
from phrt.loading import load_scene

ErrorOf = Callable[..., str]
Write = Callable[..., Path]


def test_an_unknown_key_names_file_line_prim_allowed_keys_and_the_nearest_one(error_of: ErrorOf) -> None:
    message = error_of("prims:\n  Lamp:\n    type: SphereLight\n    intensty: 3\n")
    assert message.startswith("scene.yaml:4: /Lamp: unknown key 'intensty'; allowed: ")
    assert "intensity, radius, range" in message
    assert message.endswith("Did you mean 'intensity'?")


def test_an_unknown_key_in_a_nested_mapping_names_that_mapping(error_of: ErrorOf) -> None:
    message = error_of("prims:\n  Ball:\n    type: Sphere\n    xform:\n      translat: [0, 0, 0]\n")
    assert message.startswith("scene.yaml:5: /Ball: unknown key 'translat' in 'xform'; allowed: translate, rotate")
    assert "Did you mean 'translate'?" in message


def test_an_unknown_section_is_an_error(error_of: ErrorOf) -> None:
    assert "unknown key 'prim' in the scene" in error_of("prim: {}\n")


def test_an_unknown_type_lists_the_types(error_of: ErrorOf) -> None:
    message = error_of("prims:\n  Ball: {type: Spher}\n")
    assert message.startswith("scene.yaml:2: /Ball: type: given 'Spher'; allowed: Xform, Mesh, Sphere, ")
    assert message.endswith("Did you mean 'Sphere'?")


def test_an_unknown_enum_value_lists_the_values(error_of: ErrorOf) -> None:
    message = error_of("prims:\n  Ball:\n    type: Sphere\n    effects:\n      shadows: alway\n")
    assert message == (
        "scene.yaml:5: /Ball: effects.shadows: given 'alway'; allowed: auto, always, never. Did you mean 'always'?"
    )


@pytest.mark.parametrize(
    ("attribute", "told"),
    [
        ("radius: big", "radius: given 'big'; wanted a number"),
        ("radius: -1", "radius: given -1; input should be greater than 0"),
        ("radius: .nan", "radius: given nan; "),
        ("radius: 1e30", "radius: given 1e+30; at most 1e+18 in size"),
        ("subdivision: 2.5", "subdivision: given 2.5; wanted a whole number"),
        ("subdivision: 9", "subdivision: given 9; input should be less than or equal to 7"),
        ("visible: 1", "visible: given 1; wanted true or false"),
        ("visible: yes", "visible: given 'yes'; wanted true or false"),
        ("tags: sphere", "tags: given 'sphere'; wanted a list"),
        ("xform: {translate: [1, 2]}", "'xform.translate' has too few entries: entry 2 is missing"),
        ("xform: {rotate: [0, 0, 0], quaternion: [0, 0, 0, 1]}", "rotate and quaternion exclude each other"),
        ("xform: {scale: 2, matrix: [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}", "matrix excludes scale"),
        ("material: Red", "material: a prim path starts with '/'"),
        ("importance: {night: -1}", "importance.night: given -1; input should be greater than or equal to 0"),
    ],
)
def test_a_wrong_value_says_what_was_given_and_what_is_wanted(error_of: ErrorOf, attribute: str, told: str) -> None:
    message = error_of(f"prims:\n  Ball:\n    type: Sphere\n    {attribute}\n")
    assert message.startswith("scene.yaml:4: /Ball: ")
    assert told in message


@pytest.mark.parametrize(
    ("prim", "told"),
    [
        ("{type: Mesh}", "give either asset, or points and faces"),
        ("{type: Mesh, points: [[0,0,0]], faces: [[0,0,1]]}", "faces[0] names point 1; the last one is 0"),
        ("{type: Mesh, points: [[0,0,0]], faces: [[0,0]]}", "faces[0] has 2 corners; a face needs at least 3"),
        ("{type: Mesh, points: [[0,0,0]], faces: [[0,0,0]], uv: []}", "uv needs one entry per point"),
        ("{type: Mesh, asset: a.obj, split: {by: gird}}", "split.by: given 'gird'; allowed: none, material"),
        ("{type: Mesh, asset: a.obj, split: {by: material, size: 1}}", "cells and size belong to `by: grid`"),
        ("{type: Reference}", "give asset (a file), or loader (a procedural model)"),
        ("{type: Camera, near: 5, far: 2}", "far (2) must be larger than near (5)"),
        ("{type: Camera, fov: 180}", "fov: given 180; input should be less than 180"),
        ("{type: Camera, path: {keys: []}}", "path.keys: given []; "),
        ("{type: Camera, path: {keys: [{time: 0, eye: [0,0,1]}]}}", "a key needs eye and target"),
        (
            "{type: Camera, path: {keys: [{time: 1, eye: [0,0,1], target: [0,0,0]}, {time: 1, eye: [0,0,2], "
            "target: [0,0,0]}]}}",
            "keys must be at rising times; 1 follows 1",
        ),
        ("{type: SphereLight, cone: {inner: 50, outer: 20}}", "inner (50) must be smaller than outer (20)"),
        ("{type: Material, base_color_texture: {}}", "give either asset or checker"),
        ("{type: RenderSettings, size: [0, 10]}", "size[0]: given 0; input should be greater than or equal to 1"),
    ],
)
def test_prims_that_contradict_themselves_are_refused(error_of: ErrorOf, prim: str, told: str) -> None:
    assert told in error_of(f"prims:\n  Prim: {prim}\n")


def test_all_problems_are_reported_at_once_in_the_order_of_the_file(error_of: ErrorOf) -> None:
    message = error_of(
        "prims:\n  A: {type: Sphere, radius: x}\n  B: {type: Cone}\n  C: {type: Plane, material: /Gone}\n"
    )
    lines = message.splitlines()
    assert lines[0] == "3 problems in the scene:"
    assert [line.split(":")[1] for line in lines[1:]] == ["2", "3", "4"]


def test_a_dangling_material_names_the_nearest(error_of: ErrorOf) -> None:
    message = error_of("prims:\n  Red: {type: Material}\n  Ball: {type: Sphere, material: /Rad}\n")
    assert message == "scene.yaml:3: /Ball: material: there is no /Rad; allowed: /Red. Did you mean '/Red'?"


def test_a_material_binding_to_another_prim_is_an_error(error_of: ErrorOf) -> None:
    message = error_of("prims:\n  Red: {type: Material}\n  Ball: {type: Sphere, material: /Ball}\n")
    assert "/Ball is not a Material prim; allowed: /Red" in message


def test_a_dangling_camera_is_an_error(error_of: ErrorOf) -> None:
    message = error_of("prims:\n  Eye: {type: Camera}\n  Settings: {type: RenderSettings, camera: /Eyes}\n")
    assert message == "scene.yaml:3: /Settings: camera: there is no camera /Eyes; allowed: /Eye. Did you mean '/Eye'?"


def test_a_dangling_over_is_an_error(error_of: ErrorOf) -> None:
    message = error_of("prims:\n  Ball: {type: Sphere}\nover:\n  /Bell: {visible: false}\n")
    assert message == "scene.yaml:4: /Bell: over: there is no such prim. Did you mean '/Ball'?"


def test_materials_that_inherit_in_a_circle_are_an_error(error_of: ErrorOf) -> None:
    message = error_of("prims:\n  A: {type: Material, inherits: /B}\n  B: {type: Material, inherits: /A}\n")
    assert "inherits: a cycle: /A -> /B -> /A" in message
    assert "there is no material /C" in error_of("prims:\n  A: {type: Material, inherits: /C}\n")


def test_a_sublayer_cycle_is_an_error(write: Write) -> None:
    write("sublayers: [scene.yaml]\n", "other.yaml")
    path = write("sublayers: [other.yaml]\n")
    with pytest.raises(SceneError, match=r"the sublayers form a cycle: scene.yaml -> other.yaml -> scene.yaml"):
        load_scene(path)


def test_a_reference_cycle_is_an_error(write: Write) -> None:
    write("prims:\n  Back: {type: Reference, asset: scene.yaml}\n", "other.yaml")
    path = write("prims:\n  There: {type: Reference, asset: other.yaml}\n")
    with pytest.raises(SceneError, match=r"the references form a cycle: scene.yaml -> other.yaml -> scene.yaml"):
        load_scene(path)


def test_a_scene_that_is_its_own_sublayer_through_a_longer_name_is_a_cycle(write: Write, tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    path = write("sublayers: [sub/../scene.yaml]\n")
    with pytest.raises(SceneError, match="form a cycle"):
        load_scene(path)


def test_references_that_multiply_without_end_are_stopped(write: Write) -> None:
    many = "".join(f"  R{k}: {{type: Reference, asset: level%d.yaml}}\n" for k in range(40))
    for level in range(5):
        write("prims:\n" + many.replace("%d", str(level + 1)), f"level{level}.yaml")
    write("prims:\n  Ball: {type: Sphere}\n", "level5.yaml")
    with pytest.raises(SceneError, match="more than"):
        load_scene(write("prims:\n  R: {type: Reference, asset: level0.yaml}\n"))


@pytest.mark.parametrize("asset", ["../secret.yaml", "/etc/hostname.yaml", "sub/../../secret.yaml"])
def test_an_asset_outside_the_roots_is_refused_by_name(tmp_path: Path, asset: str) -> None:
    (tmp_path / "secret.yaml").write_text("prims: {}\n")
    inside = tmp_path / "inside"
    (inside / "sub").mkdir(parents=True)
    path = inside / "scene.yaml"
    path.write_text(f"prims:\n  There: {{type: Reference, asset: {asset}}}\n")
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    message = str(caught.value)
    assert f"'{asset}' leaves the asset roots" in message
    assert str(inside) in message


@pytest.mark.parametrize("asset", ["../secret.obj", "link.obj"])
def test_models_and_symlinks_outside_the_roots_are_refused(tmp_path: Path, asset: str) -> None:
    (tmp_path / "secret.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "link.obj").symlink_to(tmp_path / "secret.obj")
    (inside / "scene.yaml").write_text(f"prims:\n  There: {{type: Mesh, asset: {asset}}}\n")
    with pytest.raises(SceneError, match="leaves the asset roots; files must lie inside one of"):
        load_scene(inside / "scene.yaml")


def test_two_dots_inside_the_roots_are_fine(write: Write, tmp_path: Path) -> None:
    write("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "models/triangle.obj")
    write("prims:\n  There: {type: Mesh, asset: ../models/triangle.obj}\n", "parts/part.yaml")
    scene = load_scene(write("prims:\n  Part: {type: Reference, asset: parts/part.yaml}\n"))
    assert [entry.path for entry in scene.objects] == ["/Part/There"]


def test_assets_are_found_in_the_named_folders(write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "library/triangle.obj")
    path = write("prims:\n  There: {type: Mesh, asset: triangle.obj}\n", "scenes/scene.yaml")
    with pytest.raises(SceneError, match=r"'triangle.obj' was not found; looked in: .*PHRT_ASSETS"):
        load_scene(path)
    assert len(load_scene(path, search=[tmp_path / "library"]).objects) == 1
    monkeypatch.setenv("PHRT_ASSETS", f"{tmp_path / 'nowhere'}:{tmp_path / 'library'}")
    assert len(load_scene(path).objects) == 1


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "scene.yaml: the file is empty"),
        ("# nothing\n", "scene.yaml: the file is empty"),
        ("- a\n- b\n", "scene.yaml:1: a scene is a mapping with phrt, name, "),
        ("prims: {A: {type: Sphere}\n", "scene.yaml:2: not valid YAML"),
        ("prims:\n\tA: 1\n", "scene.yaml:2: not valid YAML"),
        (
            "prims:\n  A: {type: Sphere}\n  A: {type: Box}\n",
            "scene.yaml:3: the key 'A' is given twice, first on line 2",
        ),
        ("prims:\n  A: {type: Sphere}\n  /A: {type: Box}\n", "scene.yaml:3: /A: this prim is given twice"),
        ("prims:\n  A b: {type: Sphere}\n", "'A b' is not a prim name or path"),
        ("prims: [1]\n", "prims: given a list; wanted a mapping"),
        ("prims:\n  A: 3\n", "scene.yaml:2: /A: a prim is a mapping of attributes; given 3"),
        ("a: 1\n---\nb: 2\n", "a second YAML document"),
        ("phrt: 2\n", "phrt: given 2; this program reads format version 1"),
        ("prims: !!python/object:os.system {}\n", "is not allowed; scene files are plain data"),
        ("prims: !thing {}\n", "the tag '!thing' is not allowed"),
        ("a: &a [*a]\n", "names no finished anchor"),
        ("x: &x {a: 1}\ny: {<<: *x}\n", "merge keys (<<) are not read"),
        ("? [a]\n: 1\n", "a key must be a name"),
        ("a: " + "[" * 100, "nested more than 64 levels deep"),
        ("variant: nigt\nvariants: {night: {}}\n", "the variant 'nigt' is not one of: default, night."),
        ("prims:\n  A: {type: DomeLight}\n  B: {type: DomeLight}\n", "a second DomeLight; the first is /A"),
        ("sublayers: [gone.yaml]\n", "sublayers: 'gone.yaml' was not found"),
        ("sublayers: [model.obj]\n", "sublayers: given 'model.obj'; wanted a file ending in .yaml"),
        ("prims:\n  A: {type: Mesh, asset: model.xyz}\n", "'model.xyz' was not found"),
    ],
)
def test_broken_files_say_where_and_why(error_of: ErrorOf, text: str, told: str) -> None:
    assert told in error_of(text)


def test_an_alias_bomb_is_refused_before_it_is_expanded(error_of: ErrorOf) -> None:
    bomb = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    bomb += "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 12))
    assert "values (aliases expanded)" in error_of(bomb)


def test_an_alias_tower_is_refused(error_of: ErrorOf) -> None:
    tower = "a0: &a0 [1]\n" + "".join(f"a{k}: &a{k} [*a{k - 1}]\n" for k in range(1, 100))
    assert "levels deep (aliases expanded)" in error_of(tower)


def test_text_that_is_not_utf8_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_bytes(b"name: \xff\xfe\n")
    with pytest.raises(SceneError, match="is not UTF-8 text"):
        load_scene(path)


def test_a_switch_for_an_unknown_effect_is_a_warning_with_the_nearest_name(write: Write) -> None:
    path = write("prims:\n  Ball:\n    type: Sphere\n    effects: {shadow: never}\n")
    with pytest.warns(PhrtWarning, match=r"scene.yaml:4: /Ball: .*no effect 'shadow' here.*Did you mean 'shadows'"):
        load_scene(path)


def test_a_scene_behind_a_link_finds_its_files(write: Write, tmp_path: Path) -> None:
    write("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "real/triangle.obj")
    write("prims:\n  There: {type: Mesh, asset: triangle.obj}\n", "real/scene.yaml")
    (tmp_path / "links").mkdir()
    for name in ("scene.yaml", "triangle.obj"):
        (tmp_path / "links" / name).symlink_to(tmp_path / "real" / name)
        assert len(load_scene(tmp_path / "links" / name).objects) == 1


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="there is no such file"):
        load_scene(tmp_path / "gone.yaml")
    with pytest.raises(AssetError, match="is not a file"):
        load_scene(tmp_path)


def test_an_unknown_suffix_lists_what_can_be_read(write: Write) -> None:
    with pytest.raises(AssetError, match=r"no loader reads '\.xyz' files; read are: .*\.glb.*\.obj.*\.yaml"):
        load_scene(write("", "model.xyz"))
    write("nothing", "model.abc")
    path = write("prims:\n  A: {type: Mesh, asset: model.abc}\n")
    with pytest.raises(SceneError, match=r"scene.yaml:2: /A: .*no loader reads '\.abc' files"):
        load_scene(path)


def test_a_loaders_unknown_option_is_named_with_the_line(write: Write) -> None:
    path = write("prims:\n  A: {type: Reference, loader: atrium, options: {bay_x: 3}}\n")
    with pytest.raises(SceneError, match=r"scene.yaml:2: /A: .*bay_x"):
        load_scene(path)


def test_a_model_file_has_no_variants(write: Write) -> None:
    path = write("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "triangle.obj")
    with pytest.raises(OptionError, match="has no variant 'night'"):
        load_scene(path, variant="night")
