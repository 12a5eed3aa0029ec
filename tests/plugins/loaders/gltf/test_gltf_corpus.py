"""Every real glTF: triangle counts against an independent count, and what each sample asset is there to show."""

from __future__ import annotations

import math
from pathlib import Path

import needs
import numpy as np
import pytest

pygltflib = needs.package("pygltflib", "an independent reader of glTF is in the extra 'test'")

ROOT = needs.ASSETS
FILES = sorted(
    path.relative_to(ROOT).as_posix()
    for folder in ("gltf", "cornell", "sponza")
    for kind in ("*.gltf", "*.glb")
    for path in (ROOT / folder).rglob(kind)
)
WARNED = {
    "gltf/MeshPrimitiveModes/MeshPrimitiveModes.gltf": ["points", "lines", "line loops", "line strips"],
    "gltf/SimpleSkin/SimpleSkin.gltf": ["skin joints"],
    "cornell/nvpro/cornellBox.gltf": ["NV_materials_mdl"],
    "sponza/sponza_textured.glb": ["1 normals of length zero"],
}


def counted_triangles(path: Path) -> int:
    """Triangles the default scene draws, from the JSON alone, read by another library."""
    document = pygltflib.GLTF2().load(str(path))

    def of_primitive(primitive) -> int:
        accessor = primitive.attributes.POSITION if primitive.indices is None else primitive.indices
        count = document.accessors[accessor].count
        mode = 4 if primitive.mode is None else primitive.mode
        return {4: count // 3, 5: count - 2, 6: count - 2}.get(mode, 0)

    def of_node(number: int) -> int:
        node = document.nodes[number]
        total = sum(of_node(child) for child in node.children or [])
        if node.mesh is not None:
            instances = (node.extensions or {}).get("EXT_mesh_gpu_instancing")
            copies = document.accessors[next(iter(instances["attributes"].values()))].count if instances else 1
            total += copies * sum(of_primitive(primitive) for primitive in document.meshes[node.mesh].primitives)
        return total

    return sum(of_node(node) for node in document.scenes[document.scene or 0].nodes)


def drawn_triangles(model) -> int:
    return sum(len(model.meshes[mesh].triangles) for node in model.nodes for mesh in node.meshes)


@pytest.mark.parametrize("name", FILES)
def test_loads_whole(assets, load, name):
    model, warnings = load(assets / name)
    assert drawn_triangles(model) == counted_triangles(assets / name) > 0
    expected = WARNED.get(name, [])
    assert len(warnings) == len(expected)
    assert all(part in warning for part, warning in zip(expected, warnings, strict=True))
    for mesh in model.meshes:
        vertices = len(mesh.positions)
        assert mesh.positions.dtype == np.float32
        assert mesh.triangles.dtype == mesh.triangle_material.dtype == np.int32
        assert len(mesh.triangle_material) == len(mesh.triangles)
        assert mesh.triangles.min() >= 0
        assert mesh.triangles.max() < vertices
        for name_, width in (("normals", 3), ("tangents", 4), ("uv0", 2), ("uv1", 2), ("colors", 4)):
            values = getattr(mesh, name_)
            assert values is None or (values.shape == (vertices, width) and values.dtype == np.float32)
        assert mesh.normals is None or np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
    for image in model.images:
        assert image.pixels.ndim == 3
        assert image.pixels.shape[2] == 4
        assert image.pixels.dtype == np.uint8


def test_the_corpus_is_there(assets):
    assert len(FILES) >= 34


@pytest.fixture
def sample(assets, load):
    """sample("BoxAnimated/BoxAnimated.glb", **options) -> the model, warnings dropped."""
    return lambda name, **options: load(assets / "gltf" / name, **options)[0]


def by_name(items, name):
    return next(item for item in items if item.name == name)


def test_a_million_triangles_in_a_hundred_meshes(sample):
    model = sample("MetalRoughSpheresNoTextures/MetalRoughSpheresNoTextures.glb")
    assert drawn_triangles(model) == 1_040_409
    placed = [mesh for node in model.nodes for mesh in node.meshes]
    assert (len(placed), len(model.meshes), len(model.materials)) == (102, 102, 98)


def test_one_material_per_helmet_texture_set(sample):
    material = sample("DamagedHelmet/DamagedHelmet.glb").materials[0]
    slots = ("base_color", "metallic_roughness", "normal", "occlusion", "emissive")
    images = [getattr(material, f"{slot}_texture").image for slot in slots]
    assert len(set(images)) == 5


def test_normal_mapped_mesh_without_tangents_gets_them(sample):
    mesh = sample("DamagedHelmet/DamagedHelmet.glb").meshes[0]
    assert mesh.tangents is not None
    assert np.abs((mesh.tangents[:, :3] * mesh.normals).sum(axis=1)).max() < 1e-3


def test_attenuation_and_volume(sample):
    model = sample("AttenuationTest/AttenuationTest.glb")
    tinted = [material for material in model.materials if math.isfinite(material.attenuation_distance)]
    assert tinted
    assert all(material.transmission == 1.0 for material in tinted)
    assert any(material.thickness > 0 for material in tinted)


def test_transmission_textures(sample):
    assert any(material.transmission_texture for material in sample("TransmissionTest/TransmissionTest.glb").materials)


def test_emissive_strength_multiplies(sample):
    model = sample("EmissiveStrengthTest/EmissiveStrengthTest.glb")
    strongest = max(model.materials, key=lambda material: sum(material.emissive))
    assert strongest.emissive == pytest.approx((0.1 * 16, 0.5 * 16, 0.9 * 16))


def test_unlit(sample):
    assert [material.unlit for material in sample("UnlitTest/UnlitTest.glb").materials] == [True, True]


def test_alpha_modes_and_cutoffs(sample):
    materials = sample("AlphaBlendModeTest/AlphaBlendModeTest.glb").materials
    assert {material.alpha_mode for material in materials} == {"OPAQUE", "MASK", "BLEND"}
    assert {material.alpha_cutoff for material in materials if material.alpha_mode == "MASK"} >= {0.25, 0.5, 0.75}


def test_double_sided(sample):
    assert sample("TwoSidedPlane/TwoSidedPlane.gltf").materials[0].double_sided


def test_wrap_modes(sample):
    model = sample("TextureSettingsTest/TextureSettingsTest.glb")
    refs = [material.base_color_texture for material in model.materials if material.base_color_texture]
    assert {ref.wrap_s for ref in refs} == {"repeat", "clamp", "mirror"}


def test_texture_transforms(sample):
    refs = [m.base_color_texture for m in sample("TextureTransformTest/TextureTransformTest.gltf").materials]
    assert any(ref.offset == (0.5, 0.0) or ref.offset == (0.0, 0.5) for ref in refs)
    assert any(abs(ref.rotation) == pytest.approx(math.pi / 8, abs=1e-4) for ref in refs)
    assert any(ref.scale == (1.5, 1.5) for ref in refs)


def test_two_uv_sets(sample):
    model = sample("MultiUVTest/MultiUVTest.glb")
    assert model.meshes[0].uv1 is not None
    material = model.materials[0]
    assert {material.base_color_texture.uv_set, material.emissive_texture.uv_set} == {0, 1}


def test_vertex_colours(sample):
    colours = [mesh.colors for mesh in sample("VertexColorTest/VertexColorTest.glb").meshes if mesh.colors is not None]
    assert colours
    assert all(c.min() >= 0 and c.max() <= 1 and c[:, :3].std() > 0 for c in colours)


def test_negative_scale_stays_in_the_matrix(sample):
    model = sample("NegativeScaleTest/NegativeScaleTest.glb")
    assert any(np.linalg.det(node.matrix[:3, :3]) < 0 for node in model.nodes)


def test_instances_are_child_nodes_that_share_a_mesh(sample):
    model = sample("SimpleInstancing/SimpleInstancing.glb")
    instances = [node for node in model.nodes if node.meshes]
    assert len(instances) == 125
    assert len(model.meshes) == 1
    assert len({tuple(node.matrix[:3, 3]) for node in instances}) == 125


def test_lights_and_their_range(sample):
    model = sample("Lights/Lights.glb")
    assert sorted(light.kind for light in model.lights) == ["directional", "point", "spot", "spot"]
    used = {node.light for node in model.nodes if node.light is not None}
    assert used <= set(range(len(model.lights)))


def test_cameras(sample):
    perspective, orthographic = sample("Cameras/Cameras.gltf").cameras
    assert perspective.fov_y == pytest.approx(0.7)
    assert (perspective.near, perspective.far, perspective.aspect) == (0.01, 100.0, 1.0)
    assert orthographic.ortho_height == 2.0


def test_scenes_by_index(sample):
    drawn = [
        drawn_triangles(sample("MultipleScenes/MultipleScenes.gltf", **options))
        for options in ({"scene": 0}, {"scene": 1}, {})
    ]
    assert drawn == [1, 2, 2]


def test_morphed_at_its_default_weights(sample):
    model = sample("MorphPrimitivesTest/MorphPrimitivesTest.glb")
    assert len(model.meshes) == 1
    assert set(model.meshes[0].triangle_material) == {0, 1}


def test_skin_at_rest_is_its_bind_pose(sample):
    model = sample("SimpleSkin/SimpleSkin.gltf")
    node = next(node for node in model.nodes if node.meshes)
    assert node.parent == -1
    positions = model.meshes[0].positions
    assert positions.min(axis=0) == pytest.approx([-0.5, 0, 0], abs=1e-6)
    assert positions.max(axis=0) == pytest.approx([0.5, 2, 0], abs=1e-6)


def test_sparse_accessor_moves_three_vertices(sample):
    positions = sample("SimpleSparseAccessor/SimpleSparseAccessor.gltf").meshes[0].positions
    assert (positions[[8, 10, 12]] == [[1, 2, 0], [3, 3, 0], [5, 4, 0]]).all()


def test_interleaved_box_is_the_unit_cube(sample):
    mesh = sample("BoxInterleaved/BoxInterleaved.glb").meshes[0]
    assert mesh.positions.min(axis=0) == pytest.approx([-0.5] * 3)
    assert mesh.positions.max(axis=0) == pytest.approx([0.5] * 3)


def test_draco_box_is_the_unit_cube(sample):
    mesh = sample("variants/Box-glTF-Draco/Box.gltf").meshes[0]
    assert mesh.positions.min(axis=0) == pytest.approx([-0.5] * 3, abs=1e-3)
    assert mesh.positions.max(axis=0) == pytest.approx([0.5] * 3, abs=1e-3)
    assert set(map(tuple, np.round(mesh.normals).astype(int))) == {
        (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1),
    }  # fmt: skip


def test_animation_of_each_interpolation(sample):
    tracks = sample("InterpolationTest/InterpolationTest.glb").tracks
    kinds = {(track.target, track.interpolation) for track in tracks}
    targets = ("translation", "rotation", "scale")
    assert kinds == {(target, kind) for target in targets for kind in ("step", "linear", "cubic")}
    for track in tracks:
        width = 4 if track.target == "rotation" else 3
        assert track.values.shape == (len(track.times), *((3, width) if track.interpolation == "cubic" else (width,)))


def test_one_animation_can_be_chosen(sample):
    assert len(sample("InterpolationTest/InterpolationTest.glb", animation=0).tracks) == 1


def test_generated_tangents_agree_with_the_files_own(sample):
    from phrt_plugins.loaders.gltf_tangents import make_tangents

    for mesh in sample("FlightHelmet/FlightHelmet.gltf").meshes:
        source, tangents, _ = make_tangents(mesh.positions, mesh.normals, mesh.uv0, mesh.triangles)
        cosine = (tangents[:, :3] * mesh.tangents[source, :3]).sum(axis=1)
        assert np.mean(cosine > 0.98) > 0.95
        assert np.mean(tangents[:, 3] == mesh.tangents[source, 3]) > 0.99


def test_smaller_textures_on_request(sample):
    model = sample("DamagedHelmet/DamagedHelmet.glb", max_texture_size=256)
    assert {image.pixels.shape for image in model.images} == {(256, 256, 4)}


def test_odd_names(sample):
    model = sample("UnicodeTest/Unicode❤♻Test.glb")
    assert model.materials[0].name == "Unicode❤♻Material"
    assert len(sample("Box With Spaces/Box With Spaces.gltf").images) == 3
