"""The procedural atrium: what it holds, how it is oriented, that it is the same every time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from phrt.interfaces.loader import LoadContext
from phrt.model import Mesh, Model
from phrt.registry.manager import get_registry
from phrt_plugins.loaders import atrium_architecture, atrium_furniture, atrium_statues
from phrt_plugins.loaders.atrium import AtriumLoader, build_atrium
from phrt_plugins.loaders.atrium_architecture import Detail
from phrt_plugins.loaders.atrium_textures import Noise, paint_textures
from phrt_plugins.loaders.options import AtriumOptions
from phrt_plugins.loaders.shapes import Part


@pytest.fixture(scope="module")
def atrium() -> Model:
    return build_atrium(AtriumOptions())


def world_matrices(model: Model) -> list[np.ndarray]:
    worlds: list[np.ndarray] = []
    for node in model.nodes:
        worlds.append((worlds[node.parent] if node.parent >= 0 else np.eye(4)) @ node.matrix)
    return worlds


def group_members(model: Model) -> dict[str, list[str]]:
    members: dict[str, list[str]] = {}
    for node in model.nodes:
        if node.parent >= 0:
            members.setdefault(model.nodes[node.parent].name, []).append(node.name)
    return members


def triangle_count(model: Model) -> int:
    return sum(len(model.meshes[mesh].triangles) for node in model.nodes for mesh in node.meshes)


def face_vectors(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    corner = positions.astype(np.float64)[triangles]
    return np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])


def test_registry_makes_the_loader_by_name() -> None:
    loader = get_registry().create("loader", "atrium", {"bays_x": 2, "bays_z": 2, "detail": 0.25})
    assert isinstance(loader, AtriumLoader)
    refused = LoadContext(resolve=lambda reference: pytest.fail(f"opened {reference}"), warn=pytest.fail)
    assert triangle_count(loader.load(Path("unused"), refused)) > 1000


def test_unknown_and_out_of_range_options_are_refused() -> None:
    with pytest.raises(ValidationError, match="bays_y"):
        AtriumOptions.model_validate({"bays_y": 3})
    with pytest.raises(ValidationError, match="greater than or equal to 2"):
        AtriumOptions(bays_x=1)


def test_default_atrium_has_the_size_it_promises(atrium: Model) -> None:
    assert 50_000 <= triangle_count(atrium) <= 150_000
    assert sum(bool(node.meshes) for node in atrium.nodes) >= 60


def test_every_object_has_its_own_path_in_a_group(atrium: Model) -> None:
    members = group_members(atrium)
    assert all(len(set(names)) == len(names) for names in members.values())
    assert {"columns", "arches", "vaults", "walls", "drapes", "statues", "spheres", "fountain"} <= members.keys()
    assert "column_07" in members["columns"]
    assert "arch_00" in members["arches"]
    assert all(node.parent < row for row, node in enumerate(atrium.nodes))


def test_counts_follow_the_bays(atrium: Model) -> None:
    members = group_members(atrium)
    assert len(members["columns"]) == 2 * 2 * (6 + 4)
    assert len(members["vaults"]) == 2 * (6 + 4) + 4
    small = group_members(build_atrium(AtriumOptions(bays_x=2, bays_z=3, storeys=1, detail=0.25, statues=0, spheres=1)))
    assert len(small["columns"]) == 2 * (2 + 3)
    assert len(small["spheres"]) == 1
    assert not {"vaults", "statues", "balustrades"} & small.keys()


def test_columns_of_a_storey_share_one_mesh(atrium: Model) -> None:
    columns = {row for row, node in enumerate(atrium.nodes) if node.name == "columns"}
    meshes = Counter(node.meshes[0] for node in atrium.nodes if node.parent in columns)
    assert sorted(meshes.values()) == [20, 20]


def test_columns_stand_on_the_corners_of_the_bays(atrium: Model) -> None:
    worlds = world_matrices(atrium)
    parents = {row for row, node in enumerate(atrium.nodes) if node.name == "columns"}
    places = np.array(
        [world[:3, 3] for node, world in zip(atrium.nodes, worlds, strict=True) if node.parent in parents]
    )
    ground = places[places[:, 1] < 1.0]
    on_long, on_short = np.isclose(np.abs(ground[:, 2]), 6.0), np.isclose(np.abs(ground[:, 0]), 9.0)
    assert np.all(on_long | on_short)
    assert len(np.unique(np.round(ground, 3), axis=0)) == 20


def test_there_are_four_mirrors_and_four_glasses_that_bend_light(atrium: Model) -> None:
    mirrors = glasses = 0
    for row, node in enumerate(atrium.nodes):
        if node.parent >= 0 and atrium.nodes[node.parent].name == "spheres":
            materials = {int(m) for m in atrium.meshes[atrium.nodes[row].meshes[0]].triangle_material}
            (material,) = (atrium.materials[m] for m in materials)
            mirrors += material.metallic == 1.0 and material.roughness <= 0.05
            glasses += material.transmission == 1.0 and material.ior == 1.5 and material.thickness > 0
    assert mirrors >= 4
    assert glasses >= 4


def test_spheres_rest_on_the_floor_and_have_exact_normals(atrium: Model) -> None:
    for mesh in atrium.meshes:
        if mesh.name.startswith("ball_"):
            assert mesh.normals is not None
            radius = float(mesh.name.rsplit("_", 1)[1])
            np.testing.assert_allclose(mesh.positions, mesh.normals * radius, atol=1e-5)
    worlds = world_matrices(atrium)
    for node, world in zip(atrium.nodes, worlds, strict=True):
        if node.parent >= 0 and atrium.nodes[node.parent].name == "spheres":
            lowest = world[1, 3] + atrium.meshes[node.meshes[0]].positions[:, 1].min()
            assert lowest == pytest.approx(0.0, abs=1e-5) or lowest == pytest.approx(0.16, abs=1e-5)


def test_every_node_is_placed_without_mirroring_or_scaling(atrium: Model) -> None:
    for matrix in world_matrices(atrium):
        np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1.0)


def test_meshes_are_well_formed(atrium: Model) -> None:
    for mesh in atrium.meshes:
        assert mesh.normals is not None
        assert mesh.uv0 is not None
        assert all(a.dtype == np.dtype(np.float32) for a in (mesh.positions, mesh.normals, mesh.uv0))
        assert all(a.dtype == np.dtype(np.int32) for a in (mesh.triangles, mesh.triangle_material))
        assert len(mesh.positions) == len(mesh.normals) == len(mesh.uv0) == mesh.triangles.max() + 1
        assert all(np.isfinite(a).all() for a in (mesh.positions, mesh.normals, mesh.uv0))
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)
        assert 0 <= mesh.triangle_material.min() <= mesh.triangle_material.max() < len(atrium.materials)


def test_normals_agree_with_the_winding(atrium: Model) -> None:
    for mesh in atrium.meshes:
        assert mesh.normals is not None
        face = face_vectors(mesh.positions, mesh.triangles)
        agreement = np.einsum("tj,tkj->tk", face, mesh.normals[mesh.triangles])
        assert (agreement > 0).all(), mesh.name


def test_hard_edges_stay_hard_and_round_parts_smooth(atrium: Model) -> None:
    by_name = {mesh.name: mesh for mesh in atrium.meshes}
    court = by_name["court_floor"]
    assert len(court.positions) == 24
    assert court.normals is not None
    assert set(map(tuple, np.round(np.abs(court.normals), 6))) == {(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)}
    jar = by_name["jar"]
    assert smooth_share(jar) > 0.5


def smooth_share(mesh: Mesh) -> float:
    """How many vertices have a normal that is none of its faces' own."""
    assert mesh.normals is not None
    face = face_vectors(mesh.positions, mesh.triangles)
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    difference = np.linalg.norm(mesh.normals[mesh.triangles] - face[:, None], axis=2)
    return float((difference > 1e-3).mean())


CLOSED_OBJECTS: dict[str, Callable[[Detail], list[Part]]] = {
    "bird": lambda d: atrium_statues.soaring_bird(d, 0.8),
    "knot": lambda d: atrium_statues.trefoil(d, 0.8),
    "twist": lambda d: atrium_statues.twisted_form(d, -0.8),
    "rings": lambda d: atrium_statues.seated_rings(d, 0.8),
    "jar": lambda d: atrium_furniture.vase(d, slim=False),
    "urn": lambda d: atrium_furniture.vase(d, slim=True),
    "basin": atrium_furniture.fountain_basin,
    "water": atrium_furniture.fountain_water,
    "bowl": atrium_furniture.fountain_bowl,
    "lantern": lambda d: atrium_furniture.lantern(d, 1.5),
    "balusters": lambda d: atrium_architecture.balustrade(d)[:2],
    "cornice": lambda d: atrium_architecture.cornice(12.0),
    "beams": lambda d: atrium_architecture.ceiling_beams(12.0),
    "door": lambda d: atrium_architecture.door_leaf(0.7, 2.0, 0.0, d),
    "arch wall": lambda d: atrium_architecture.arcade_arch(1.94, d)[::2],
}


@pytest.mark.parametrize("name", CLOSED_OBJECTS)
@pytest.mark.parametrize("detail", [0.5, 1.0, 2.0])
def test_closed_parts_enclose_a_positive_volume(name: str, detail: float) -> None:
    for part in CLOSED_OBJECTS[name](Detail(detail)):
        assert_solid([part])


@pytest.mark.parametrize("detail", [0.5, 1.0])
def test_vaults_and_roofs_are_closed_as_a_whole(detail: float) -> None:
    assert_solid(atrium_architecture.groin_vault(3.4, 5.34, Detail(detail))[:-1])
    assert_solid(atrium_architecture.roof(12.0))


def assert_solid(parts: list[Part]) -> None:
    """No area is missing (the faces' vectors cancel), and the volume inside is positive."""
    corners = np.concatenate([part.positions[part.triangles] for part in parts])
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.abs(face.sum(axis=0)).max() < 1e-6 * np.abs(face).sum()
    volume = np.einsum("ij,ij->i", corners[:, 0] - corners.mean(axis=(0, 1)), face).sum() / 6
    assert volume > 0


def test_groin_vault_is_a_barrel_at_its_sides_and_level_with_its_crown() -> None:
    web = atrium_architecture.groin_vault(3.4, 5.34, Detail(1.0))[0].positions
    inner = web - [0.0, 3.4, -1.5]
    expected = np.sqrt(np.clip(1.5**2 - np.minimum(np.abs(inner[:, 0]), np.abs(inner[:, 2])) ** 2, 0, None))
    np.testing.assert_allclose(inner[:, 1], expected, atol=1e-9)
    assert inner[:, 1].max() == pytest.approx(1.5)


def test_equal_options_give_equal_models_and_other_seeds_other_textures(atrium: Model) -> None:
    again = build_atrium(AtriumOptions())
    for mesh, other in zip(atrium.meshes, again.meshes, strict=True):
        assert mesh.positions.tobytes() == other.positions.tobytes()
        assert mesh.triangles.tobytes() == other.triangles.tobytes()
    assert all(np.array_equal(a.pixels, b.pixels) for a, b in zip(atrium.images, again.images, strict=True))
    assert not np.array_equal(paint_textures(1)[0].pixels, atrium.images[0].pixels)


def test_detail_scales_the_triangles_and_keeps_the_objects() -> None:
    coarse, fine = (build_atrium(AtriumOptions(bays_x=2, bays_z=2, detail=detail)) for detail in (0.5, 2.0))
    assert triangle_count(fine) > 3 * triangle_count(coarse)
    assert [node.name for node in fine.nodes] == [node.name for node in coarse.nodes]


def test_images_are_opaque_rgba_and_named_once(atrium: Model) -> None:
    assert len({image.name for image in atrium.images}) == len(atrium.images)
    for image in atrium.images:
        assert image.pixels.dtype == np.uint8
        assert image.pixels.shape in ((256, 256, 4), (512, 512, 4))
        assert (image.pixels[..., 3] == 255).all()


def test_noise_repeats_without_a_seam() -> None:
    field = Noise(np.random.default_rng(3)).field(128, 1.6)
    inside = np.abs(np.diff(field, axis=1)).mean()
    seam = np.abs(field[:, 0] - field[:, -1]).mean()
    assert seam < 2 * inside


def test_texture_references_point_at_images(atrium: Model) -> None:
    textured = [m for m in atrium.materials if m.base_color_texture is not None]
    assert len(textured) >= 10
    assert all(m.base_color_texture.image < len(atrium.images) for m in textured if m.base_color_texture)
    assert any(m.normal_texture for m in textured)
    assert any(m.metallic_roughness_texture for m in textured)
