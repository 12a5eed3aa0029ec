"""The node hierarchy, scenes, instances, lights, cameras; animations, skins and morph targets at rest."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phrt.errors import AssetError

TURN = [0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4)]
"""A quarter turn about +Z."""


def test_translation_rotation_scale(build, load):
    build.place({"translation": [1, 2, 3], "rotation": TURN, "scale": [2, -3, 4]})
    matrix = load(build.write())[0].nodes[0].matrix
    assert matrix == pytest.approx(np.array([[0, 3, 0, 1], [2, 0, 0, 2], [0, 0, 4, 3], [0, 0, 0, 1]]))
    assert matrix.dtype == np.float64


def test_matrix_is_stored_by_columns(build, load):
    build.place({"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]})
    assert load(build.write())[0].nodes[0].matrix[:, 3].tolist() == [5, 6, 7, 1]


def test_parents_precede_children_whatever_the_files_order(build, load):
    names = ["leaf", "root", "middle", "other"]
    build.json["nodes"] = [
        {"name": "leaf"},
        {"name": "root", "children": [2, 3]},
        {"name": "middle", "children": [0]},
        {"name": "other"},
    ]
    build.json["scenes"] = [{"nodes": [1]}]
    nodes = load(build.write())[0].nodes
    assert sorted(node.name for node in nodes) == sorted(names)
    parents = {node.name: nodes[node.parent].name if node.parent >= 0 else None for node in nodes}
    assert parents == {"root": None, "middle": "root", "other": "root", "leaf": "middle"}
    assert all(node.parent < number for number, node in enumerate(nodes))


def test_a_chain_of_ten_thousand_nodes(build, load):
    build.json["nodes"] = [{"children": [number + 1]} for number in range(9_999)] + [{}]
    build.json["scenes"] = [{"nodes": [0]}]
    assert len(load(build.write())[0].nodes) == 10_000


@pytest.mark.parametrize(
    ("nodes", "reason"),
    [
        ([{"children": [0]}], "nodes[0]: is its own ancestor"),
        ([{}, {"children": [2]}, {"children": [1]}], "nodes[1]: is its own ancestor"),
        ([{"children": [2]}, {"children": [2]}, {}], "nodes[2]: is a child of both nodes[0] and nodes[1]"),
        ([{"children": [1, 1]}, {}], "nodes[1]: is a child of both nodes[0] and nodes[0]"),
        ([{"children": [1]}], "nodes[0].children[0]: points at nodes[1], but there are 1 nodes"),
        ([{"children": [-1]}], "nodes[0].children[0]: is -1"),
        ([{"mesh": 0}], "nodes[0].mesh: points at meshes[0], but there are 0 meshes"),
        ([{"translation": [0, 0]}], "nodes[0].translation: has 2 numbers; it must have 3"),
        ([{"translation": [0, 0, 1e300]}], "nodes[0].translation[2]: is 1e+300"),
        ([{"matrix": [1] * 15}], "nodes[0].matrix: has 15 numbers; it must have 16"),
        ([{"scale": [1e17] * 3, "children": [1]}, {"scale": [1e17] * 3}], "nodes[1]: is placed or scaled beyond"),
    ],
)
def test_what_nodes_may_not_say(build, load, nodes, reason):
    build.json["nodes"], build.json["scenes"] = nodes, [{"nodes": [0]}]
    with pytest.raises(AssetError) as error:
        load(build.write())
    assert reason in str(error.value)


@pytest.mark.parametrize(
    ("scene", "names"), [(None, ["b"]), (0, ["a"]), ("first", ["a"]), ("second", ["b"]), (1, ["b"])]
)
def test_scenes(build, load, scene, names):
    build.json["nodes"] = [{"name": "a"}, {"name": "b"}]
    build.json["scenes"] = [{"name": "first", "nodes": [0]}, {"name": "second", "nodes": [1]}]
    build.json["scene"] = 1
    assert [node.name for node in load(build.write(), scene=scene)[0].nodes] == names


@pytest.mark.parametrize(("scene", "hint"), [(2, "it has 2: 0 'first', 1"), ("frist", "Did you mean 'first'?")])
def test_scene_that_is_not_there(build, load, scene, hint):
    build.json["scenes"] = [{"name": "first"}, {}]
    with pytest.raises(AssetError, match=f"has no scene {scene!r}") as error:
        load(build.write(), scene=scene)
    assert hint in str(error.value)


def test_scene_that_lists_a_node_twice(build, load):
    build.json["nodes"], build.json["scenes"] = [{}], [{"nodes": [0, 0]}]
    with pytest.raises(AssetError, match=r"nodes\[0\]: is listed twice in the scene"):
        load(build.write())


def test_without_scenes_all_roots_are_drawn(build, load):
    build.draw(build.quad())
    del build.json["scenes"]
    model, warnings = load(build.write())
    assert len(model.nodes) == 1
    assert warnings == ["has no scene; all of its nodes are drawn"]


# Instances


def test_instances(build, load):
    attributes = {
        "TRANSLATION": build.accessor([[1, 0, 0], [0, 2, 0]]),
        "ROTATION": build.accessor(np.array([[0, 0, 0, 127], [0, 0, 127, 0]]), "int8", normalized=True),
        "SCALE": build.accessor([[1, 1, 1], [3, 3, 3]]),
    }
    node = {"name": "tree", "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}
    build.draw(build.quad(), node=node)
    model, _ = load(build.write())
    assert [(node.name, node.parent, node.meshes) for node in model.nodes] == [
        ("tree", -1, []),
        ("tree_0", 0, [0]),
        ("tree_1", 0, [0]),
    ]
    assert model.nodes[2].matrix == pytest.approx(
        np.array([[-3, 0, 0, 0], [0, -3, 0, 2], [0, 0, 3, 0], [0, 0, 0, 1.0]]), abs=1e-6
    )


def test_instances_must_agree_in_count(build, load):
    attributes = {"TRANSLATION": build.accessor(np.zeros((2, 3))), "SCALE": build.accessor(np.ones((3, 3)))}
    build.draw(build.quad(), node={"extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}})
    with pytest.raises(AssetError, match="all of one count"):
        load(build.write())


def test_instances_are_limited(build, load):
    many = build.add("accessors", {"componentType": 5126, "type": "VEC3", "count": 200_000})
    build.draw(build.quad(), node={"extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": many}}}})
    with pytest.raises(AssetError, match="makes more than 100,000 nodes"):
        load(build.write())


# Lights and cameras


def test_lights(build, load):
    build.json["extensions"] = {
        "KHR_lights_punctual": {
            "lights": [
                {"type": "point", "color": [1, 0, 0], "intensity": 40, "range": 7, "name": "lamp"},
                {"type": "spot", "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}},
                {"type": "directional"},
            ]
        }
    }
    build.place({"extensions": {"KHR_lights_punctual": {"light": 1}}})
    model, _ = load(build.write())
    lamp, spot, sun = model.lights
    assert (lamp.kind, lamp.name, lamp.color, lamp.intensity, lamp.range) == ("point", "lamp", (1, 0, 0), 40, 7)
    assert (spot.kind, spot.inner_angle, spot.outer_angle) == ("spot", 0.1, 0.2)
    assert (sun.kind, sun.range, sun.intensity) == ("directional", math.inf, 1)
    assert model.nodes[0].light == 1


def test_light_of_unknown_type(build, load):
    build.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "laser"}]}}
    with pytest.raises(AssetError, match="type: is 'laser'; it must be point, spot or directional"):
        load(build.write())


def test_cameras(build, load):
    build.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.6, "znear": 0.1}})
    build.add("cameras", {"type": "orthographic", "orthographic": {"xmag": 4, "ymag": 2, "znear": 0, "zfar": 9}})
    build.place({"camera": 1})
    model, _ = load(build.write())
    first, second = model.cameras
    assert (first.fov_y, first.near, first.far, first.aspect, first.ortho_height) == (0.6, 0.1, math.inf, None, None)
    assert (second.ortho_height, second.aspect, second.far) == (4, 2, 9)
    assert model.nodes[0].camera == 1


@pytest.mark.parametrize(
    ("camera", "reason"),
    [
        ({"type": "fisheye"}, "type: is 'fisheye'"),
        ({"type": "perspective"}, "has no 'perspective'"),
        ({"type": "perspective", "perspective": {"yfov": 4, "znear": 1}}, "yfov: is 4"),
        ({"type": "perspective", "perspective": {"yfov": 1, "znear": 2, "zfar": 1}}, "zfar: is 1, not beyond znear"),
        ({"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 0, "znear": 0, "zfar": 1}}, "ymag: is 0"),
    ],
)
def test_what_a_camera_may_not_say(build, load, camera, reason):
    build.add("cameras", camera)
    with pytest.raises(AssetError) as error:
        load(build.write())
    assert reason in str(error.value)


# Animation


def animate(build, path: str, values, *, times=(0.0, 1.0), name="LINEAR", dtype="float32", node=0, **extra) -> None:
    sampler = {
        "input": build.accessor(np.array(times)),
        "output": build.accessor(values, dtype, **extra),
        "interpolation": name,
    }
    channel = {"sampler": 0, "target": {"node": node, "path": path}}
    build.add("animations", {"samplers": [sampler], "channels": [channel]})


def test_tracks_of_each_kind(build, load):
    build.place({})
    animate(build, "translation", [[0, 0, 0], [1, 2, 3]])
    animate(build, "scale", np.arange(18.0).reshape(6, 3), name="CUBICSPLINE")
    animate(build, "rotation", [[0, 0, 0, 127], [0, 0, 127, 0]], dtype="int8", normalized=True, name="STEP")
    move, grow, turn = load(build.write())[0].tracks
    assert (move.node, move.target, move.interpolation) == (0, "translation", "linear")
    assert move.times.tolist() == [0, 1]
    assert move.values.tolist() == [[0, 0, 0], [1, 2, 3]]
    assert grow.values.shape == (2, 3, 3)
    assert grow.values[1, 1].tolist() == [12, 13, 14]
    assert turn.interpolation == "step"
    assert turn.values == pytest.approx(np.array([[0, 0, 0, 1], [0, 0, 1, 0]]))


def test_the_first_of_two_animations_wins_and_one_can_be_chosen(build, load):
    build.place({})
    animate(build, "scale", np.full((2, 3), 1.0))
    animate(build, "scale", np.full((2, 3), 2.0))
    model, warnings = load(build.write())
    assert [track.values[0, 0] for track in model.tracks] == [1]
    assert any("several animations" in warning for warning in warnings)
    assert [track.values[0, 0] for track in load(build.write(), animation=1)[0].tracks] == [2]


def test_tracks_of_other_scenes_are_left_out(build, load):
    build.place({})
    build.add("nodes", {})
    animate(build, "scale", np.ones((2, 3)), node=1)
    assert load(build.write())[0].tracks == []


@pytest.mark.parametrize(
    ("values", "options", "reason"),
    [
        (np.ones((3, 3)), {}, "has 3 values for 2 keyframes; LINEAR needs 1 each"),
        (np.ones((2, 3)), {"name": "CUBICSPLINE"}, "CUBICSPLINE needs 3 each"),
        (np.ones((2, 4)), {}, "is VEC4, but the animation's output has 3 components"),
        (np.ones((2, 3)), {"name": "BEZIER"}, "interpolation: is 'BEZIER'"),
        (np.ones((2, 3)), {"times": (0.0, np.nan)}, "is not a finite number"),
        (np.ones((2, 3)), {"node": 7}, "target.node: points at nodes[7]"),
    ],
)
def test_what_an_animation_may_not_say(build, load, values, options, reason):
    build.place({})
    animate(build, "translation", values, **options)
    with pytest.raises(AssetError) as error:
        load(build.write())
    assert reason in str(error.value)


def test_times_that_do_not_increase_are_not_played(build, load):
    build.place({})
    animate(build, "scale", np.ones((2, 3)), times=(1.0, 1.0))
    model, warnings = load(build.write())
    assert model.tracks == []
    assert any("times that do not increase" in warning for warning in warnings)


# Morph targets


def morphing(build, node=None, **mesh) -> None:
    up = build.accessor(np.tile([0.0, 0.0, 1.0], (4, 1)))
    right = build.accessor(np.tile([1.0, 0.0, 0.0], (4, 1)))
    build.draw({**build.quad(), "targets": [{"POSITION": up}, {"POSITION": right}]}, node=node, **mesh)


@pytest.mark.parametrize(
    ("mesh", "node", "moved"),
    [
        ({}, {}, [0, 0, 0]),
        ({"weights": [0.5, 0]}, {}, [0, 0, 0.5]),
        ({"weights": [0.5, 0]}, {"weights": [0, 2]}, [2, 0, 0]),
        ({}, {"weights": [1, 1]}, [1, 0, 1]),
    ],
)
def test_morphed_by_the_weights_of_node_or_mesh(build, load, mesh, node, moved):
    morphing(build, node, **mesh)
    assert load(build.write())[0].meshes[0].positions[0].tolist() == moved


def test_nodes_with_other_weights_get_other_meshes(build, load):
    morphing(build)
    build.place({"mesh": 0, "weights": [1, 0]})
    build.place({"mesh": 0, "weights": [1, 0]})
    model, _ = load(build.write())
    assert [node.meshes for node in model.nodes] == [[0], [1], [1]]


def test_animated_weights_are_one_warning(build, load):
    morphing(build)
    animate(build, "weights", np.zeros(4))
    animate(build, "weights", np.zeros(4))
    model, warnings = load(build.write())
    assert model.tracks == []
    assert warnings == ["animated morph weights are not played; the mesh stays at its rest pose"]


def test_morph_target_of_another_count(build, load):
    wrong = build.accessor(np.zeros((3, 3)))
    build.draw({**build.quad(), "targets": [{"POSITION": wrong}]}, weights=[1])
    with pytest.raises(AssetError, match="as a morph target it must be 4 VEC3"):
        load(build.write())


# Skins


def skinned(build, joints, weights, joint_node=None) -> None:
    """A quad on node 0 with joints on nodes 1 and 2; the second joint stands at (0, 5, 0), turned a quarter."""
    joint_accessor = build.accessor(np.tile(joints, (4, 1)), "uint8")
    weight_accessor = build.accessor(np.tile(weights, (4, 1)))
    normal = build.accessor(np.tile([1.0, 0.0, 0.0], (4, 1)))
    primitive = build.quad(JOINTS_0=joint_accessor, WEIGHTS_0=weight_accessor, NORMAL=normal)
    build.draw(primitive, node={"skin": 0, "translation": [100, 0, 0], "name": "body"})
    build.place({"children": [2]})
    build.add("nodes", joint_node or {"translation": [0, 5, 0], "rotation": TURN})
    build.add("skins", {"joints": [1, 2]})


def test_skin_at_rest_moves_vertices_and_normals_by_their_joints(build, load):
    skinned(build, [1, 0, 0, 0], [1.0, 0, 0, 0])
    model, warnings = load(build.write())
    body = model.nodes[-1]
    assert (body.name, body.parent) == ("body_skinned", -1)
    assert (body.matrix == np.eye(4)).all(), "joints alone place a skinned mesh"
    mesh = model.meshes[body.meshes[0]]
    assert mesh.positions == pytest.approx(np.array([[0, 5, 0], [0, 6, 0], [-1, 6, 0], [-1, 5, 0]]), abs=1e-6)
    assert mesh.normals == pytest.approx(np.tile([0, 1, 0], (4, 1)), abs=1e-6)
    assert warnings == []


def test_weights_are_made_to_sum_to_one(build, load):
    skinned(build, [0, 1, 0, 0], [1.0, 1.0, 0, 0], {"translation": [0, 5, 0]})
    assert load(build.write())[0].meshes[0].positions[0] == pytest.approx([0, 2.5, 0])


def test_inverse_bind_matrices_are_applied(build, load):
    skinned(build, [1, 0, 0, 0], [1.0, 0, 0, 0], {"translation": [0, 5, 0]})
    inverse = np.tile(np.eye(4), (2, 1, 1))
    inverse[1, :3, 3] = (0, -5, 0)
    build.json["skins"][0]["inverseBindMatrices"] = build.accessor(inverse.transpose(0, 2, 1))
    assert load(build.write())[0].meshes[0].positions[0] == pytest.approx([0, 0, 0])


def test_joint_past_the_end_of_its_skin(build, load):
    skinned(build, [2, 0, 0, 0], [1.0, 0, 0, 0])
    with pytest.raises(AssetError, match="has joint 2, but its skin has 2"):
        load(build.write())


def test_animated_joint_is_one_warning(build, load):
    skinned(build, [0, 0, 0, 0], [1.0, 0, 0, 0])
    animate(build, "translation", np.zeros((2, 3)), node=2)
    animate(build, "scale", np.ones((2, 3)), node=1)
    _, warnings = load(build.write())
    assert warnings == ["animated skin joints do not move their mesh; it stays at its rest pose"]
