"""Files are data: loading one runs no code, reaches no network, reads nothing outside its roots, fills no memory.

The files are loaded by a process that Python's audit hook watches (tests/load_audited.py).
"""

from __future__ import annotations

import ast
import base64
import json
import os
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

PROJECT = Path(__file__).resolve().parents[2]
TESTS = PROJECT / "tests"
SOURCES = [
    path for folder in ("core", "backends", "heuristics", "plugins") for path in (PROJECT / folder).rglob("*.py")
]
PICKLE_THEIR_OWN = {
    PROJECT / "core" / "phrt" / "testing" / "metrics.py",
    PROJECT / "plugins" / "phrt_plugins" / "bench" / "executors" / "message.py",
}
"""What is read back there was pickled by the same program: a metric to be checked, a message of a worker process."""
READERS = [
    PROJECT / "core" / "phrt" / "loading.py",
    *(PROJECT / "core" / "phrt" / "description").glob("*.py"),
    *(PROJECT / "plugins" / "phrt_plugins" / "loaders").glob("*.py"),
]


@dataclass(frozen=True)
class Audit:
    """What loading some files did. errors: "" for a file that was loaded, else type and message."""

    opened: list[str]
    forbidden: list[str]
    errors: dict[str, str]
    grown_mb: float


Watch = Callable[..., Audit]


@pytest.fixture
def watch(tmp_path: Path) -> Watch:
    """watch(path, ...) loads files under the audit hook."""
    warm = write_valid(tmp_path / "warm")

    def watched(*paths: Path) -> Audit:
        environment = {**os.environ, "PYTHONPATH": str(TESTS)}
        environment.pop("PHRT_ASSETS", None)
        command = [sys.executable, str(TESTS / "load_audited.py"), *map(str, warm), "--", *map(str, paths)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True, env=environment)
        return Audit(**json.loads(done.stdout))

    return watched


# Files


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width: int, height: int, pixels: bytes) -> bytes:
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(pixels, 9)) + chunk(b"IEND", b"")


def gltf(buffer: str = "", image: str = "") -> str:
    """One textured triangle; `buffer` and `image` are URIs, whole data where not given."""
    data = np.array([0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1], np.float32).tobytes()
    whole = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    pixel = "data:image/png;base64," + base64.b64encode(png(1, 1, bytes(5))).decode()
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": image or pixel}],
        "buffers": [{"byteLength": len(data), "uri": buffer or whole}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"},
        ],
    }
    return json.dumps(document)


def obj(library: str) -> str:
    return f"mtllib {library}\nusemtl paint\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"


def write(folder: Path, files: dict[str, str | bytes]) -> list[Path]:
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        (folder / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    return [folder / name for name in files]


def write_valid(folder: Path) -> list[Path]:
    """One good file of every kind, and a broken one, so that everything that reads files has been imported."""
    sky = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n" + bytes([128, 128, 128, 129])
    exr = folder / "sky.exr"
    write(folder, {"pixel.png": png(1, 1, bytes(5)), "sky.hdr": sky, "paint.mtl": "newmtl paint\nmap_Kd pixel.png\n"})
    write_exr(exr, 2, 2)
    scene = (
        "prims:\n  A: {type: Material, base_color_texture: {asset: pixel.png}}\n  B: {type: DomeLight, asset: SKY}\n"
    )
    return write(
        folder,
        {
            "one.gltf": gltf(),
            "two.obj": obj("paint.mtl"),
            "three.ply": "ply\nformat ascii 1.0\nelement vertex 0\nend_header\n",
            "four.stl": b"solid x\nendsolid x\n",
            "five.yaml": scene.replace("SKY", "sky.hdr"),
            "six.yaml": scene.replace("SKY", "sky.exr"),
            "seven.yaml": "prims:\n  A: {type: Spheer}\n  B: {type: Reference, asset: one.gltf}\n",
            "eight.yaml": "prims:\n  A: {type: Reference, loader: atrium}\n",
            "nine.gltf": gltf(image="gone.png"),
            "ten.gltf": "{}",
            "eleven.obj": b"\xff\xfe" + "v 0 0 0\n".encode("utf-16-le"),
            "twelve.obj": b"\xfe\xff" + "v 0 0 0\n".encode("utf-16-be"),
        },
    )


def write_exr(path: Path, width: int, height: int) -> None:
    import OpenEXR

    channels = {name: np.zeros((height, width), np.float32) for name in "RGB"}
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, channels) as file:
        file.write(str(path))


# Roots


def test_nothing_outside_the_roots_is_opened(watch: Watch, tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    folder = tmp_path / "project" / "scenes"
    secret = np.zeros(15, np.float32).tobytes()
    write(
        outside,
        {
            "secret.bin": secret,
            "secret.png": png(1, 1, bytes(5)),
            "secret.mtl": "newmtl paint\n",
            "secret.yaml": "prims: {}\n",
            "secret.hdr": b"#?RADIANCE\n\n-Y 1 +X 1\n1234",
            "secret.obj": obj("secret.mtl"),
        },
    )
    folder.mkdir(parents=True)
    ways = ["../../outside/{}", str(outside) + "/{}", "link/{}", "%2e%2e/%2e%2e/outside/{}", "..\\..\\outside\\{}"]
    ways += [f"file://{outside}/{{}}", "sub/../../../outside/{}", "secret-link{}"]
    (folder / "link").symlink_to(outside)
    files: dict[str, str | bytes] = {}
    for number, way in enumerate(ways):
        for suffix in ("bin", "png", "mtl", "yaml", "hdr", "obj"):
            link = folder / f"secret-linksecret.{suffix}"
            if not link.is_symlink():
                link.symlink_to(outside / f"secret.{suffix}")
        files[f"buffer{number}.gltf"] = gltf(buffer=way.format("secret.bin"))
        files[f"image{number}.gltf"] = gltf(image=way.format("secret.png"))
        files[f"library{number}.obj"] = obj(way.format("secret.mtl"))
        files[f"sublayer{number}.yaml"] = f"sublayers: ['{way.format('secret.yaml')}']\n"
        files[f"reference{number}.yaml"] = f"prims:\n  A: {{type: Reference, asset: '{way.format('secret.obj')}'}}\n"
        files[f"scene{number}.yaml"] = f"prims:\n  A: {{type: Reference, asset: '{way.format('secret.yaml')}'}}\n"
        texture = f"{{type: Material, base_color_texture: {{asset: '{way.format('secret.png')}'}}}}"
        files[f"texture{number}.yaml"] = f"prims:\n  A: {texture}\n"
        files[f"dome{number}.yaml"] = f"prims:\n  A: {{type: DomeLight, asset: '{way.format('secret.hdr')}'}}\n"
    paths = write(folder, files)
    done = watch(*paths)
    assert [path for path in done.opened if Path(path).is_relative_to(outside)] == []
    # What is opened at all: the files themselves.
    assert {path for path in done.opened if Path(path).is_relative_to(folder)} == {str(path) for path in paths}
    assert done.forbidden == []
    for number in range(len(ways)):
        for kind in ("buffer{}.gltf", "sublayer{}.yaml", "reference{}.yaml", "scene{}.yaml", "dome{}.yaml"):
            assert done.errors[str(folder / kind.format(number))] != ""
    for number in (0, 1, 2, 6, 7):
        for kind in ("buffer{}.gltf", "sublayer{}.yaml", "reference{}.yaml", "dome{}.yaml", "texture{}.yaml"):
            assert (
                "leaves the asset roots; files must lie inside one of: "
                in done.errors[str(folder / kind.format(number))]
            ), (kind, ways[number])


def test_the_watch_sees_what_is_opened(watch: Watch, tmp_path: Path) -> None:
    """The tests above would pass with a hook that sees nothing."""
    paths = write(tmp_path / "here", {"a.obj": obj("paint.mtl"), "paint.mtl": "newmtl paint\n", "b.gltf": gltf()})
    done = watch(paths[0], paths[2])
    assert set(done.errors.values()) == {""}
    assert {str(path) for path in paths} <= set(done.opened)


# Code and network

HOSTILE = {
    "tag1.yaml": "prims: !!python/object/apply:os.system ['touch {proof}']\n",
    "tag2.yaml": "prims: !!python/object/new:os.system ['touch {proof}']\n",
    "tag3.yaml": "prims:\n  A: !!python/module:subprocess {{}}\n",
    "tag4.yaml": 'prims:\n  A: {{type: Sphere, radius: !!python/object/apply:eval [\'open("{proof}", "w")\']}}\n',
    "tag5.json": '{{"prims": !!python/name:os.system ""}}\n',
    "loader.yaml": "prims:\n  A: {{type: Reference, loader: 'os:system'}}\n",
    "heuristic.yaml": "prims:\n  A: {{type: RenderSettings, heuristic: 'os:system'}}\n",
    "options.yaml": "prims:\n  A: {{type: Reference, loader: atrium, options: {{__class__: x}}}}\n",
    "sublayer.yaml": "sublayers: ['http://127.0.0.1:9/scene.yaml']\n",
    "reference.yaml": "prims:\n  A: {{type: Reference, asset: 'http://127.0.0.1:9/model.glb'}}\n",
    "dome.yaml": "prims:\n  A: {{type: DomeLight, asset: 'https://127.0.0.1:9/sky.hdr'}}\n",
    "machine.yaml": "prims:\n  A: {{type: Reference, asset: '//127.0.0.1/share/model.glb'}}\n",
    "model.obj": "mtllib http://127.0.0.1:9/paint.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\ncall touch {proof}\n",
    "shell.obj": "mtllib $(touch {proof}).mtl `touch {proof}`\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
}


def test_no_file_runs_code_or_reaches_the_network(watch: Watch, tmp_path: Path) -> None:
    proof = tmp_path / "proof"
    files: dict[str, str | bytes] = {name: text.format(proof=proof) for name, text in HOSTILE.items()}
    for number, address in enumerate(
        ("http://127.0.0.1:9/a", "ftp://127.0.0.1/a", "//127.0.0.1/a", "\\\\127.0.0.1\\a")
    ):
        files[f"buffer{number}.gltf"] = gltf(buffer=address)
        files[f"image{number}.gltf"] = gltf(image=address)
    files["pickle.gltf"] = b"cos\nsystem\n(S'touch " + str(proof).encode() + b"'\ntR."
    files["pickle.obj"] = files["pickle.gltf"]
    done = watch(*write(tmp_path / "hostile", files))
    assert done.forbidden == []
    assert not proof.exists()
    errors = {Path(path).name: message for path, message in done.errors.items()}
    for name in ("tag1.yaml", "tag2.yaml", "tag3.yaml", "tag4.yaml", "tag5.json"):
        assert "is not allowed; scene files are plain data" in errors[name]
    for name in ("reference.yaml", "dome.yaml"):
        assert "is an address; only names of files are read" in errors[name]
    assert "there is no loader 'os:system'" in errors["loader.yaml"]
    for number in range(4):
        assert "only relative file names and data: URIs are read" in errors[f"buffer{number}.gltf"]
        assert "only relative file names and data: URIs are read" in errors[f"image{number}.gltf"]


def test_real_bad_files_do_nothing_but_being_read(watch: Watch, assets: Path) -> None:
    root = (assets / "invalid").resolve()
    paths = [
        path for path in sorted(root.rglob("*")) if path.suffix.lower() in (".gltf", ".glb", ".ply", ".stl", ".obj")
    ]
    assert len(paths) > 200
    done = watch(*paths)
    assert done.forbidden == []
    assert [path for path in done.opened if not Path(path).is_relative_to(root)] == []


@pytest.mark.parametrize("name", ["atrium", "spheres", "cornell", "furnace"])
def test_the_shipped_scenes_do_nothing_but_being_read(watch: Watch, name: str) -> None:
    scene = PROJECT / "scenes" / f"{name}.yaml"
    done = watch(scene)
    assert done.errors == {str(scene): ""}
    assert done.forbidden == []
    assert {path for path in done.opened if not path.startswith(sys.prefix)} == {str(scene)}


# Memory


def absurd_exr(path: Path) -> None:
    """An EXR file whose header says 30000 x 30000 pixels."""
    write_exr(path, 4, 4)
    small, large = struct.pack("<4i", 0, 0, 3, 3), struct.pack("<4i", 0, 0, 29_999, 29_999)
    data = path.read_bytes()
    assert data.count(small) >= 2
    path.write_bytes(data.replace(small, large))


def test_bombs_are_refused_before_memory_is_spent(watch: Watch, tmp_path: Path) -> None:
    zeros = zlib.compress(bytes(64 * 1024 * 1024), 9)
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 30_000, 30_000, 8, 6, 0, 0, 0))
    bomb = b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zeros) + chunk(b"IEND", b"")
    text_bomb = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 1, 1, 8, 6, 0, 0, 0))
    text_bomb += chunk(b"zTXt", b"a\0\0" + zeros) + chunk(b"IEND", b"")
    folder = tmp_path / "bombs"
    write(
        folder,
        {
            "bomb.png": bomb,
            "text.png": text_bomb,
            "bomb.mtl": "newmtl paint\nmap_Kd bomb.png\n",
            "wide.hdr": b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 999999 +X 999999\n\x02\x02",
            "short.hdr": b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 9000 +X 3600\n\x02\x02",
        },
    )
    absurd_exr(folder / "wide.exr")
    vertices = "element vertex 100000000000\nproperty float x\nproperty float y\nproperty float z\n"
    ply = "ply\nformat {} 1.0\n" + vertices + "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    levels = "".join(f"l{n}: &l{n} [{', '.join([f'*l{n - 1}'] * 9)}]\n" for n in range(1, 12))
    counted = json.loads(gltf())
    counted["accessors"][0] |= {"count": 2_000_000_000}
    counted["accessors"][0].pop("bufferView")
    files: dict[str, str | bytes] = {
        "texture.yaml": "prims:\n  A: {type: Material, base_color_texture: {asset: bomb.png}}\n",
        "comment.yaml": "prims:\n  A: {type: Material, base_color_texture: {asset: text.png}}\n",
        "wide_hdr.yaml": "prims:\n  A: {type: DomeLight, asset: wide.hdr}\n",
        "short_hdr.yaml": "prims:\n  A: {type: DomeLight, asset: short.hdr}\n",
        "wide_exr.yaml": "prims:\n  A: {type: DomeLight, asset: wide.exr}\n",
        "aliases.yaml": "l0: &l0 [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + levels,
        "deep.yaml": "prims: " + "[" * 200_000,
        "long.yaml": "# " + "x" * (33 * 1024 * 1024),
        "image.gltf": gltf(image="bomb.png"),
        "counted.gltf": json.dumps(counted),
        "deep.gltf": '{"asset":' * 100_000,
        "chain.gltf": chain_of_nodes(50_000),
        "binary.ply": ply.format("binary_little_endian"),
        "ascii.ply": ply.format("ascii"),
        "promise.stl": b" " * 80 + b"\xff" * 4 + bytes(50),
    }
    library = write(folder, {"library.obj": obj("bomb.mtl")})
    paths = write(folder, files)
    done = watch(*paths, *library)
    errors = {Path(path).name: message for path, message in done.errors.items()}
    assert [name for name in files if not errors[name]] == []
    assert "far too many pixels; at most 33554432 are read" in errors["texture.yaml"]
    assert "999999 x 999999 pixels; from 1 to 33554432 are read" in errors["wide_hdr.yaml"]
    assert "values (aliases expanded)" in errors["aliases.yaml"]
    assert "nested more than 64 levels deep" in errors["deep.yaml"]
    assert "a scene file may have at most" in errors["long.yaml"]
    assert "is too large an image" in errors["image.gltf"]
    assert "is nested too deeply" in errors["deep.gltf"]
    assert "its nodes are nested too deeply" in errors["chain.gltf"]
    assert "is cut off" in errors["binary.ply"]
    assert "is cut off" in errors["promise.stl"]
    # A picture that a model names is replaced by a checker, with a warning.
    assert errors["library.obj"] == ""
    assert done.grown_mb < 200


def chain_of_nodes(count: int) -> str:
    nodes = [{"children": [number + 1]} for number in range(count - 1)]
    return json.dumps({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [*nodes, {}]})


# Source


def called(tree: ast.AST) -> list[tuple[str, ast.Call]]:
    """Every call of a plain or dotted name, with that name."""
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return [(ast.unparse(node.func), node) for node in calls]


def imported(tree: ast.AST) -> set[str]:
    """Top-level packages that are imported anywhere in a file."""
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add((node.module or "").split(".")[0])
    return names


def test_no_source_unpickles_evaluates_or_loads_yaml_objects() -> None:
    assert len(SOURCES) > 100
    for path in SOURCES:
        tree = ast.parse(path.read_text())
        if path not in PICKLE_THEIR_OWN:
            assert imported(tree).isdisjoint({"pickle", "dill", "cloudpickle", "marshal", "shelve"}), path
        for name, call in called(tree):
            assert name not in {"eval", "exec", "yaml.load", "yaml.unsafe_load", "yaml.full_load", "os.system"}, path
            pickled = [keyword.value for keyword in call.keywords if keyword.arg == "allow_pickle"]
            assert all(isinstance(value, ast.Constant) and value.value is False for value in pickled), path


def test_what_reads_files_imports_nothing_that_runs_or_fetches() -> None:
    never = {"subprocess", "socket", "urllib3", "requests", "http", "ftplib", "importlib", "runpy", "ctypes"}
    assert len(READERS) > 40
    for path in READERS:
        assert imported(ast.parse(path.read_text())).isdisjoint(never), path
