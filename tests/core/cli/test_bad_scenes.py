"""Scenes that are wrong, odd or empty, through `phrt render`: errors name the place, pictures hold no NaN."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import needs
import numpy as np
import pytest
from cli_kit import Outcome, render, render_text

from phrt.registry import get_registry

CAMERA = "  Cam: {type: Camera, look_at: {eye: [0, 0, 3], target: [0, 0, 0]}}\n"
SUN = "  Sun: {type: DistantLight}\n"
SKY = "  Sky: {type: DomeLight}\n"
TRIANGLE = "v -1 -1 0\nv 1 -1 0\nv 0 1 0\n"


@pytest.fixture(autouse=True)
def no_asset_folders(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PHRT_ASSETS", raising=False)


def png(width: int, height: int, pixels: bytes = b"") -> bytes:
    """A PNG file whose header says that it has `width` x `height` RGBA pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(pixels)) + chunk(b"IEND", b"")


def one_error(done: Outcome) -> str:
    """The message of a run that ended in exactly one error."""
    assert done.code == 2, done.said
    assert len(done.errors) == 1, done.said
    assert "Traceback" not in done.said
    assert done.channels == {}
    return done.errors[0].removeprefix("error: ")


def textured(folder: Path, asset: str) -> Outcome:
    material = f'  Paint: {{type: Material, unlit: true, base_color_texture: {{asset: "{asset}"}}}}\n'
    box = "  Wall: {type: Box, size: [4, 4, 1], material: /Paint}\n"
    return render_text(folder, "prims:\n" + material + box + CAMERA)


# Textures


def magenta_and_black(done: Outcome) -> bool:
    """Are there magenta pixels, black ones, and but few others (edges between them)?"""
    red, green, blue = np.moveaxis(done.image, 2, 0)
    magenta = (red > 0.9) & (blue > 0.9) & (green < 0.02)
    black = done.image.max(axis=2) < 0.02
    return bool(magenta.mean() > 0.1 and black.mean() > 0.1 and (magenta | black).mean() > 0.8)


def test_a_missing_texture_is_a_warning_and_a_magenta_checker_in_the_picture(tmp_path: Path) -> None:
    done = textured(tmp_path, "nowhere.png")
    assert done.code == 0
    (warning,) = done.warnings
    assert warning.startswith(f"warning: {tmp_path}/scene.yaml:2: /Paint: 'nowhere.png' was not found; looked in: ")
    assert warning.endswith("; a magenta checker is shown")
    assert magenta_and_black(done)


def test_a_texture_that_is_there_is_no_checker(tmp_path: Path) -> None:
    (tmp_path / "green.png").write_bytes(png(2, 2, (b"\0" + bytes([0, 255, 0, 255]) * 2) * 2))
    done = textured(tmp_path, "green.png")
    assert (done.code, done.warnings) == (0, [])
    assert done.image[18, 32] == pytest.approx([0, 1, 0], abs=1e-3)


def test_a_missing_texture_of_an_obj_is_a_warning_and_a_checker_too(tmp_path: Path) -> None:
    (tmp_path / "wall.mtl").write_text("newmtl paint\nmap_Kd nowhere.png\n")
    corners = "vt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    (tmp_path / "wall.obj").write_text("mtllib wall.mtl\nusemtl paint\n" + TRIANGLE + corners)
    done = render(tmp_path / "wall.obj", tmp_path / "picture.exr")
    assert done.code == 0
    (warning,) = done.warnings
    assert "texture 'nowhere.png' is replaced by a checker" in warning
    red, green = done.channels["R"], done.channels["G"]
    # Magenta reflects red but nearly no green; the sky behind is neutral.
    assert (red > 3 * green).sum() > 20


@pytest.mark.parametrize(
    ("name", "data", "told"),
    [
        ("zero.png", png(0, 0), "is not a picture that can be read"),
        ("flat.png", png(64, 0), "is not a picture that can be read"),
        ("bomb.png", png(30_000, 30_000, bytes(1000)), "far too many pixels; at most 33554432 are read"),
        ("large.png", png(9_000, 9_000, bytes(1000)), "9000 x 9000 pixels; at most 33554432 are read"),
        ("cut.png", png(64, 64, bytes(100)), "is not a picture that can be read"),
        ("noise.png", bytes(range(256)) * 8, "is not a picture that can be read"),
        ("empty.png", b"", "is not a picture that can be read"),
        ("drawing.svg", b"<svg xmlns='http://www.w3.org/2000/svg'/>", "is not a picture that can be read"),
    ],
)
def test_a_broken_texture_names_scene_line_prim_and_file(tmp_path: Path, name: str, data: bytes, told: str) -> None:
    (tmp_path / name).write_bytes(data)
    message = one_error(textured(tmp_path, name))
    assert message.startswith(f"{tmp_path}/scene.yaml:2: /Paint: {tmp_path}/{name}: ")
    assert told in message


@pytest.mark.parametrize(
    ("asset", "told"),
    [
        ("../secret.png", "'../secret.png' leaves the asset roots; files must lie inside one of: {roots}"),
        ("/etc/hostname", "'/etc/hostname' leaves the asset roots; files must lie inside one of: {roots}"),
        ("link.png", "'link.png' leaves the asset roots; files must lie inside one of: {roots}"),
        ("sub/../../secret.png", "'sub/../../secret.png' leaves the asset roots"),
        ("http://example.com/a.png", "'http://example.com/a.png' is an address; only names of files are read"),
        ("file:///etc/hostname", "'file:///etc/hostname' is an address; only names of files are read"),
        ("data:image/png;base64,AAAA", "'data:image/png;base64,AAAA' is an address; only names of files are read"),
    ],
)
def test_a_texture_outside_the_roots_is_an_error(tmp_path: Path, asset: str, told: str) -> None:
    folder = tmp_path / "scenes"
    folder.mkdir()
    (tmp_path / "secret.png").write_bytes(png(1, 1, bytes(5)))
    (folder / "link.png").symlink_to(tmp_path / "secret.png")
    message = one_error(textured(folder, asset))
    assert message.startswith(f"{folder}/scene.yaml:2: /Paint: ")
    assert told.format(roots=folder) in message


def test_textures_are_limited_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("phrt.description.build.MAX_TEXTURE_BYTES", 100)
    text = "prims:\n"
    for number in range(3):
        (tmp_path / f"{number}.png").write_bytes(png(5, 5, bytes(105)))
        text += f"  M{number}: {{type: Material, base_color_texture: {{asset: {number}.png}}}}\n"
    message = one_error(render_text(tmp_path, text))
    assert message == f"{tmp_path}/scene.yaml:4: /M2: the scene's textures have more than 100 bytes together"


def test_textures_of_an_obj_are_limited_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("phrt_plugins.loaders.mesh_mtl.MAX_TEXTURE_BYTES", 100)
    library = text = ""
    for number in range(3):
        (tmp_path / f"{number}.png").write_bytes(png(5, 5, bytes(105)))
        library += f"newmtl m{number}\nmap_Kd {number}.png\n"
        text += f"usemtl m{number}\nf 1/1 2/2 3/3\n"
    (tmp_path / "wall.mtl").write_text(library)
    (tmp_path / "wall.obj").write_text(f"mtllib wall.mtl\n{TRIANGLE}vt 0 0\nvt 1 0\nvt 0 1\n{text}")
    done = render(tmp_path / "wall.obj", tmp_path / "picture.exr")
    assert done.code == 0
    (warning,) = done.warnings
    assert "texture '2.png' is replaced by a checker: those before it have more than 100 bytes" in warning


def test_percent_signs_in_a_name_are_no_way_out(tmp_path: Path) -> None:
    (tmp_path / "secret.png").write_bytes(png(1, 1, bytes([0, 0, 255, 0, 255])))
    folder = tmp_path / "scenes"
    folder.mkdir()
    done = textured(folder, "%2e%2e/secret.png")
    assert "'%2e%2e/secret.png' was not found" in done.warnings[0]
    assert magenta_and_black(done)


def test_a_broken_material_is_told_once_and_not_again_where_it_is_used(tmp_path: Path) -> None:
    text = "prims:\n  Paint: {type: Material, roughness: 2}\n  Ball: {type: Sphere, material: /Paint}\n"
    message = one_error(render_text(tmp_path, text))
    assert message.startswith(f"{tmp_path}/scene.yaml:2: /Paint: roughness: given 2")


# Files that are not what their suffix says

NOISE = bytes(range(256)) * 16


@pytest.mark.parametrize("suffix", ["gltf", "glb", "obj", "ply", "stl", "yaml", "yml", "json"])
@pytest.mark.parametrize("content", ["empty", "noise", "zeros", "utf-16"])
def test_garbage_under_every_suffix_is_one_error_that_names_the_file(tmp_path: Path, suffix: str, content: str) -> None:
    data = {"empty": b"", "noise": NOISE, "zeros": bytes(5000), "utf-16": "hello".encode("utf-16")}[content]
    path = tmp_path / f"garbage.{suffix}"
    path.write_bytes(data)
    message = one_error(render(path, tmp_path / "picture.exr"))
    assert f"garbage.{suffix}" in message
    assert "internal" not in message


@pytest.mark.parametrize("suffix", ["gltf", "glb", "obj", "ply", "stl", "yaml", "xyz"])
def test_a_folder_instead_of_a_file(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"folder.{suffix}"
    path.mkdir()
    assert one_error(render(path, tmp_path / "picture.exr")) == f"{path}: is not a file"


@pytest.mark.parametrize("suffix", ["gltf", "glb", "obj", "ply", "stl", "yaml"])
def test_a_file_that_may_not_be_read(tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / f"locked.{suffix}"
    path.write_text("nothing")
    refuse_to_open(path, monkeypatch)
    message = one_error(render(path, tmp_path / "picture.exr"))
    assert f"locked.{suffix}" in message
    assert "Permission denied" in message


def refuse_to_open(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Opening `path` raises PermissionError, for root too."""
    import builtins
    import io

    honest = io.open

    def opened(file: object, *arguments: object, **options: object) -> object:
        if str(file) == str(path):
            raise PermissionError(13, "Permission denied", str(file))
        return honest(file, *arguments, **options)  # type: ignore[call-overload]

    monkeypatch.setattr(builtins, "open", opened)
    monkeypatch.setattr(io, "open", opened)


def test_a_name_that_is_too_long(tmp_path: Path) -> None:
    message = one_error(render(tmp_path / f"{'x' * 300}.yaml", tmp_path / "picture.exr"))
    assert message.endswith(".yaml: cannot be read: File name too long")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("- 1\n", "scene.yaml:1: a scene is a mapping with phrt, name, sublayers, prims"),
        ("prims:\n  A: {type: Spere}\n", "scene.yaml:2: /A: type: given 'Spere'; allowed: Xform, "),
        ("prims:\n  A: {type: Sphere, radius: wide}\n", "scene.yaml:2: /A: radius: given 'wide'; wanted a number"),
        ("prims:\n  A: {type: Sphere, radius: .nan}\n", "/A: radius: given nan; wanted a finite number"),
        ("prims:\n  A: {type: Sphere, radius: 1e39}\n", "/A: radius: given 1e+39; at most 1e+18 in size"),
        ("prims:\n  A: {type: Sphere, size: 1}\n", "/A: unknown key 'size'; allowed: "),
        ("prims:\n  A: {type: Sphere, material: /Tin}\n", "/A: material: there is no /Tin; allowed: none is described"),
        ("prims:\n  A: {type: Reference, asset: gone.glb}\n", "/A: 'gone.glb' was not found; looked in: "),
        ("prims:\n  A: {type: Reference, asset: scene.yaml}\n", "cycle"),
        (
            "prims:\n  A: {type: Reference, loader: atriun}\n",
            "/A: there is no loader 'atriun'. Known: atrium, gltf, mesh, simplified. ",
        ),
        (
            "prims:\n  A: {type: Reference, loader: gltf}\n",
            "loader 'gltf' reads files; give asset, ending in .gltf or .glb",
        ),
        ("sublayers: [scene.yaml]\n", "scene.yaml:1: the sublayers form a cycle: scene.yaml -> scene.yaml"),
        ("prims: " + "{a: " * 100 + "1" + "}" * 100 + "\n", "scene.yaml:1: nested more than 64 levels deep"),
        ("[" * 100_000, "scene.yaml:1: nested more than 64 levels deep"),
        ("prims:\n  A: {type: Sphere\n", "not valid YAML"),
        ("prims: !!python/object/apply:os.getcwd []\n", "is not allowed; scene files are plain data"),
    ],
)
def test_a_wrong_description_names_line_prim_and_what_is_allowed(tmp_path: Path, text: str, told: str) -> None:
    assert told in one_error(render_text(tmp_path, text))


def test_a_scene_description_takes_no_loader(tmp_path: Path) -> None:
    (tmp_path / "other.yaml").write_text("prims: {}\n")
    message = one_error(render_text(tmp_path, "prims:\n  A: {type: Reference, asset: other.yaml, loader: mesh}\n"))
    told = "/A: loader: 'other.yaml' is a scene description, which no loader reads; leave it out"
    assert message == f"{tmp_path}/scene.yaml:2: {told}"


def test_transforms_that_multiply_beyond_all_numbers_name_the_object(tmp_path: Path) -> None:
    nested = "{type: Xform, xform: {scale: 1e15}, children: {B: {type: Sphere, xform: {scale: 1e15}}}}"
    message = one_error(render_text(tmp_path, f"prims:\n  A: {nested}\n"))
    assert message == (f"{tmp_path}/scene.yaml: /A/B: its transforms together place or scale it beyond 1e+18 m")


# Scenes with little in them


@pytest.mark.parametrize("prims", ["", CAMERA, SUN, SKY, CAMERA + SKY, "  A: {type: Xform}\n"])
def test_an_empty_scene_is_its_background_and_a_warning(tmp_path: Path, prims: str) -> None:
    done = render_text(tmp_path, "prims:\n" + prims)
    assert done.code == 0
    told = "has nothing to draw; the picture shows the background only"
    assert done.warnings == [f"warning: {tmp_path}/scene.yaml: {told}"]
    assert done.image == pytest.approx(1.0 if SKY in prims else 0.0)


@pytest.mark.parametrize("light", ["", "  Off: {type: DistantLight, intensity: 0}\n"])
def test_a_scene_without_light_is_black_and_says_so(tmp_path: Path, light: str) -> None:
    done = render_text(tmp_path, "prims:\n  Ball: {type: Sphere}\n" + CAMERA + light)
    assert done.code == 0
    told = "has no light, and nothing in it glows; the picture is black"
    assert done.warnings == [f"warning: {tmp_path}/scene.yaml: {told}"]
    assert done.image.max() == 0


@pytest.mark.parametrize("glow", ["emissive: [1, 0, 0]", "unlit: true"])
def test_a_scene_that_glows_needs_no_light(tmp_path: Path, glow: str) -> None:
    material = f"  Glow: {{type: Material, {glow}}}\n"
    done = render_text(tmp_path, "prims:\n  Ball: {type: Sphere, material: /Glow}\n" + material + CAMERA)
    assert (done.code, done.warnings) == (0, [])
    assert done.image[18, 32, 0] > 0.5


@pytest.mark.parametrize("scale", ["0", "[0, 0, 1]", "1e-18"])
def test_what_is_scaled_to_nothing_is_told(tmp_path: Path, scale: str) -> None:
    text = f"prims:\n  Dot: {{type: Sphere, xform: {{scale: {scale}}}}}\n" + CAMERA + SKY
    done = render_text(tmp_path, text)
    assert done.code == 0
    assert done.warnings == [f"warning: {tmp_path}/scene.yaml: /Dot: no larger than 1e-12 m, and not seen"]
    assert done.finite


def test_what_grows_from_nothing_is_not_told(tmp_path: Path) -> None:
    keys = "animation: {keys: [{time: 0, scale: 0}, {time: 1, scale: 1}]}"
    text = f"prims:\n  Seed: {{type: Xform, xform: {{{keys}}}, children: {{Ball: {{type: Sphere}}}}}}\n" + CAMERA + SUN
    first, last = render_text(tmp_path, text, "--time", "0"), render_text(tmp_path, text, "--time", "1")
    assert (first.code, first.warnings, last.code) == (0, [], 0)
    assert first.finite
    assert last.finite
    assert first.image.max() == 0
    assert last.image[18, 32].min() > 0.1


# Scenes at the edges

ODD = {
    "behind the camera": "  Ball: {type: Sphere, xform: {translate: [0, 0, 50]}}\n" + CAMERA + SKY,
    "camera inside an object": "  Ball: {type: Sphere, radius: 10}\n" + CAMERA + SUN,
    "camera inside glass": "  Glass: {type: Material, transmission: 1, roughness: 0, thickness: 1}\n"
    "  Ball: {type: Sphere, radius: 10, material: /Glass}\n" + CAMERA + SKY,
    "camera on a surface": "  Wall: {type: Box, size: [1, 1, 6]}\n" + CAMERA + SKY,
    "glass that bends nothing": "  Glass: {type: Material, transmission: 1, ior: 1, roughness: 0, thickness: 1}\n"
    "  Ball: {type: Sphere, material: /Glass}\n" + CAMERA + SKY,
    "flattened": "  Disc: {type: Sphere, xform: {scale: [1, 1, 0]}}\n" + CAMERA + SKY,
    "mirrored": "  Ball: {type: Sphere, xform: {scale: [-1, 1, 1]}}\n" + CAMERA + SUN,
    "light inside the ball": "  Ball: {type: Sphere}\n  Lamp: {type: SphereLight, radius: 0.1}\n" + CAMERA,
    "light on the surface": "  Ball: {type: Sphere}\n"
    "  Lamp: {type: SphereLight, xform: {translate: [0, 0, 1]}}\n" + CAMERA,
    "light without a size": "  Ball: {type: Sphere}\n  Lamp: {type: RectLight, xform: {scale: 0}}\n" + CAMERA,
    "camera without a size": "  Ball: {type: Sphere, xform: {translate: [0, 0, -3]}}\n"
    "  Cam: {type: Camera, xform: {scale: 0}}\n" + SUN,
    "very bright": "  Ball: {type: Sphere}\n  Sky: {type: DomeLight, intensity: 1e17}\n" + CAMERA,
    "one triangle": "  Tri: {type: Mesh, points: [[-1, -1, 0], [1, -1, 0], [0, 1, 0]], faces: [[0, 1, 2]]}\n" + SKY,
    "some triangles are lines": "  Tri: {type: Mesh, points: [[-1, -1, 0], [1, -1, 0], [0, 1, 0]], "
    "faces: [[0, 1, 2], [0, 0, 1], [2, 2, 2]]}\n" + SKY,
    "all triangles are lines": "  Tri: {type: Mesh, points: [[0, 0, 0], [1, 0, 0], [2, 0, 0]], "
    "faces: [[0, 1, 2], [0, 0, 1]]}\n" + CAMERA + SKY,
    "all triangles are points": "  Tri: {type: Mesh, points: [[0, 0, 0]], faces: [[0, 0, 0]]}\n" + CAMERA + SKY,
    "a million metres away": "  Ball: {type: Sphere, xform: {translate: [1e6, 1e6, 1e6]}}\n" + SUN,
    "a million metres large": "  Ball: {type: Sphere, radius: 1e6}\n" + SUN,
    "as large as it may be": "  Ball: {type: Sphere, radius: 1e17}\n" + SKY + SUN,
    "a tenth of a millimetre": "  Ball: {type: Sphere, radius: 1e-4}\n" + SUN,
    "a nanometre": "  Ball: {type: Sphere, radius: 1e-9}\n" + SUN,
}


CHEAP = ("shadows.fallback=shadow_map", "reflections.fallback=probe", "refractions.fallback=probe")
WAYS = {
    "raycast": ("--gbuffer", "raycast"),
    "moderngl": ("--gbuffer", "moderngl"),
    "open3d": ("--tracer", "open3d"),
    "numpy": ("--tracer", "numpy"),
    "soft": ("--effect", "shadows.samples=4", "--effect", "ambient_occlusion.samples=4", "--aa", "2"),
    "fallbacks": ("--heuristic", "raster_only", *(part for option in CHEAP for part in ("--effect", option))),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ODD)
def test_an_odd_scene_is_a_picture_without_nan(tmp_path: Path, name: str, way: str) -> None:
    if WAYS[way][0] in ("--tracer", "--gbuffer"):
        reason = get_registry().find(WAYS[way][0].removeprefix("--"), WAYS[way][1]).unavailable_reason()
        if reason:
            needs.absent(reason)
    done = render_text(tmp_path, "prims:\n" + ODD[name], *WAYS[way])
    assert done.code == 0, done.said
    assert done.errors == []
    assert done.finite
    assert (done.image >= 0).all()


@pytest.mark.parametrize("name", ["a million metres away", "a million metres large", "a tenth of a millimetre"])
def test_size_and_place_change_no_picture(tmp_path: Path, name: str) -> None:
    plain = render_text(tmp_path, "prims:\n  Ball: {type: Sphere}\n" + SUN)
    odd = render_text(tmp_path, "prims:\n" + ODD[name])
    assert plain.image[18, 32].min() > 0.1
    # A few pixels of the outline may fall to the other side.
    assert (np.abs(plain.image - odd.image).max(axis=2) > 0.05).mean() < 0.01


def test_a_camera_that_is_scaled_to_nothing_still_sees(tmp_path: Path) -> None:
    done = render_text(tmp_path, "prims:\n" + ODD["camera without a size"])
    assert done.image[18, 32].min() > 0.1
    assert done.image[0, 0].max() == 0


def obj(folder: Path, text: str) -> Outcome:
    (folder / "model.obj").write_text(text)
    return render(folder / "model.obj", folder / "picture.exr")


@pytest.mark.parametrize("size", ["1e17", "1e12", "1e6", "1e-4", "1e-20", "1e-40"])
def test_a_model_of_any_size_is_a_picture_without_nan(tmp_path: Path, size: str) -> None:
    done = obj(tmp_path, f"v 0 0 0\nv {size} 0 0\nv 0 {size} 0\nf 1 2 3\n")
    assert done.code == 0, done.said
    assert done.finite


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e19", "1e38", "1e300"])
def test_a_model_with_a_place_that_is_none_is_an_error(tmp_path: Path, value: str) -> None:
    message = one_error(obj(tmp_path, f"v 0 0 0\nv {value} 0 0\nv 0 1 0\nf 1 2 3\n"))
    assert message == "model.obj: position of vertex 2 is NaN, infinite or beyond 1e18 (1 of 3 used vertices)"


def test_a_model_of_lines_only_is_an_error(tmp_path: Path) -> None:
    assert "none of its 1 triangles has an area" in one_error(obj(tmp_path, "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"))
