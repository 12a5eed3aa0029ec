"""MTL: which statement becomes which glTF value, textures, and files that must not be opened."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from phrt.model import Material, Model
from phrt_plugins.loaders.mesh_mtl import parse_map

Load = Callable[..., Model]

SQUARE = """mtllib thing.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl m
f 1/1 2/2 3/3 4/4
"""


@pytest.fixture
def material(tmp_path: Path, load: Load) -> Callable[[str], Material]:
    """The glTF material of MTL statements."""

    def of(statements: str) -> Material:
        (tmp_path / "thing.mtl").write_text("newmtl m\n" + statements)
        (result,) = load(SQUARE).materials
        return result

    return of


def test_diffuse_highlight_emission(material: Callable[[str], Material]) -> None:
    made = material("Kd 0.1 0.2 0.3\nKs 0.5 0.5 0.5\nNs 30\nNi 1.33\nKe 17 12 4\n")
    assert made.name == "m"
    assert made.base_color == (0.1, 0.2, 0.3, 1.0)
    assert made.emissive == (17, 12, 4)
    assert (made.specular, made.metallic, made.transmission, made.ior) == (1.0, 0.0, 0.0, 1.33)
    assert made.roughness == pytest.approx((2 / 32) ** 0.25)
    assert made.alpha_mode == "OPAQUE"
    assert made.double_sided


def test_without_ks_a_surface_is_purely_diffuse(material: Callable[[str], Material]) -> None:
    made = material("Kd 0.725 0.71 0.68\nKs 0 0 0\nNs 10\nNi 1\nillum 2\n")
    assert (made.specular, made.roughness, made.ior) == (0.0, 1.0, 1.5)
    assert material("Kd 1 1 1\nKs 1 1 1\nNs 900\nillum 1\n").specular == 0.0


@pytest.mark.parametrize(("statement", "alpha"), [("d 0.25", 0.25), ("Tr 0.25", 0.75), ("d 1", 1.0), ("Tr 0", 1.0)])
def test_dissolve_is_alpha_blending(material: Callable[[str], Material], statement: str, alpha: float) -> None:
    made = material(f"Kd 1 1 1\n{statement}\n")
    assert made.base_color[3] == alpha
    assert made.alpha_mode == ("BLEND" if alpha < 1 else "OPAQUE")


def test_illum_5_is_a_mirror_and_7_is_glass(material: Callable[[str], Material]) -> None:
    mirror = material("Kd 0 0 0\nKs 0.9 0.8 0.7\nillum 5\n")
    assert (mirror.base_color[:3], mirror.metallic, mirror.roughness) == ((0.9, 0.8, 0.7), 1.0, 0.0)
    glass = material("Kd 0 0 0\nKs 0.1 0.1 0.1\nTf 0.9 1 0.9\nNi 1.5\nd 0.1\nillum 7\n")
    assert (glass.transmission, glass.roughness, glass.ior, glass.base_color) == (1.0, 0.0, 1.5, (0.9, 1.0, 0.9, 1.0))
    assert glass.thickness > 0
    assert glass.alpha_mode == "OPAQUE"


def test_pbr_extension_comes_first(material: Callable[[str], Material]) -> None:
    made = material("Kd 1 0 0\nKs 1 1 1\nNs 10\nPr 0.3\nPm 0.8\n")
    assert (made.roughness, made.metallic) == (0.3, 0.8)


def test_map_kd_is_loaded_upright_and_a_black_kd_means_the_texture(tmp_path: Path, load: Load) -> None:
    pixels = np.zeros((2, 2, 3), np.uint8)
    pixels[0] = (255, 0, 0)
    Image.fromarray(pixels).save(tmp_path / "my wood.png")
    (tmp_path / "thing.mtl").write_text("newmtl m\nKd 0 0 0\nmap_Kd -s 2 3 1 my wood.png\n")
    model = load(SQUARE)
    (mesh,), (material,), (image,) = model.meshes, model.materials, model.images
    assert image.pixels.shape == (2, 2, 4)
    assert image.pixels[0, 0].tolist() == [255, 0, 0, 255]
    assert material.base_color[:3] == (1, 1, 1)
    ref = material.base_color_texture
    assert ref is not None
    assert (ref.image, ref.scale, ref.offset) == (0, (2, 3), (0, -2))
    # The upper edge of the square (file's v = 1) is the image's upper edge (v = 0).
    assert mesh.uv0 is not None
    assert (mesh.uv0[mesh.positions[:, 1] == 1][:, 1] == 0).all()


def test_map_d_cuts_holes(tmp_path: Path, load: Load) -> None:
    Image.new("RGB", (4, 4), (10, 200, 30)).save(tmp_path / "leaf.png")
    mask = np.full((8, 8), 255, np.uint8)
    mask[:4] = 0
    Image.fromarray(mask).save(tmp_path / "mask.png")
    (tmp_path / "thing.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd leaf.png\nmap_d mask.png\n")
    model = load(SQUARE)
    assert model.materials[0].alpha_mode == "MASK"
    assert model.images[0].pixels[:, :, 1].tolist() == [[200] * 4] * 4
    assert model.images[0].pixels[0, 0, 3] < 10
    assert model.images[0].pixels[3, 3, 3] > 245


def test_a_missing_or_broken_texture_is_a_checker_and_a_warning(tmp_path: Path, load: Load) -> None:
    (tmp_path / "broken.png").write_bytes(b"\x89PNG\r\n\x1a\nrubbish")
    for name, reason in (("none.png", "does not exist"), ("broken.png", "is not a readable image")):
        (tmp_path / "thing.mtl").write_text(f"newmtl m\nmap_Kd {name}\n")
        warnings: list[str] = []
        model = load(SQUARE, warnings=warnings)
        assert len(warnings) == 1
        assert warnings[0].startswith(f"texture '{name}' is replaced by a checker: ")
        assert reason in warnings[0]
        assert {tuple(color) for color in model.images[0].pixels.reshape(-1, 4)} == {(255, 0, 255, 255), (0, 0, 0, 255)}


@pytest.mark.parametrize(
    "reference", ["../secret.png", "/etc/hostname", "http://localhost/x.png", "file:///etc/hostname"]
)
def test_nothing_outside_the_roots_is_opened(tmp_path: Path, load: Load, reference: str) -> None:
    (tmp_path.parent / "secret.png").write_bytes(b"")
    (tmp_path / "thing.mtl").write_text(f"newmtl m\nmap_Kd {reference}\n")
    warnings: list[str] = []
    model = load(SQUARE, warnings=warnings)
    assert len(warnings) == 1
    assert "replaced by a checker" in warnings[0]
    assert model.images[0].pixels.shape == (64, 64, 4)


def test_paths_of_another_machine_fall_back_to_the_file_name(tmp_path: Path, load: Load) -> None:
    Image.new("RGB", (1, 1), (1, 2, 3)).save(tmp_path / "a.png")
    (tmp_path / "thing.mtl").write_text("newmtl m\nmap_Kd C:\\Users\\me\\a.png\n")
    assert load(SQUARE).images[0].pixels[0, 0].tolist() == [1, 2, 3, 255]


def test_large_textures_are_made_smaller(tmp_path: Path, load: Load) -> None:
    Image.new("RGB", (64, 32)).save(tmp_path / "a.png")
    (tmp_path / "thing.mtl").write_text("newmtl m\nmap_Kd a.png\n")
    assert load(SQUARE, max_texture_size=16).images[0].pixels.shape == (8, 16, 4)


def test_faces_keep_their_materials_and_unknown_ones_are_grey_with_a_warning(tmp_path: Path, load: Load) -> None:
    (tmp_path / "thing.mtl").write_text("newmtl red one\nKd 1 0 0\nnewmtl unused\nnewmtl blue\nKd 0 0 1\n")
    text = (
        "mtllib thing.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nusemtl blue\nf 1 3 4\nusemtl red one\nf 1 2 4\n"
    )
    warnings: list[str] = []
    model = load(text + "usemtl green\nf 2 3 4\n", warnings=warnings)
    colors = [model.materials[index].base_color[:3] for index in model.meshes[0].triangle_material]
    assert colors == [(0.8, 0.8, 0.8), (0, 0, 1), (1, 0, 0), (0.8, 0.8, 0.8)]
    assert len(model.materials) == 3
    assert warnings == ["1 materials are in no material library and are plain grey, the first is 'green'"]


def test_a_missing_library_and_odd_lines_are_warnings(tmp_path: Path, load: Load) -> None:
    warnings: list[str] = []
    load(SQUARE, warnings=warnings)
    assert warnings == [
        "material library 'thing.mtl' is not used: 'thing.mtl' does not exist",
        "no material library was found; 1 materials are plain grey",
    ]
    (tmp_path / "thing.mtl").write_text("newmtl m\nKd red\nNs nan\nbump b.png\n")
    warnings.clear()
    assert load(SQUARE, warnings=warnings).materials[0].base_color == (0.8, 0.8, 0.8, 1.0)
    assert warnings == [
        "'thing.mtl': 2 lines have no usable numbers and were left out, line 2: 'Kd red'",
        "'thing.mtl': not supported and left out: bump",
    ]


def test_texture_options() -> None:
    name, ref = parse_map("-clamp on -bm 1.5 -mm 0 1 -o 0.5 0.25 -s 2 a b.png")
    assert name == "a b.png"
    assert (ref.wrap_s, ref.wrap_t, ref.scale) == ("clamp", "clamp", (2, 1))
    # For any v up: 1 - (s v + o) must be scale * (1 - v) + offset.
    v = 0.3
    assert ref.scale[1] * (1 - v) + ref.offset[1] == pytest.approx(1 - (v * 1 + 0.25))
