"""All-traced pictures against Mitsuba 3, an independent renderer, on the same triangles.

What Mitsuba adds and PHRT does not compute is light between diffuse surfaces. Surfaces are therefore dark and lights
strong: the share of that light falls with the albedo, 1 % here, and stays far below the tolerance.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import needs
import numpy as np
import pytest
from scene_kit import GLASS, LAMBERT, MIRROR, Stage, at, ball, box, flipped, psnr, render, turned, write_evidence

from phrt.model import Material, Mesh
from phrt.registry.manager import get_registry
from phrt.scene import Scene

mitsuba = needs.package("mitsuba", "the independent reference renderer is in the extra 'test'")

SIZE = 96
FOV_Y = 0.8
RADIUS = 0.6
EYE, TARGET = (0.0, 0.15, 3.4), (0.0, -0.1, 0.0)
ALBEDO = 0.01
TOLERANCE_DB = 35.0
TRACED = {"reflections": {"max_depth": 8}, "refractions": {"max_depth": 10}}
BALL_AT = at(-0.3, -0.35, 0.3)
SPP = {"diffuse": 36, "mirror": 36, "glass": 144}
BALLS = {"diffuse": LAMBERT, "mirror": MIRROR, "glass": GLASS}


def tint(red: float, green: float, blue: float) -> Material:
    return Material(base_color=(red * ALBEDO, green * ALBEDO, blue * ALBEDO, 1.0), specular=0.0)


def stage(kind: str, *, ior: float = 1.5, ball_mesh: Mesh | None = None) -> Stage:
    """A room of coloured walls with blocks, two point lights, and a ball of `kind` in the middle."""
    made = Stage()
    wall = {
        "floor": ((4, 0.1, 4), (0, -1.05, 0), tint(0.8, 0.8, 0.8)),
        "ceiling": ((4, 0.1, 4), (0, 1.55, 0), tint(0.7, 0.7, 0.7)),
        "back": ((4, 3, 0.1), (0, 0, -1.55), tint(0.5, 0.6, 0.9)),
        "front": ((4, 3, 0.1), (0, 0, 4.05), tint(0.9, 0.6, 0.2)),
        "left": ((0.1, 3, 6), (-1.55, 0, 1), tint(0.9, 0.2, 0.2)),
        "right": ((0.1, 3, 6), (1.55, 0, 1), tint(0.2, 0.9, 0.2)),
        "block": ((0.5, 0.9, 0.5), (0.85, -0.55, -0.5), tint(0.9, 0.8, 0.3)),
        "step": ((0.7, 0.3, 0.4), (-1.0, -0.85, -0.8), tint(0.3, 0.8, 0.9)),
    }
    for name, (size, place, material) in wall.items():
        made.add(f"/{name}", box(*size), material, at(*place))
    for index, x in enumerate(np.linspace(-1.2, 1.2, 7)):
        colors = ((0.05, 0.05, 0.05), (0.9, 0.9, 0.1), (0.9, 0.1, 0.1))
        made.add(f"/bar{index}", box(0.2, 1.6, 0.05), tint(*colors[index % 3]), at(x, -0.2, -1.3))
    material = tint(0.9, 0.9, 0.9) if kind == "diffuse" else replace(BALLS[kind], ior=ior)
    made.add("/ball", ball_mesh or ball(RADIUS), material, BALL_AT)
    if kind == "glass":
        # A tilted block: its side walls reflect totally.
        made.add("/prism", box(0.5, 0.7, 0.5), material, at(0.55, -0.2, 0.9) @ turned("y", 25) @ turned("x", 20))
    made.light("point", at(-0.9, 1.2, 1.5), intensity=9.0 / ALBEDO)
    made.light("point", at(1.1, 0.8, 0.4), intensity=3.0 / ALBEDO, color=(1.0, 0.8, 0.6))
    made.camera(EYE, TARGET, fov_y=FOV_Y)
    return made


def write_ply(path: Path, positions: np.ndarray, triangles: np.ndarray, normals: np.ndarray | None) -> None:
    """Binary PLY, the least that Mitsuba reads."""
    columns = (positions if normals is None else np.concatenate([positions, normals], axis=1)).astype("<f4")
    names = ["x", "y", "z", "nx", "ny", "nz"][: columns.shape[1]]
    head = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(columns)}",
        *(f"property float {n}" for n in names),
    ]
    head += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header", ""]
    faces = np.empty(len(triangles), [("count", "u1"), ("corner", "<i4", 3)])
    faces["count"], faces["corner"] = 3, triangles
    path.write_bytes("\n".join(head).encode() + columns.tobytes() + faces.tobytes())


def bsdf(material: Material) -> dict[str, Any]:
    if material.transmission:
        return {"type": "dielectric", "int_ior": material.ior, "ext_ior": 1.0}
    if material.metallic:
        return {"type": "twosided", "bsdf": {"type": "conductor", "material": "none"}}
    color = {"type": "rgb", "value": list(material.base_color[:3])}
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": color}}


def reference_image(scene: Scene, folder: Path, spp: int) -> np.ndarray:
    """(SIZE, SIZE, 3) float32 by Mitsuba's path tracer, box-filtered."""
    mitsuba.set_variant("scalar_rgb")
    transform = mitsuba.ScalarTransform4f
    description: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 16, "rr_depth": 100},
        "sensor": {
            "type": "perspective",
            "fov": float(np.degrees(FOV_Y)),
            "fov_axis": "y",
            "near_clip": 0.01,
            "to_world": transform().look_at(origin=EYE, target=TARGET, up=[0, 1, 0]),
            "film": {
                "type": "hdrfilm",
                "width": SIZE,
                "height": SIZE,
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
            },
            "sampler": {"type": "multijitter", "sample_count": spp},
        },
    }
    for index, entry in enumerate(scene.objects):
        mesh, matrix = scene.meshes[entry.mesh], scene.nodes[entry.node].matrix
        path = folder / f"{index}.ply"
        normals = None if mesh.normals is None else mesh.normals @ matrix[:3, :3].T
        write_ply(path, mesh.positions @ matrix[:3, :3].T + matrix[:3, 3], mesh.triangles, normals)
        material = scene.materials[mesh.triangle_material[0]]
        description[f"object{index}"] = {
            "type": "ply",
            "filename": str(path),
            "face_normals": mesh.normals is None,
            "bsdf": bsdf(material),
        }
    for index, light in enumerate(scene.lights):
        value = [light.light.intensity * c for c in light.light.color]
        position = [float(c) for c in scene.nodes[light.node].matrix[:3, 3]]
        description[f"light{index}"] = {
            "type": "point",
            "position": position,
            "intensity": {"type": "rgb", "value": value},
        }
    return np.array(mitsuba.render(mitsuba.load_dict(description)), np.float32)


class References(dict[str, np.ndarray]):
    """Mitsuba's picture of every room, made when first asked for."""

    def __init__(self, folders: pytest.TempPathFactory) -> None:
        super().__init__()
        self._folders = folders

    def __missing__(self, kind: str) -> np.ndarray:
        self[kind] = reference_image(stage(kind).scene, self._folders.mktemp(kind), SPP[kind])
        return self[kind]


@pytest.fixture(scope="module")
def references(tmp_path_factory: pytest.TempPathFactory) -> References:
    return References(tmp_path_factory)


def compared(scene: Scene, reference: np.ndarray, folder: Path, **options: Any) -> tuple[float, Path]:
    """PSNR of our picture of `scene`, and where both pictures lie."""
    image = render(scene, (SIZE, SIZE), aa=64, effects=TRACED | options.pop("effects", {}), **options).image
    evidence = write_evidence(folder, ours=image, mitsuba=reference, difference=np.abs(image - reference) * 8)
    return psnr(image, reference), evidence


@pytest.mark.parametrize("gbuffer", ["raycast", "moderngl"])
@pytest.mark.parametrize("kind", BALLS)
def test_all_trace_agrees_with_mitsuba(kind: str, gbuffer: str, references: References, tmp_path: Path) -> None:
    if reason := get_registry().find("gbuffer", gbuffer).unavailable_reason():
        needs.absent(f"{gbuffer}: {reason}")
    reached, evidence = compared(stage(kind).scene, references[kind], tmp_path / kind, gbuffer=gbuffer)
    assert reached >= TOLERANCE_DB, f"{reached:.1f} dB; see {evidence}"


def test_the_references_show_what_is_tested(references: References) -> None:
    for kind in BALLS:
        image = references[kind]
        assert image.min() < 0.01 < 0.5 < np.clip(image, 0, 1).max(), kind
    assert psnr(references["mirror"], references["glass"]) < TOLERANCE_DB


def smaller(mesh: Mesh) -> Mesh:
    return replace(mesh, positions=mesh.positions * np.float32(0.9))


def shadowless(scene: Scene) -> Scene:
    for entry in scene.objects:
        entry.casts_shadow = False
    return scene


def brighter(scene: Scene) -> Scene:
    scene.lights[0].light.intensity *= 1.25
    return scene


MUTANTS: dict[str, tuple[str, Any, dict[str, Any]]] = {
    "shadows_off": ("diffuse", lambda: stage("diffuse").scene, {"effects": {"shadows": {"enabled": False}}}),
    "casts_shadow_false": ("diffuse", lambda: shadowless(stage("diffuse").scene), {}),
    "raster_only": (
        "diffuse",
        lambda: stage("diffuse").scene,
        {"heuristic": "raster_only", "effects": {"shadows": {"fallback": "none"}}},
    ),
    "brighter_light": ("diffuse", lambda: brighter(stage("diffuse").scene), {}),
    "smaller_ball": ("diffuse", lambda: stage("diffuse", ball_mesh=smaller(ball(RADIUS))).scene, {}),
    "diffuse_inside_out": ("diffuse", lambda: stage("diffuse", ball_mesh=flipped(ball(RADIUS))).scene, {}),
    "diffuse_normals_flipped": ("diffuse", lambda: stage("diffuse", ball_mesh=normals_flipped()).scene, {}),
    "mirror_inside_out": ("mirror", lambda: stage("mirror", ball_mesh=flipped(ball(RADIUS))).scene, {}),
    "mirror_untraced": ("mirror", lambda: stage("mirror").scene, {"effects": {"reflections": {"enabled": False}}}),
    "mirror_without_shadows": ("mirror", lambda: shadowless(stage("mirror").scene), {}),
    "glass_inside_out": ("glass", lambda: stage("glass", ball_mesh=flipped(ball(RADIUS))).scene, {}),
    "glass_ior_1.33": ("glass", lambda: stage("glass", ior=1.33).scene, {}),
    "glass_ior_1.7": ("glass", lambda: stage("glass", ior=1.7).scene, {}),
    "glass_one_interface": ("glass", lambda: stage("glass").scene, {"effects": {"refractions": {"max_depth": 0}}}),
    "glass_thin": ("glass", lambda: thin(stage("glass").scene), {}),
}


def normals_flipped() -> Mesh:
    """A ball whose vertex normals point inwards while its triangles face outwards."""
    mesh = ball(RADIUS)
    assert mesh.normals is not None
    return replace(mesh, normals=-mesh.normals)


def thin(scene: Scene) -> Scene:
    scene.materials = [replace(material, thickness=0.0) for material in scene.materials]
    return scene


@pytest.mark.parametrize("name", MUTANTS)
def test_a_wrong_picture_fails_the_tolerance(name: str, references: References, tmp_path: Path) -> None:
    kind, mutant, options = MUTANTS[name]
    reached, evidence = compared(mutant(), references[kind], tmp_path / name, **options)
    assert reached < TOLERANCE_DB, f"{reached:.1f} dB: the tolerance does not see this fault; see {evidence}"
