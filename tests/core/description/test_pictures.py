"""HDR domes and textures: exact values, and every way a picture file can be wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from phrt.description.pictures import MAX_PIXELS, read_dome, read_radiance
from phrt.errors import AssetError, SceneError
from phrt.loading import load_scene
from phrt.scene import Scene

HEADER = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n"
Write = Callable[..., Path]


def flat_hdr(rgbe: np.ndarray) -> bytes:
    height, width = rgbe.shape[:2]
    return HEADER + f"-Y {height} +X {width}\n".encode() + rgbe.astype(np.uint8).tobytes()


def packed_hdr(rgbe: np.ndarray) -> bytes:
    """Run-length encoded: runs where four or more bytes are equal, else literals of up to 100."""
    height, width = rgbe.shape[:2]
    out = HEADER + f"-Y {height} +X {width}\n".encode()
    for row in rgbe.astype(np.uint8):
        out += bytes([2, 2, width >> 8, width & 255])
        for channel in row.T:
            place = 0
            while place < width:
                run = 1
                while place + run < width and run < 127 and channel[place + run] == channel[place]:
                    run += 1
                if run >= 4:
                    out += bytes([128 + run, int(channel[place])])
                else:
                    run = min(run, 100)
                    out += bytes([run]) + channel[place : place + run].tobytes()
                place += run
    return out


@pytest.fixture
def rgbe() -> np.ndarray:
    values = np.random.default_rng(5).integers(0, 256, (6, 40, 4))
    values[..., 3] = np.where(values[..., 3] > 40, 128 + values[..., 3] % 8, 0)
    values[2, 5:30] = (10, 20, 30, 129)
    return values


def expected(rgbe: np.ndarray) -> np.ndarray:
    scale = np.where(rgbe[..., 3:] > 0, 2.0 ** (rgbe[..., 3:] - 136.0), 0.0)
    return (rgbe[..., :3] + 0.5) * scale


def test_flat_and_packed_radiance_files_hold_the_same_values(tmp_path: Path, rgbe: np.ndarray) -> None:
    for name, data in (("flat.hdr", flat_hdr(rgbe)), ("packed.hdr", packed_hdr(rgbe))):
        (tmp_path / name).write_bytes(data)
        pixels = read_radiance(tmp_path / name)
        assert pixels.dtype == np.float32
        assert pixels == pytest.approx(expected(rgbe), rel=1e-6)


def test_exr_files_are_read_as_they_are(tmp_path: Path) -> None:
    import OpenEXR

    pixels = np.random.default_rng(1).random((4, 8, 3)).astype(np.float32) * 100
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": pixels}) as file:
        file.write(str(tmp_path / "sky.exr"))
    assert np.array_equal(read_dome(tmp_path / "sky.exr"), pixels)


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"", "is not a Radiance"),
        (b"\x89PNG", "is not a Radiance"),
        (b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n\0\0\0\0", "only FORMAT=32-bit_rle_rgbe"),
        (HEADER + b"-Y 0 +X 9\n", "0 pixels|9 x 0"),
        (HEADER + b"-Y 99999 +X 99999\n", f"at most|{MAX_PIXELS}"),
        (HEADER + b"-Y 4 +X 4\n\0\0\0", "broken or ends early"),
        (HEADER + b"-Y 1 +X 10\n\2\2\0\x0a\xff", "broken or ends early"),
        (HEADER + b"-Y 1 +X 10\n\2\2\0\x0a" + b"\xff\1" * 4, "broken or ends early"),
        (HEADER + b"-Y 1 +X 10\n\2\2\0\x0a" + b"\0" * 50, "broken or ends early"),
    ],
)
def test_broken_radiance_files_are_asset_errors(tmp_path: Path, data: bytes, told: str) -> None:
    path = tmp_path / "sky.hdr"
    path.write_bytes(data)
    with pytest.raises(AssetError, match=told):
        read_dome(path)


def test_a_truncated_packed_file_is_an_asset_error_wherever_it_ends(tmp_path: Path, rgbe: np.ndarray) -> None:
    data = packed_hdr(rgbe)
    path = tmp_path / "sky.hdr"
    for end in range(0, len(data) - 1, 17):
        path.write_bytes(data[:end])
        with pytest.raises(AssetError):
            read_dome(path)


def test_a_broken_exr_and_another_suffix_are_asset_errors(tmp_path: Path) -> None:
    (tmp_path / "sky.exr").write_bytes(b"nothing")
    with pytest.raises(AssetError, match="is not an OpenEXR file"):
        read_dome(tmp_path / "sky.exr")
    (tmp_path / "sky.png").write_bytes(b"nothing")
    with pytest.raises(AssetError, match=r"ending in \.hdr or \.exr"):
        read_dome(tmp_path / "sky.png")


def test_a_dome_light_reads_its_picture(tmp_path: Path, rgbe: np.ndarray, load: Callable[..., Scene]) -> None:
    (tmp_path / "sky.hdr").write_bytes(flat_hdr(rgbe))
    scene = load("prims:\n  D: {type: DomeLight, asset: sky.hdr, intensity: 2, color: [1, .5, 0], rotation: 90}\n")
    assert scene.dome.pixels is not None
    assert scene.dome.pixels == pytest.approx(expected(rgbe), rel=1e-6)
    assert scene.dome.color == (2, 1, 0)
    assert scene.dome.rotation == pytest.approx(np.pi / 2)


def test_the_real_sky_is_read(assets: Path) -> None:
    pixels = read_dome(assets / "hdri" / "brown_photostudio_02_1k.hdr")
    assert pixels.shape == (512, 1024, 3)
    assert pixels.max() > 50
    assert 0.1 < float(pixels.mean()) < 10


def test_a_broken_dome_and_a_broken_texture_name_the_line(write: Write) -> None:
    write("nothing", "sky.hdr")
    write("nothing", "wood.png")
    path = write(
        "prims:\n  D: {type: DomeLight, asset: sky.hdr}\n  M: {type: Material, base_color_texture: {asset: wood.png}}\n"
    )
    with pytest.raises(SceneError, match=r"scene.yaml:3: /M: .*wood.png: is not a picture"):
        load_scene(path)
    path.write_text(path.read_text().replace(", base_color_texture: {asset: wood.png}", ""))
    with pytest.raises(SceneError, match=r"scene.yaml:2: /D: .*sky.hdr: is not a Radiance"):
        load_scene(path)


def test_a_texture_file_and_a_checker_become_images(write: Write, tmp_path: Path) -> None:
    from PIL import Image

    Image.new("RGB", (4, 2), (255, 128, 0)).save(tmp_path / "wood.png")
    scene = load_scene(
        write(
            "prims:\n"
            "  A: {type: Material, base_color_texture: {asset: wood.png, scale: [2, 3], wrap: mirror}}\n"
            "  B: {type: Material, base_color_texture: {asset: wood.png, rotation: 90}}\n"
            "  C: {type: Material, base_color_texture: {checker: [1, [0, 0, 0]]}}\n"
        )
    )
    refs = [material.base_color_texture for material in scene.materials]
    assert [ref.image for ref in refs if ref] == [0, 0, 1]
    assert refs[0] is not None
    assert (refs[0].scale, refs[0].wrap_s) == ((2, 3), "mirror")
    assert scene.images[0].pixels.shape == (2, 4, 4)
    checker = scene.images[1].pixels
    assert checker[0, 0].tolist() == checker[-1, -1].tolist() == [255, 255, 255, 255]
    assert checker[0, -1].tolist() == checker[-1, 0].tolist() == [0, 0, 0, 255]
