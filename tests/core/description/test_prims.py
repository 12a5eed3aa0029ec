"""Shapes, lights, cameras and settings as plain data; the schema; text to values."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import phrt.description
from phrt.description.prims import PRIM_TYPES
from phrt.description.shapes import box, icosphere, plane
from phrt.description.values import read_text
from phrt.model import Mesh
from phrt.scene import Scene

Load = Callable[..., Scene]


def face_normals(mesh: Mesh) -> np.ndarray:
    p = mesh.positions[mesh.triangles].astype(np.float64)
    return np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]) / 2


@pytest.mark.parametrize("subdivision", [0, 1, 4])
def test_an_icosphere_is_round_closed_and_faces_out(subdivision: int) -> None:
    mesh = icosphere("s", 0.4, subdivision)
    assert mesh.normals is not None
    assert len(mesh.triangles) == 20 * 4**subdivision
    assert np.linalg.norm(mesh.positions, axis=1) == pytest.approx(np.full(len(mesh.positions), 0.4), rel=1e-6)
    assert mesh.normals == pytest.approx(mesh.positions / 0.4, abs=1e-6)
    normals = face_normals(mesh)
    assert (np.einsum("ij,ij->i", normals, mesh.positions[mesh.triangles[:, 0]]) > 0).all()
    # The faces of a closed surface cancel.
    assert normals.sum(axis=0) == pytest.approx([0, 0, 0], abs=1e-6)
    if subdivision == 4:
        assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(4 * np.pi * 0.16, rel=2e-3)


def test_no_triangle_of_a_sphere_runs_backwards_in_uv() -> None:
    mesh = icosphere("s", 1.0, 3)
    assert mesh.uv0 is not None
    spread = np.ptp(mesh.uv0[mesh.triangles], axis=1)
    assert spread[:, 0].max() < 0.5
    top = mesh.uv0[mesh.positions[:, 1] > 0.999]
    assert top[:, 1] == pytest.approx(np.zeros(len(top)), abs=1e-6)


def test_planes_face_up_and_boxes_out() -> None:
    flat = plane("p", (2, 3))
    assert (face_normals(flat) / 3).tolist() == [[0, 1, 0], [0, 1, 0]]
    mesh = box("b", (1, 2, 3))
    normals = face_normals(mesh)
    centres = mesh.positions[mesh.triangles].mean(axis=1)
    assert (np.einsum("ij,ij->i", normals, centres) > 0).all()
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(22)
    assert np.abs(mesh.positions).max(axis=0).tolist() == [0.5, 1, 1.5]


def test_polygons_become_fans(load: Load) -> None:
    scene = load(
        "prims:\n  M: {type: Mesh, points: [[0,0,0],[1,0,0],[1,1,0],[0,1,0]], faces: [[0,1,2,3]], "
        "uv: [[0,0],[1,0],[1,1],[0,1]]}\n"
    )
    mesh = scene.meshes[0]
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert np.linalg.norm(face_normals(mesh), axis=1).sum() == pytest.approx(1)
    assert mesh.uv0 is not None
    assert mesh.uv0.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]


def test_lights_become_what_they_are(load: Load) -> None:
    scene = load(
        "prims:\n"
        "  Point: {type: SphereLight, intensity: 3, color: [1, 0, 0], casts_shadow: false}\n"
        "  Ball: {type: SphereLight, radius: 0.5, range: 9}\n"
        "  Spot: {type: SphereLight, cone: {inner: 10, outer: 30}}\n"
        "  Sun: {type: DistantLight, angle: 0.5}\n"
        "  Panel: {type: RectLight, width: 2, height: 3}\n"
    )
    lights = [entry.light for entry in scene.lights]
    assert [light.kind for light in lights] == ["point", "sphere", "spot", "directional", "rect"]
    assert (lights[0].intensity, lights[0].color, lights[0].casts_shadow) == (3, (1, 0, 0), False)
    assert (lights[1].radius, lights[1].range) == (0.5, 9)
    assert np.degrees([lights[2].inner_angle, lights[2].outer_angle]) == pytest.approx([10, 30])
    assert np.degrees(lights[3].angle) == pytest.approx(0.5)
    assert lights[4].size == (2, 3)


def test_cameras_and_settings_become_what_they_are(load: Load) -> None:
    scene = load(
        "prims:\n"
        "  First: {type: Camera}\n"
        "  Second: {type: Camera, orthographic: 4, near: 0.5, far: 20, exposure: 2}\n"
        "  Settings:\n    type: RenderSettings\n    camera: /Second\n    size: [64, 32]\n    fps: 24\n    frames: 10\n"
        "    heuristic: all_trace\n    effects: {shadows: {samples: 4}}\n"
    )
    assert [camera.path for camera in scene.cameras] == ["/Second", "/First"]
    lens = scene.cameras[0].lens
    assert (lens.ortho_height, lens.near, lens.far, lens.exposure) == (4, 0.5, 20, 2)
    assert (scene.settings.size, scene.settings.fps, scene.settings.frames) == ((64, 32), 24, 10)
    assert scene.settings.heuristic == "all_trace"
    assert scene.settings.effects == {"shadows": {"samples": 4}}


def test_materials_become_what_they_are(load: Load) -> None:
    scene = load(
        "prims:\n  M: {type: Material, base_color: [.1, .2, .3], opacity: .5, alpha_mode: BLEND, transmission: 1,\n"
        "      thickness: 2, attenuation_color: [0, 1, 0], attenuation_distance: 3, ior: 1.3, double_sided: true}\n"
    )
    material = scene.materials[0]
    assert material.base_color == (0.1, 0.2, 0.3, 0.5)
    assert (material.alpha_mode, material.transmission, material.thickness) == ("BLEND", 1, 2)
    assert (material.attenuation_color, material.attenuation_distance) == ((0, 1, 0), 3)
    assert (material.ior, material.double_sided, material.specular) == (1.3, True, 1)


def test_the_schema_names_every_prim_type_and_accepts_the_shipped_scenes() -> None:
    from pathlib import Path

    import jsonschema  # type: ignore[import-untyped]

    schema = phrt.description.schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    text = json.dumps(schema)
    assert all(f'"{name}"' in text for name in PRIM_TYPES)
    for path in sorted((Path(__file__).resolve().parents[3] / "scenes").glob("*.yaml")):
        jsonschema.validate(read_text(path.read_text(), path.name).plain(), schema)


def test_every_attribute_says_what_it_means() -> None:
    for name, model in PRIM_TYPES.items():
        for attribute, field in model.model_fields.items():
            assert attribute == "type" or field.description, f"{name}.{attribute}"


TEXT = st.text(st.characters(max_codepoint=0xFFFF, exclude_categories=["Cs"]), max_size=12)
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**40), 2**40) | st.floats(allow_nan=False, allow_infinity=False) | TEXT,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(TEXT.filter(lambda key: key != "<<"), inner, max_size=4)
    ),
    max_leaves=20,
)


@settings(max_examples=150, deadline=None)
@given(PLAIN.filter(lambda value: value is not None))
def test_json_text_is_read_back_as_it_was_written(value: object) -> None:
    assert read_text(json.dumps(value), "round.json").plain() == value


@pytest.mark.parametrize(
    ("text", "value"),
    [("1e-3", 0.001), (".5", 0.5), ("+3", 3), ("0x1F", 31), ("yes", "yes"), ("'3'", "3"), (".inf", float("inf")),
     ("1_000", "1_000"), ("2026-01-01", "2026-01-01"), ("~", None), ("TRUE", True)],
)  # fmt: skip
def test_plain_words_have_the_types_of_yaml_1_2(text: str, value: object) -> None:
    assert read_text(f"a: {text}", "t").plain() == {"a": value}
