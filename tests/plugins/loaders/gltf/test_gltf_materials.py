"""Materials, textures and images."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from PIL import Image

from phrt.errors import AssetError
from phrt.model import TextureRef
from phrt_plugins.loaders import gltf_images
from phrt_plugins.loaders.gltf_images import placeholder


def read(build, load, material: dict):
    build.add("materials", material)
    return load(build.write())[0].materials[0]


def test_defaults_are_gltfs(build, load):
    material = read(build, load, {})
    assert (material.base_color, material.metallic, material.roughness) == ((1, 1, 1, 1), 1, 1)
    assert (material.ior, material.specular, material.transmission, material.thickness) == (1.5, 1, 0, 0)
    assert material.attenuation_distance == math.inf
    assert (material.alpha_mode, material.alpha_cutoff) == ("OPAQUE", 0.5)
    assert not material.double_sided


def test_extensions(build, load):
    material = read(
        build,
        load,
        {
            "emissiveFactor": [1, 0.5, 0],
            "extensions": {
                "KHR_materials_emissive_strength": {"emissiveStrength": 4},
                "KHR_materials_ior": {"ior": 1.33},
                "KHR_materials_specular": {"specularFactor": 0.25},
                "KHR_materials_transmission": {"transmissionFactor": 0.75},
                "KHR_materials_volume": {
                    "thicknessFactor": 2,
                    "attenuationDistance": 3,
                    "attenuationColor": [0.1, 0.2, 0.3],
                },
                "KHR_materials_unlit": {},
            },
        },
    )
    assert material.emissive == (4, 2, 0)
    assert (material.ior, material.specular, material.transmission) == (1.33, 0.25, 0.75)
    assert (material.thickness, material.attenuation_distance) == (2, 3)
    assert material.attenuation_color == (0.1, 0.2, 0.3)
    assert material.unlit


def test_specular_textures_are_a_warning(build, load):
    specular = {"specularTexture": {"index": 0}, "specularColorFactor": [1, 0, 0]}
    build.add("materials", {"extensions": {"KHR_materials_specular": specular}})
    warnings = load(build.write())[1]
    assert any("specularTexture is not shaded" in warning for warning in warnings)
    assert any("colour is not shaded" in warning for warning in warnings)


def test_sampler_and_transform(build, load):
    sampler = build.add("samplers", {"wrapS": 33071, "wrapT": 33648, "magFilter": 9728, "minFilter": 9729})
    info = {
        "index": build.image(sampler=sampler),
        "texCoord": 0,
        "extensions": {
            "KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.3, "scale": [4, 5], "texCoord": 1}
        },
    }
    material = read(build, load, {"pbrMetallicRoughness": {"baseColorTexture": info}})
    assert material.base_color_texture == TextureRef(
        image=0,
        uv_set=1,
        wrap_s="clamp",
        wrap_t="mirror",
        nearest=True,
        mipmaps=False,
        offset=(0.1, 0.2),
        rotation=0.3,
        scale=(4, 5),
    )


def test_all_slots_and_one_image_for_many(build, load):
    first, second = build.image(), build.image()
    material = read(
        build,
        load,
        {
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": first},
                "metallicRoughnessTexture": {"index": second},
            },
            "normalTexture": {"index": first, "scale": 0.5},
            "occlusionTexture": {"index": second, "strength": 0.25},
            "emissiveTexture": {"index": first},
            "extensions": {"KHR_materials_transmission": {"transmissionTexture": {"index": second}}},
        },
    )
    slots = ("base_color", "metallic_roughness", "normal", "occlusion", "emissive", "transmission")
    assert [getattr(material, f"{slot}_texture").image for slot in slots] == [0, 1, 0, 1, 0, 1]
    assert (material.normal_scale, material.occlusion_strength) == (0.5, 0.25)


def test_third_uv_set_leaves_the_texture_out(build, load):
    build.add("materials", {"normalTexture": {"index": build.image(), "texCoord": 2}})
    model, warnings = load(build.write())
    assert model.materials[0].normal_texture is None
    assert "TEXCOORD_2" in warnings[0]


@pytest.mark.parametrize(
    ("material", "reason"),
    [
        ({"alphaMode": "GLASS"}, "materials[0].alphaMode: is 'GLASS'; it must be OPAQUE, MASK or BLEND"),
        ({"alphaMode": 1}, "materials[0].alphaMode: must be a string"),
        ({"alphaCutoff": "high"}, "materials[0].alphaCutoff: must be a number, not a string"),
        ({"doubleSided": 1}, "materials[0].doubleSided: must be true or false"),
        ({"emissiveFactor": [1, 1]}, "materials[0].emissiveFactor: has 2 numbers; it must have 3"),
        ({"emissiveFactor": [1, 1, None]}, "materials[0].emissiveFactor[2]: must be a number, not null"),
        ({"pbrMetallicRoughness": {"metallicFactor": 2}}, "pbrMetallicRoughness.metallicFactor: is 2"),
        ({"pbrMetallicRoughness": {"baseColorTexture": {"index": 5}}}, "baseColorTexture.index: points at textures[5]"),
        ({"pbrMetallicRoughness": {"baseColorTexture": {}}}, "baseColorTexture: has no 'index'"),
        ({"extensions": []}, "materials[0].extensions: must be an object"),
    ],
)
def test_what_a_material_may_not_say(build, load, material, reason):
    build.add("materials", material)
    with pytest.raises(AssetError) as error:
        load(build.write())
    assert reason in str(error.value)


# Images


NOISE = Image.fromarray(np.random.default_rng(1).integers(0, 256, (64, 64), np.uint8))


def encoded(image: Image.Image, kind: str) -> bytes:
    stream = io.BytesIO()
    image.save(stream, kind, **({"lossless": True} if kind == "WEBP" else {}))
    return stream.getvalue()


def textured(build, load, data: bytes, **options):
    """Load a file with an embedded image of `data` -> its pixels and the warnings."""
    build.view(b"other data")
    source = build.add("images", {"bufferView": build.view(data), "name": "paint"})
    texture = build.add("textures", {"source": source})
    build.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}})
    model, warnings = load(build.write(), **options)
    return model.images[0].pixels, warnings


def test_pixels_row_0_is_the_top(build, load):
    pixels = np.zeros((2, 3, 3), np.uint8)
    pixels[0, 0] = (10, 20, 30)
    result, _ = textured(build, load, encoded(Image.fromarray(pixels), "PNG"))
    assert result.shape == (2, 3, 4)
    assert result[0, 0].tolist() == [10, 20, 30, 255]


@pytest.mark.parametrize(
    ("image", "expected"),
    [
        (Image.new("L", (1, 1), 100), [100, 100, 100, 255]),
        (Image.new("LA", (1, 1), (100, 50)), [100, 100, 100, 50]),
        (Image.new("RGBA", (1, 1), (1, 2, 3, 4)), [1, 2, 3, 4]),
        (Image.new("P", (1, 1)), [0, 0, 0, 255]),
        (Image.new("1", (1, 1), 1), [255, 255, 255, 255]),
        (Image.new("I;16", (1, 1), 0x80FF), [128, 128, 128, 255]),
    ],
)
def test_every_mode_becomes_rgba(build, load, image, expected):
    pixels, warnings = textured(build, load, encoded(image, "PNG"))
    assert pixels[0, 0].tolist() == expected
    assert "placeholder" not in "".join(warnings)


def test_webp_comes_before_its_fallback(build, load):
    webp = build.add("images", {"bufferView": build.view(encoded(Image.new("RGB", (2, 2), (9, 8, 7)), "WEBP"))})
    texture = build.image(extensions={"EXT_texture_webp": {"source": webp}})
    build.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}})
    model, _ = load(build.write())
    assert model.images[0].pixels[0, 0].tolist() == [9, 8, 7, 255]


def test_texture_in_an_unknown_format_gets_a_placeholder(build, load):
    texture = build.add("textures", {"extensions": {"KHR_texture_basisu": {"source": 0}}})
    build.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}})
    model, warnings = load(build.write())
    assert (model.images[0].pixels == placeholder()).all()
    assert "KHR_texture_basisu, which is not supported; a placeholder is shown" in warnings[0]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "is empty"),
        (b"GIF89a" + bytes(40), "is not a readable PNG, JPEG or WebP image"),
        (encoded(NOISE, "PNG")[:-900], "is broken"),
        (encoded(NOISE, "JPEG")[:400], "is broken"),
    ],
    ids=["empty", "gif", "truncated png", "truncated jpeg"],
)
def test_broken_image_is_a_warning_and_a_checker(build, load, data, reason):
    pixels, warnings = textured(build, load, data)
    assert (pixels == placeholder()).all()
    assert pixels[0, 0].tolist() == [255, 0, 255, 255]
    assert pixels[0, 8].tolist() == [0, 0, 0, 255]
    assert f"image 'paint' {reason}" in "".join(warnings)


@pytest.mark.parametrize("uri", ["missing.png", "sub/missing.png", "data:image/png;base64,@@"])
def test_missing_image_is_a_warning_and_a_checker(build, load, uri):
    texture = build.add("textures", {"source": build.add("images", {"uri": uri})})
    build.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}})
    model, warnings = load(build.write())
    assert (model.images[0].pixels == placeholder()).all()
    assert "a placeholder is shown" in "".join(warnings)


def test_image_beside_the_file(build, load, tmp_path):
    (tmp_path / "wood grain.jpg").write_bytes(encoded(Image.new("RGB", (4, 4), (200, 0, 0)), "JPEG"))
    texture = build.add("textures", {"source": build.add("images", {"uri": "wood%20grain.jpg"})})
    build.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}})
    model, warnings = load(build.write())
    assert model.images[0].pixels.shape == (4, 4, 4)
    assert "placeholder" not in "".join(warnings)


def png_header(width: int, height: int) -> bytes:
    """A PNG of one colour whose header says another size."""
    data = bytearray(encoded(Image.new("L", (1, 1)), "PNG"))
    data[16:24] = width.to_bytes(4, "big") + height.to_bytes(4, "big")
    import zlib

    data[29:33] = zlib.crc32(bytes(data[12:29])).to_bytes(4, "big")
    return bytes(data)


@pytest.mark.parametrize(
    ("size", "reason"),
    [
        ((0, 4), "zero width or height"),
        ((4, 0), "zero width or height"),
        ((8193, 8193), "has 8193 x 8193 pixels; at most 67,108,864 are read"),
        ((100_000, 100_000), "is too large an image"),
    ],
)
def test_image_sizes_that_are_errors(build, load, size, reason):
    with pytest.raises(AssetError, match=r"made\.gltf: images\[0\]") as error:
        textured(build, load, png_header(*size))
    assert reason in str(error.value)


def test_all_images_together_are_limited(build, load, monkeypatch):
    monkeypatch.setattr(gltf_images, "Budget", lambda: gltf_images_budget(4 * 64 * 64))
    with pytest.raises(AssetError, match="a smaller 'max_texture_size' makes the textures fit"):
        textured(build, load, encoded(Image.new("RGB", (65, 64)), "PNG"))


def gltf_images_budget(limit: int):
    from phrt_plugins.loaders.gltf_accessors import Budget

    return Budget(limit)


@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
def test_max_texture_size(build, load, kind):
    pixels, _ = textured(build, load, encoded(Image.new("RGB", (100, 40), (10, 20, 30)), kind), max_texture_size=50)
    assert pixels.shape == (20, 50, 4)


def test_only_images_in_use_are_decoded(build, load):
    build.image()
    build.draw(build.quad())
    assert load(build.write())[0].images == []
