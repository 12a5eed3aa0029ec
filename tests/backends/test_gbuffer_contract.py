"""What every G-buffer producer promises: one body of tests over all of them, and both compared pixel for pixel."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import needs
import numpy as np
import pytest

import phrt
from phrt.camera import CameraView, look_at
from phrt.channels import CHANNELS, GBuffer
from phrt.conventions import NO_PRIMITIVE
from phrt.model import Image, Material, Mesh, TextureRef
from phrt.testing import worlds as scenes
from phrt.testing.worlds import SIZE, at, front_view, quad
from phrt.world import Changes, World
from phrt_backends.gbuffers.moderngl_context import moderngl_reason
from phrt_backends.gbuffers.moderngl_producer import ModernglProducer
from phrt_backends.gbuffers.raycast import RaycastProducer
from phrt_backends.gbuffers.raycast_options import RaycastOptions
from phrt_backends.options import NumpyOptions
from phrt_backends.tracers.numpy_bvh import NumpyTracer

PRODUCERS = ["moderngl", "raycast"]
X, Y = np.meshgrid((np.arange(SIZE) + 0.5) / SIZE * 2 - 1, 1 - (np.arange(SIZE) + 0.5) / SIZE * 2)
"""World x and y at z = 0 of every pixel centre of `front_view`."""


class Rig:
    """A producer, with the tracer it needs, on one world."""

    def __init__(self, kind: str, world: World) -> None:
        self.world = world
        self.tracer = NumpyTracer(NumpyOptions()) if kind == "raycast" else None
        self.producer = RaycastProducer(RaycastOptions(), tracer=self.tracer) if self.tracer else ModernglProducer()
        if self.tracer:
            self.tracer.build(world)
        self.producer.build(world)

    def __call__(self, view: CameraView | None = None, *, hidden: np.ndarray | None = None) -> GBuffer:
        buffer = self.producer.render(view or front_view(), hidden=hidden)
        buffer.validate()
        return buffer

    def move(self, object_id: int, matrix: np.ndarray) -> None:
        self.world.set_object_matrix(object_id, matrix)
        changes: Changes = self.world.advance(0.0)
        if self.tracer:
            self.tracer.update(self.world, changes)
        self.producer.update(self.world, changes)

    def close(self) -> None:
        if isinstance(self.producer, ModernglProducer):
            assert self.producer.gl_error() == "GL_NO_ERROR"
        self.producer.close()


Make = Callable[[World], Rig]


@pytest.fixture(params=PRODUCERS)
def make(request: pytest.FixtureRequest) -> Iterator[Make]:
    if request.param == "moderngl" and moderngl_reason():
        needs.absent(str(moderngl_reason()))
    made: list[Rig] = []

    def rig(world: World) -> Rig:
        made.append(Rig(request.param, world))
        return made[-1]

    yield rig
    for each in made:
        each.close()


def test_a_quad_that_faces_the_camera_fills_the_picture_with_known_values(make: Make) -> None:
    material = Material(
        base_color=(0.5, 0.25, 0.1, 1), metallic=0.75, roughness=0.3, transmission=0.2, emissive=(7, 8, 9)
    )
    buffer = make(scenes.world_of([(quad(), at())], [material]))()
    np.testing.assert_allclose(buffer.depth, 2.0, rtol=1e-6)
    np.testing.assert_allclose(buffer.position_world, np.stack([X, Y, 0 * X], -1), atol=2e-6)
    np.testing.assert_allclose(buffer.uv, np.stack([(X + 1) / 2, (1 - Y) / 2], -1), atol=2e-6)
    np.testing.assert_allclose(buffer.normal_world, np.broadcast_to([0, 0, 1], (SIZE, SIZE, 3)), atol=1e-6)
    np.testing.assert_allclose(buffer.normal_geometric_world, np.broadcast_to([0, 0, 1], (SIZE, SIZE, 3)), atol=1e-6)
    assert (buffer.object_id == 1).all()
    assert (buffer.material_id == 1).all()
    # Row 0 is the top: the triangle (0, 1, 2) lies below the diagonal, (0, 2, 3) above.
    assert buffer.primitive_id[0, 0] == 1
    assert buffer.primitive_id[-1, -1] == 0
    for name, value in {"metallic": 0.75, "roughness": 0.3, "transmission": 0.2, "alpha": 1.0}.items():
        np.testing.assert_allclose(buffer.arrays[name], value, rtol=1e-6)
    np.testing.assert_allclose(buffer.base_color[3, 9], [0.5, 0.25, 0.1], rtol=1e-6)
    np.testing.assert_allclose(buffer.emissive[3, 9], [7, 8, 9], rtol=1e-6)
    assert (buffer.motion == 0).all()


def test_misses_hold_the_clear_values(make: Make) -> None:
    buffer = make(scenes.world_of([(quad(half=0.5), at())]))()
    assert buffer.object_id[0, 0] == 0
    assert buffer.primitive_id[0, 0] == NO_PRIMITIVE
    for name, channel in CHANNELS.items():
        assert (buffer.arrays[name][buffer.object_id == 0] == channel.clear).all(), name
    # 32 pixels a metre: a square of one metre covers exactly the middle.
    covered = np.zeros((SIZE, SIZE), bool)
    covered[16:48, 16:48] = True
    np.testing.assert_array_equal(buffer.object_id == 1, covered)


def test_a_texture_is_neither_upside_down_nor_mirrored(make: Make) -> None:
    material = Material(base_color_texture=TextureRef(0, nearest=True))
    buffer = make(scenes.world_of([(quad(), at())], [material], [scenes.four_colors()]))()
    np.testing.assert_allclose(buffer.base_color[8, 8], [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(buffer.base_color[8, 56], [0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(buffer.base_color[56, 8], [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(buffer.base_color[56, 56], [1, 1, 1], atol=1e-6)


@pytest.mark.parametrize(
    ("ref", "uv", "color"),
    [
        (TextureRef(0, nearest=True, wrap_s="repeat"), (1.25, 0.25), (1, 0, 0)),
        (TextureRef(0, nearest=True, wrap_s="clamp"), (1.25, 0.25), (0, 1, 0)),
        (TextureRef(0, nearest=True, wrap_s="mirror"), (1.75, 0.25), (1, 0, 0)),
        (TextureRef(0, nearest=True, wrap_s="mirror"), (-0.25, 0.25), (1, 0, 0)),
        (TextureRef(0, nearest=True, wrap_t="mirror"), (0.25, 1.25), (0, 0, 1)),
        (TextureRef(0, nearest=True, wrap_t="clamp"), (0.25, -0.25), (1, 0, 0)),
        (TextureRef(0, nearest=True, offset=(0.5, 0.0)), (0.25, 0.25), (0, 1, 0)),
        (TextureRef(0, nearest=True, scale=(1.0, 3.0)), (0.25, 0.25), (0, 0, 1)),
        # The example of KHR_texture_transform: the lower left quadrant, turned; u runs up there, v runs right.
        (TextureRef(0, nearest=True, offset=(0.0, 1.0), rotation=math.pi / 2, scale=(0.5, 0.5)), (0.5, 0.5), (0, 0, 1)),
    ],
)
def test_wrap_modes_and_texture_transform(
    make: Make, ref: TextureRef, uv: tuple[float, float], color: tuple[float, float, float]
) -> None:
    mesh = quad(uv0=np.tile(np.float32(uv), (4, 1)))
    buffer = make(scenes.world_of([(mesh, at())], [Material(base_color_texture=ref)], [scenes.four_colors()]))()
    np.testing.assert_allclose(buffer.base_color[30, 20], color, atol=1e-6)


def test_the_second_uv_set_is_used_where_a_texture_asks_for_it(make: Make) -> None:
    mesh = quad(uv1=np.tile(np.float32([0.75, 0.25]), (4, 1)))
    material = Material(base_color_texture=TextureRef(0, nearest=True, uv_set=1))
    buffer = make(scenes.world_of([(mesh, at())], [material], [scenes.four_colors()]))()
    np.testing.assert_allclose(buffer.base_color[8, 8], [0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(buffer.uv[8, 8], [8.5 / 64, 8.5 / 64], atol=1e-5)


def test_colour_textures_are_srgb_and_data_textures_linear(make: Make) -> None:
    image = Image("gray", np.full((4, 4, 4), 128, np.uint8))
    ref = TextureRef(0)
    material = Material(
        metallic=1.0, transmission=1.0, emissive=(1, 2, 3), base_color_texture=ref, metallic_roughness_texture=ref,
        emissive_texture=ref, transmission_texture=ref, occlusion_texture=ref,
    )  # fmt: skip
    buffer = make(scenes.world_of([(quad(), at())], [material], [image]))()
    decoded = ((128 / 255 + 0.055) / 1.055) ** 2.4
    # OpenGL allows half a step of 8 bits in its decoding, and llvmpipe takes some of it.
    np.testing.assert_allclose(buffer.base_color[9, 9], [decoded] * 3, rtol=5e-3)
    np.testing.assert_allclose(buffer.emissive[9, 9], np.array([1, 2, 3]) * decoded, rtol=5e-3)
    for name in ("metallic", "roughness", "transmission", "occlusion"):
        np.testing.assert_allclose(buffer.arrays[name][9, 9], 128 / 255, rtol=1e-5)


@pytest.mark.parametrize("strength", [0.0, 0.25, 1.0])
def test_baked_occlusion_is_the_textures_red_by_its_strength(make: Make, strength: float) -> None:
    image = Image("ao", np.tile(np.uint8([51, 200, 250, 255]), (2, 2, 1)))
    shaded = Material(occlusion_texture=TextureRef(0), occlusion_strength=strength)
    placed = [(quad(0, half=0.5), at(-0.5)), (quad(1, half=0.5), at(0.5))]
    buffer = make(scenes.world_of(placed, [shaded, Material(occlusion_strength=0.5)], [image]))()
    np.testing.assert_allclose(buffer.occlusion[32, 16], 1 + strength * (0.2 - 1), rtol=1e-5)
    assert buffer.occlusion[32, 48] == 1, "a material without such a texture is open"
    assert buffer.occlusion[0, 0] == 1


def test_a_minified_texture_shows_its_mean(make: Make) -> None:
    checker = np.zeros((64, 64, 4), np.uint8)
    checker[(np.indices((64, 64)).sum(axis=0) % 2) == 0] = 255
    mesh = quad(uv0=scenes.QUAD_UV * 64)
    buffer = make(
        scenes.world_of([(mesh, at())], [Material(base_color_texture=TextureRef(0))], [Image("checker", checker)])
    )()
    np.testing.assert_allclose(buffer.base_color[8:-8, 8:-8], 0.5, atol=0.01)


def test_vertex_colours_multiply_and_vary(make: Make) -> None:
    colors = np.array([[0, 0, 1, 1], [1, 0, 1, 1], [1, 1, 1, 1], [0, 1, 1, 1]], np.float32)
    buffer = make(scenes.world_of([(quad(colors=colors), at())], [Material(base_color=(0.5, 0.5, 0.5, 1))]))()
    np.testing.assert_allclose(buffer.base_color, np.stack([(X + 1) / 4, (Y + 1) / 4, 0 * X + 0.5], -1), atol=2e-6)


def test_holes_of_an_alpha_mask_show_what_is_behind(make: Make) -> None:
    mask = Material(alpha_mode="MASK", base_color_texture=TextureRef(0, nearest=True))
    world = scenes.world_of([(quad(), at()), (quad(1, half=4), at(z=-1))], [mask, Material()], [scenes.half_covered()])
    buffer = make(world)()
    assert (buffer.object_id[:, : SIZE // 2] == 1).all()
    assert (buffer.object_id[:, SIZE // 2 :] == 2).all()
    np.testing.assert_allclose(buffer.depth[:, SIZE // 2 :], 3.0, rtol=1e-5)
    assert (buffer.alpha == 1).all()


def test_blended_surfaces_keep_their_coverage_and_opaque_ones_are_solid(make: Make) -> None:
    ref = TextureRef(0, nearest=True)
    materials = [
        Material(base_color=(1, 1, 1, 0.5), alpha_mode=mode, base_color_texture=ref) for mode in ("BLEND", "OPAQUE")
    ]
    for material, right, left in ((0, 0.0, 0.5), (1, 1.0, 1.0)):
        buffer = make(scenes.world_of([(quad(material), at())], materials, [scenes.half_covered()]))()
        assert (buffer.object_id == 1).all()
        np.testing.assert_allclose(buffer.alpha[:, 5], left, atol=1e-6)
        np.testing.assert_allclose(buffer.alpha[:, 60], right, atol=1e-6)


def test_single_sided_surfaces_are_culled_from_behind_and_double_sided_ones_face_the_eye(make: Make) -> None:
    behind = front_view(world_from_view=look_at((0, 0, -2), (0, 0, 0)))
    assert (make(scenes.world_of([(quad(), at())], [Material()]))(behind).object_id == 0).all()
    buffer = make(scenes.world_of([(quad(), at())], [Material(double_sided=True)]))(behind)
    assert (buffer.object_id == 1).all()
    np.testing.assert_allclose(buffer.normal_world[9, 9], [0, 0, -1], atol=1e-6)
    np.testing.assert_allclose(buffer.normal_geometric_world[9, 9], [0, 0, -1], atol=1e-6)
    # From behind, left and right change places.
    np.testing.assert_allclose(buffer.uv[0, 0], [1 - 0.5 / SIZE, 0.5 / SIZE], atol=1e-5)


def test_a_mirrored_object_is_seen_from_its_front(make: Make) -> None:
    world = scenes.world_of(
        [(quad(), at(scale=(-1, 1, 1)))],
        [Material(base_color_texture=TextureRef(0, nearest=True))],
        [scenes.four_colors()],
    )
    buffer = make(world)()
    assert (buffer.object_id == 1).all()
    np.testing.assert_allclose(buffer.normal_world[9, 9], [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(buffer.normal_geometric_world[9, 9], [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(buffer.base_color[8, 8], [0, 1, 0], atol=1e-6)


def test_a_normal_map_bends_the_shading_normal_alone(make: Make) -> None:
    # The tangent runs along +X and the bitangent along +Y, so tangent space is world space here.
    bent = np.array([228, 178, 204]) / 255 * 2 - 1
    image = Image("bent", np.tile(np.uint8([228, 178, 204, 255]), (2, 2, 1)))
    for scale in (1.0, 0.5):
        material = Material(normal_texture=TextureRef(0), normal_scale=scale)
        buffer = make(scenes.world_of([(quad(tangents=True), at())], [material], [image]))()
        expected = bent * [scale, scale, 1]
        np.testing.assert_allclose(buffer.normal_world[20, 20], expected / np.linalg.norm(expected), atol=1e-5)
        np.testing.assert_allclose(buffer.normal_geometric_world[20, 20], [0, 0, 1], atol=1e-6)


def test_unlit_materials_send_out_their_base_colour(make: Make) -> None:
    buffer = make(scenes.world_of([(quad(), at())], [Material(unlit=True, base_color=(0.2, 0.3, 0.4, 1))]))()
    np.testing.assert_allclose(buffer.emissive[9, 9], [0.2, 0.3, 0.4], rtol=1e-6)


@pytest.mark.parametrize("jitter", [(0.25, 0.0), (-0.4, 0.3), (0.0, -0.5)])
@pytest.mark.parametrize("orthographic", [False, True])
def test_jitter_shifts_the_sample_by_its_part_of_a_pixel(
    make: Make, jitter: tuple[float, float], orthographic: bool
) -> None:
    tan_half = (1.0, 1.0) if orthographic else (0.5, 0.5)
    view = front_view(jitter=jitter, orthographic=orthographic, tan_half=tan_half)
    buffer = make(scenes.world_of([(quad(half=2), at())]))(view)
    expected = np.stack([X + jitter[0] * 2 / SIZE, Y - jitter[1] * 2 / SIZE, 0 * X], -1)
    np.testing.assert_allclose(buffer.position_world, expected, atol=4e-6)


def test_orthographic_depth_is_the_same_everywhere_and_size_ignores_distance(make: Make) -> None:
    view = front_view(orthographic=True, tan_half=(1.0, 1.0), near=0.0)
    buffer = make(scenes.world_of([(quad(half=0.5), at(z=-500))]))(view)
    assert np.count_nonzero(buffer.object_id) == 32 * 32
    np.testing.assert_allclose(buffer.depth[buffer.object_id == 1], 502.0, rtol=1e-6)


def test_near_and_far_planes_cut(make: Make) -> None:
    world = scenes.world_of([(quad(), at()), (quad(half=4), at(z=-1)), (quad(half=8), at(z=-4))])
    rig = make(world)
    assert (rig(front_view(near=1.9)).object_id == 1).all()
    assert (rig(front_view(near=2.1)).object_id == 2).all()
    assert (rig(front_view(near=3.5)).object_id == 3).all()
    assert (rig(front_view(near=3.5, far=5.9)).object_id == 0).all()
    assert (rig(front_view(near=3.5, far=6.1)).object_id == 3).all()


def test_a_surface_that_reaches_behind_the_eye_is_cut_at_the_near_plane(make: Make) -> None:
    floor = Mesh(
        "floor", np.array([[-50, -1, -50], [50, -1, -50], [50, -1, 50], [-50, -1, 50]], np.float32),
        np.array([[0, 2, 1], [0, 3, 2]], np.int32), np.zeros(2, np.int32),
    )  # fmt: skip
    buffer = make(scenes.world_of([(floor, at())]))()
    slope = -(Y / 2)
    depth = np.where(slope > 0, 1 / np.maximum(slope, 1e-9), np.inf)
    hit = depth < 52
    np.testing.assert_array_equal(buffer.object_id == 1, hit)
    np.testing.assert_allclose(buffer.depth[hit], depth[hit], rtol=1e-4)
    np.testing.assert_allclose(buffer.position_world[hit][:, 1], -1.0, atol=1e-4)


def test_hidden_objects_are_left_out(make: Make) -> None:
    materials = [Material(transmission=1.0), Material(alpha_mode="BLEND"), Material()]
    world = scenes.world_of([(quad(0), at()), (quad(1, half=2), at(z=-0.5)), (quad(2, half=4), at(z=-1))], materials)
    rig = make(world)
    assert (rig().object_id == 1).all()
    assert (rig(hidden=~world.object_opaque).object_id == 3).all()
    assert (rig(hidden=np.array([False, True, False, False])).object_id == 2).all()
    assert (rig().object_id == 1).all()


def test_a_moved_object_is_seen_where_it_went(make: Make) -> None:
    rig = make(scenes.world_of([(quad(half=0.25), at()), (quad(half=0.25), at(x=-0.5))]))
    rig()
    turned = at(x=0.5, y=0.5)
    turned[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    rig.move(1, at(x=0.5, y=0.5))
    buffer = rig()
    assert buffer.object_id[16, 48] == 1
    assert buffer.object_id[32, 32] == 0
    assert buffer.object_id[32, 16] == 2
    # Turned by 90 degrees about Y it faces +X: seen from there, nothing from the front.
    rig.move(1, turned)
    assert not (rig().object_id == 1).any()
    side = rig(front_view(world_from_view=look_at((2.5, 0.5, 0), (0.5, 0.5, 0))))
    assert side.object_id[32, 32] == 1
    np.testing.assert_allclose(side.normal_geometric_world[32, 32], [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(side.normal_world[32, 32], [1, 0, 0], atol=1e-6)


def test_motion_of_a_moving_camera_points_to_where_things_were(make: Make) -> None:
    rig = make(scenes.world_of([(quad(half=1.5), at(z=-1))]))
    assert (rig().motion == 0).all()
    # 0.3 m right and 0.1 m up at depth 3: the picture moved left and down; jitter is no motion.
    buffer = rig(front_view(world_from_view=look_at((0.3, 0.1, 2), (0.3, 0.1, 0)), jitter=(0.3, -0.2)))
    hit = buffer.object_id == 1
    pixels_per_metre = SIZE / 2 / (0.5 * 3)
    np.testing.assert_allclose(
        buffer.motion[hit],
        np.broadcast_to([0.3 * pixels_per_metre, -0.1 * pixels_per_metre], (hit.sum(), 2)),
        atol=1e-3,
    )
    again = rig(front_view(world_from_view=look_at((0.3, 0.1, 2), (0.3, 0.1, 0)), jitter=(-0.1, 0.4)))
    assert np.abs(again.motion).max() == 0


def test_motion_of_a_moving_object_is_its_own(make: Make) -> None:
    rig = make(scenes.world_of([(quad(half=0.25), at(x=-0.5)), (quad(half=0.25), at(x=0.5))]))
    rig()
    rig.move(1, at(x=-0.5, y=0.25))
    buffer = rig()
    np.testing.assert_allclose(buffer.motion[buffer.object_id == 1], np.broadcast_to([0, 8], (16 * 16, 2)), atol=1e-3)
    assert np.abs(buffer.motion[buffer.object_id == 2]).max() < 1e-4
    assert np.abs(rig().motion).max() < 1e-4


@pytest.fixture
def pair() -> Iterator[Callable[[World], tuple[Rig, Rig]]]:
    if moderngl_reason():
        needs.absent(str(moderngl_reason()))
    made: list[Rig] = []

    def both(world: World) -> tuple[Rig, Rig]:
        made.extend(Rig(kind, world) for kind in PRODUCERS)
        return made[-2], made[-1]

    yield both
    for rig in made:
        rig.close()


@pytest.mark.parametrize("name", ["TextureSettingsTest", "NegativeScaleTest", "TextureTransformTest", "MultiUVTest"])
def test_both_producers_see_real_models_the_same(
    pair: Callable[[World], tuple[Rig, Rig]], assets: Path, name: str
) -> None:
    (path,) = [p for p in (assets / "gltf" / name).iterdir() if p.suffix in (".glb", ".gltf")]
    world = World(phrt.load_scene(path))
    view = world.view(160, 120)
    a, b = (rig(view) for rig in pair(world))
    assert np.mean(a.object_id != b.object_id) < 0.002
    same = (a.primitive_id == b.primitive_id) & (a.object_id > 0)
    assert same.mean() > 0.05
    for channel in ("depth", "normal_world", "normal_geometric_world", "uv", "metallic", "alpha"):
        np.testing.assert_allclose(a.arrays[channel][same], b.arrays[channel][same], atol=2e-3, rtol=1e-3)
    difference = np.abs(a.base_color[same] - b.base_color[same])
    assert difference.mean() < 0.02
    assert np.mean(difference > 0.1) < 0.03
