"""Small scenes built by hand, for tests: shapes, a builder, cameras, and ways to look at pictures."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import needs
import numpy as np

import phrt
from phrt.camera import look_at
from phrt.frame import FrameResult
from phrt.model import CameraLens, Image, Light, Material, Mesh
from phrt.registry.manager import get_registry
from phrt.scene import Dome, Scene, SceneCamera, SceneLight, SceneNode, SceneObject

TRACERS = ("embree", "open3d", "numpy")
LAMBERT = Material("lambert", base_color=(0.5, 0.5, 0.5, 1.0), specular=0.0)
MIRROR = Material("mirror", base_color=(1.0, 1.0, 1.0, 1.0), metallic=1.0, roughness=0.0)
GLASS = Material("glass", transmission=1.0, thickness=1.0, roughness=0.0, ior=1.5)
PLAIN_FALLBACKS = {
    "shadows": {"fallback": "none"},
    "reflections": {"fallback": "environment"},
    "refractions": {"fallback": "environment"},
}
"""As in the paper: what is not traced is missing for all to see."""
QUAD_UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)


def need_tracer(name: str) -> str:
    """`name`, or a skip that says why this tracer cannot run here."""
    reason = get_registry().find("tracer", name).unavailable_reason()
    if reason:
        needs.absent(f"{name}: {reason}")
    return name


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """(4, 4) float64 translation."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def turned(axis: str, degrees: float) -> np.ndarray:
    """(4, 4) float64 right-handed rotation about "x", "y" or "z"."""
    a, b = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.eye(4)
    matrix[a, a] = matrix[b, b] = cosine
    matrix[a, b], matrix[b, a] = -sine, sine
    return matrix


def mesh_of(positions: Any, triangles: Any, **attributes: Any) -> Mesh:
    """A mesh of arrays or lists, all triangles of material 0."""
    faces = np.asarray(triangles, np.int32).reshape(-1, 3)
    return Mesh("mesh", np.asarray(positions, np.float32), faces, np.zeros(len(faces), np.int32), **attributes)


def quad(width: float = 2.0, height: float = 2.0) -> Mesh:
    """A rectangle in the plane z = 0 facing +Z; uv (0, 0) at its top left corner, v down."""
    x, y = width / 2, height / 2
    corners = [[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]]
    return mesh_of(corners, [[0, 1, 2], [0, 2, 3]], uv0=QUAD_UV.copy())


def floor(size: float = 10.0) -> Mesh:
    """A square in the plane y = 0 facing up."""
    h = size / 2
    return mesh_of([[-h, 0, h], [h, 0, h], [h, 0, -h], [-h, 0, -h]], [[0, 1, 2], [0, 2, 3]])


def box(x: float = 1.0, y: float = 1.0, z: float = 1.0, *, inwards: bool = False) -> Mesh:
    """A closed box around the origin with faces outwards, or a room with faces inwards."""
    signs = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)]) * 2 - 1
    quads = [[1, 3, 7, 5], [0, 4, 6, 2], [2, 6, 7, 3], [0, 1, 5, 4], [4, 5, 7, 6], [0, 2, 3, 1]]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    return mesh_of(signs * np.array([x, y, z]) / 2, triangles[:, ::-1] if inwards else triangles)


def ball(radius: float = 0.5, subdivisions: int = 4) -> Mesh:
    """A sphere with its true normals."""
    import trimesh

    shape = trimesh.creation.icosphere(subdivisions=subdivisions, radius=1.0)
    unit = np.asarray(shape.vertices / np.linalg.norm(shape.vertices, axis=1, keepdims=True), np.float32)
    return mesh_of(unit * np.float32(radius), shape.faces, normals=unit)


def flipped(mesh: Mesh) -> Mesh:
    """`mesh` inside out."""
    normals = None if mesh.normals is None else -mesh.normals
    return replace(mesh, triangles=np.ascontiguousarray(mesh.triangles[:, ::-1]), normals=normals)


@dataclass
class Stage:
    """Builds a scene piece by piece."""

    dome: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scene: Scene = field(init=False)

    def __post_init__(self) -> None:
        self.scene = Scene("test", dome=Dome(self.dome))

    def node(self, path: str, matrix: np.ndarray) -> int:
        self.scene.nodes.append(SceneNode(path, -1, np.asarray(matrix, np.float64)))
        return len(self.scene.nodes) - 1

    def add(
        self, path: str, mesh: Mesh, material: Material = LAMBERT, matrix: np.ndarray | None = None, **switches: Any
    ) -> Stage:
        """An object; `switches` are SceneObject's casts_shadow, effects, ..."""
        self.scene.materials.append(material)
        index = np.full(len(mesh.triangles), len(self.scene.materials) - 1, np.int32)
        self.scene.meshes.append(replace(mesh, triangle_material=index))
        place = self.node(path, np.eye(4) if matrix is None else matrix)
        self.scene.objects.append(SceneObject(path, place, len(self.scene.meshes) - 1, **switches))
        return self

    def light(self, kind: Any, matrix: np.ndarray, **values: Any) -> Stage:
        path = f"/light{len(self.scene.lights)}"
        self.scene.lights.append(SceneLight(path, self.node(path, matrix), Light(kind, **values)))
        return self

    def camera(self, eye: tuple[float, float, float], target: tuple[float, float, float], **lens: Any) -> Stage:
        path = f"/camera{len(self.scene.cameras)}"
        self.scene.cameras.append(SceneCamera(path, self.node(path, look_at(eye, target)), CameraLens(**lens)))
        return self

    def image(self, pixels: Any) -> int:
        self.scene.images.append(Image("image", np.asarray(pixels, np.uint8)))
        return len(self.scene.images) - 1

    def render(self, size: tuple[int, int] = (32, 32), **options: Any) -> FrameResult:
        return render(self.scene, size, **options)


def render(scene: Scene, size: tuple[int, int] = (32, 32), **options: Any) -> FrameResult:
    """One checked frame by ray casting: a valid G-buffer, an image without NaN or infinity; a failing effect raises."""
    options = {"gbuffer": "raycast", "threads": 2, "strict": True} | options
    with phrt.Renderer(scene, size=size, **options) as renderer:
        frame = renderer.render()
    frame.gbuffer.validate()
    assert np.isfinite(frame.image).all(), "the image holds NaN or infinity"
    assert (frame.image >= 0).all(), "the image holds negative light"
    return frame


def pixel_centres(count: int, low: float, high: float) -> np.ndarray:
    """(count,) coordinates of pixel centres of a picture that spans low..high."""
    return low + (np.arange(count) + 0.5) * (high - low) / count


def psnr(image: np.ndarray, reference: np.ndarray) -> float:
    """Peak signal to noise ratio in dB of two pictures clipped to 0..1; NaN or infinity in either fails."""
    assert image.shape == reference.shape, f"{image.shape} against {reference.shape}"
    assert np.isfinite(image).all(), "the image holds NaN or infinity"
    assert np.isfinite(reference).all(), "the reference holds NaN or infinity"
    error = np.mean((np.clip(image, 0, 1) - np.clip(reference, 0, 1)) ** 2)
    return float("inf") if error == 0 else float(-10 * np.log10(error))


def write_evidence(folder: Path, **pictures: np.ndarray) -> Path:
    """Pictures as PNG files for whoever looks into a failure: linear light in, sRGB-like out. Returns the folder."""
    from PIL import Image as Picture

    folder.mkdir(parents=True, exist_ok=True)
    for name, picture in pictures.items():
        grey = np.nan_to_num(np.clip(picture, 0, 1)) ** (1 / 2.2)
        Picture.fromarray((grey * 255 + 0.5).astype(np.uint8)).save(folder / f"{name}.png")
    return folder


def hall(**switches: Any) -> Scene:
    """Eight things on a floor, a third of them mirrors, a third glass; `switches` are those of the first mirror ball."""
    made = Stage(dome=(0.3, 0.4, 0.6)).add("/floor", floor(), LAMBERT, at(0, -0.5, 0))
    for number in range(8):
        material, thing = ((MIRROR, ball(0.35, 3)), (GLASS, ball(0.35, 3)), (LAMBERT, box(0.6, 0.6, 0.6)))[number % 3]
        place = at(-1.8 + 1.2 * (number % 4), -0.15, -1.4 * (number // 4))
        made.add(f"/thing{number}", thing, material, place, **(switches if number == 0 else {}))
    made.light("point", at(1, 3, 2), intensity=40.0).light("point", at(-2, 3, 1), intensity=20.0)
    return made.camera((0, 1.2, 4), (0, 0, -0.5), fov_y=0.8).scene
