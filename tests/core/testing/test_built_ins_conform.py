"""Everything that ships passes the conformance kit. (Heuristics: tests/heuristics/test_contract.py.)"""

from __future__ import annotations

import base64
import json
import subprocess
import sys
from pathlib import Path

import needs
import numpy as np
import pytest

from phrt.registry import get_registry
from phrt.testing import check_effect, check_gbuffer, check_loader, check_metric, check_tracer

TRACERS = [
    ("embree", {}), ("embree", {"robust": True}), ("embree", {"binding": "embreex"}), ("open3d", {}), ("numpy", {}),
]  # fmt: skip
EFFECTS = [
    ("shadows", {}), ("shadows", {"samples": 4, "fallback": "shadow_map"}), ("reflections", {"fallback": "environment"}),
    ("reflections", {"samples": 2, "fallback": "probe"}), ("refractions", {}), ("refractions", {"fallback": "probe"}),
    ("ambient_occlusion", {}), ("ambient_occlusion", {"fallback_value": 0.5}),
]  # fmt: skip
MESHES = {
    "corner.obj": "mtllib corner.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nusemtl red\nf 1/1 2/1 3/1\nf 1 3 4\n",
    "corner.mtl": "newmtl red\nKd 1 0 0\n",
    "corner.stl": "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    "endloop\nendfacet\nendsolid a\n",
    "corner.ply": "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    "corner.gltf": json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "translation": [1, 2, 3]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"roughnessFactor": 0.5}}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": "data:application/octet-stream;base64," + base64.b64encode(
            np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32).tobytes()).decode()}],
    }),
}  # fmt: skip
LOADERS: list[tuple[str, list[str], dict[str, object]]] = [
    ("mesh", ["corner.obj", "corner.stl", "corner.ply"], {}), ("gltf", ["corner.gltf"], {}),
    ("simplified", ["corner.obj"], {"share": 0.5}), ("atrium", [], {"bays_x": 2, "bays_z": 2, "storeys": 1, "statues": 1}),
]  # fmt: skip
BEYOND = {"temporal": ("compensated_difference",)}
"""Columns by which a picture may be better than its reference."""


def available(kind: str, name: str) -> str:
    """`name`, or a skip that says why it cannot run here."""
    if reason := get_registry().find(kind, name).unavailable_reason():
        needs.absent(f"{name}: {reason}")
    return name


def built_in(kind: str) -> list[str]:
    return [entry.name for entry in get_registry().plugins(kind) if entry.origin == "built-in"]


@pytest.mark.parametrize(("name", "options"), TRACERS)
def test_tracers_conform(name: str, options: dict[str, object]) -> None:
    check_tracer(available("tracer", name), options)


@pytest.mark.parametrize("name", built_in("gbuffer"))
def test_gbuffer_producers_conform(name: str) -> None:
    check_gbuffer(available("gbuffer", name))


@pytest.mark.parametrize(("name", "options"), EFFECTS)
def test_effects_conform(name: str, options: dict[str, object]) -> None:
    check_effect(name, options)


@pytest.mark.parametrize("name", built_in("metric"))
def test_metrics_conform(name: str) -> None:
    check_metric(available("metric", name), beyond=BEYOND.get(name, ()))


@pytest.mark.parametrize(("name", "files", "options"), LOADERS)
@pytest.mark.filterwarnings("ignore::phrt.PhrtWarning")
def test_loaders_conform(name: str, files: list[str], options: dict[str, object], tmp_path: Path) -> None:
    for file, text in MESHES.items():
        (tmp_path / file).write_text(text)
    check_loader(available("loader", name), [tmp_path / file for file in files], options)


def test_the_kit_needs_no_test_framework() -> None:
    code = "import sys, phrt.testing; assert not {'pytest', 'hypothesis', 'pyarrow'} & set(sys.modules)"
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, timeout=120)


def test_nothing_that_ships_is_left_out() -> None:
    assert {name for name, _ in TRACERS} == set(built_in("tracer"))
    assert {name for name, _ in EFFECTS} == set(built_in("effect"))
    assert {name for name, _, _ in LOADERS} == set(built_in("loader"))
