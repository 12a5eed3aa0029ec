"""The moderngl producer on scenes whose G-buffer can be computed, and its own promises: context, threads, caches."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import needs
import numpy as np
import pytest

from phrt.camera import look_at
from phrt.channels import CHANNELS
from phrt.errors import PluginError
from phrt.model import Material, Mesh
from phrt.testing import worlds as scenes
from phrt.world import World
from phrt_backends.gbuffers.moderngl_context import gl_info, moderngl_reason, open_context
from phrt_backends.gbuffers.moderngl_layout import MATERIAL_CHANNELS, layout_for
from phrt_backends.gbuffers.moderngl_options import ModernglOptions
from phrt_backends.gbuffers.moderngl_producer import KEPT_TARGETS, ModernglProducer
from phrt_backends.gbuffers.moderngl_provoking import own_corners

pytestmark = needs.all_need(moderngl_reason())

Build = Callable[[World], ModernglProducer]


@pytest.fixture
def build() -> Iterator[Build]:
    """Makes producers, and checks at the end that no call raised OpenGL's error flag."""
    made: list[ModernglProducer] = []

    def make(world: World, **options: bool) -> ModernglProducer:
        made.append(ModernglProducer(ModernglOptions(**options)))
        made[-1].build(world)
        return made[-1]

    yield make
    for producer in made:
        assert producer.gl_error() == "GL_NO_ERROR"
        producer.close()


def test_info_names_what_draws_and_knows_software_from_hardware() -> None:
    info = gl_info()
    assert info.vendor
    assert info.version
    software = any(name in info.renderer.lower() for name in ("llvmpipe", "softpipe", "swrast"))
    assert info.is_hardware is not software
    assert gl_info() is info


def test_a_device_that_is_not_there_is_an_error_that_says_what_to_install() -> None:
    with pytest.raises(
        PluginError, match=r"no OpenGL 3\.3 context \(device 999\).*apt install libegl1 libgl1-mesa-dri"
    ):
        open_context(999)


@pytest.mark.parametrize("varying", [frozenset(), frozenset({"base_color"}), frozenset(MATERIAL_CHANNELS)])
@pytest.mark.parametrize("count", range(1, len(CHANNELS) + 1))
def test_any_number_of_channels_fits_few_attachments(count: int, varying: frozenset[str]) -> None:
    names = list(CHANNELS)
    for start in range(len(names)):
        layout = layout_for(frozenset((names + names)[start : start + count]), varying)
        assert len(layout.attachments) <= 5
        assert all(attachment.components <= 4 for attachment in layout.attachments)
        assert len(layout.channels) == count


def test_an_empty_scene_gives_the_clear_values(build: Build) -> None:
    buffer = build(scenes.world_of([])).render(scenes.front_view())
    buffer.validate()
    for name, channel in CHANNELS.items():
        assert (buffer.arrays[name] == channel.clear).all(), name


def test_background_pixels_hold_the_clear_values(build: Build) -> None:
    world = scenes.world_of([(scenes.quad(half=0.25), scenes.at())])
    buffer = build(world).render(scenes.front_view())
    buffer.validate()
    for name, channel in CHANNELS.items():
        assert (buffer.arrays[name][0, 0] == channel.clear).all(), name
        assert (buffer.arrays[name][-1, -1] == channel.clear).all(), name


def test_only_requested_channels_come_back_and_they_are_the_same(build: Build) -> None:
    producer = build(
        scenes.world_of(
            [(scenes.quad(half=0.5), scenes.at())], [Material(roughness=0.25, base_color=(0.2, 0.4, 0.6, 1))]
        )
    )
    everything = producer.render(scenes.front_view())
    for names in (("depth",), ("object_id",), ("uv", "alpha"), ("normal_geometric_world", "roughness", "base_color")):
        some = producer.render(scenes.front_view(), channels=names)
        assert set(some.arrays) == set(names)
        for name in names:
            np.testing.assert_array_equal(some.arrays[name], everything.arrays[name])


def test_an_unknown_channel_is_named_with_the_allowed_ones(build: Build) -> None:
    producer = build(scenes.world_of([]))
    with pytest.raises(ValueError, match="unknown G-buffer channel 'dept'; allowed: depth, position_world"):
        producer.render(scenes.front_view(), channels=("dept",))


def test_render_before_build_and_after_close_say_so() -> None:
    producer = ModernglProducer()
    with pytest.raises(ValueError, match=r"before build\(world\)"):
        producer.render(scenes.front_view())
    producer.close()
    producer.close()
    with pytest.raises(RuntimeError, match="was closed"):
        producer.render(scenes.front_view())


def test_use_from_another_thread_raises_instead_of_crashing(build: Build) -> None:
    producer = build(scenes.world_of([(scenes.quad(), scenes.at())]))
    caught: list[BaseException] = []

    def other() -> None:
        try:
            producer.render(scenes.front_view())
        except RuntimeError as error:
            caught.append(error)

    thread = threading.Thread(target=other, name="elsewhere")
    thread.start()
    thread.join()
    assert "made on thread 'MainThread' and is used on 'elsewhere'" in str(caught[0])


def test_several_producers_on_one_thread_do_not_mix(build: Build) -> None:
    near = build(scenes.world_of([(scenes.quad(), scenes.at())]))
    far = build(scenes.world_of([(scenes.quad(half=4), scenes.at(z=-3))]))
    for _ in range(2):
        assert near.render(scenes.front_view()).depth[30, 30] == pytest.approx(2.0, rel=1e-6)
        assert far.render(scenes.front_view()).depth[30, 30] == pytest.approx(5.0, rel=1e-6)


def test_sizes_may_alternate_and_few_framebuffers_are_kept(build: Build) -> None:
    producer = build(scenes.world_of([(scenes.quad(), scenes.at())]))
    for width in (16, 33, 8, 24, 40, 48, 56, 16):
        buffer = producer.render(scenes.front_view(width=width, height=width), channels=("depth", "uv"))
        assert buffer.depth.shape == (width, width)
        assert buffer.uv[0, 0] == pytest.approx([0.5 / width] * 2, abs=1e-5)
    assert len(producer._targets) == KEPT_TARGETS


def test_a_frame_that_is_kept_is_not_overwritten_by_the_next(build: Build) -> None:
    world = scenes.world_of([(scenes.quad(), scenes.at())])
    producer = build(world)
    first = producer.render(scenes.front_view(), channels=("depth",))
    kept = first.depth.copy()
    world.set_object_matrix(1, scenes.at(z=-1))
    producer.update(world, world.advance(0.0))
    assert producer.render(scenes.front_view(), channels=("depth",)).depth[32, 32] == pytest.approx(3.0, rel=1e-6)
    np.testing.assert_array_equal(first.depth, kept)


def test_building_again_replaces_the_world(build: Build) -> None:
    producer = build(scenes.world_of([(scenes.quad(), scenes.at())]))
    producer.render(scenes.front_view())
    producer.build(scenes.world_of([(scenes.quad(half=9), scenes.at(z=-8))]))
    assert producer.render(scenes.front_view()).depth[5, 5] == pytest.approx(10.0, rel=1e-6)


def test_culling_changes_no_pixel(build: Build) -> None:
    rng = np.random.default_rng(7)
    placed = [(scenes.sphere(40, 0.5), scenes.at(*rng.uniform(-4, 4, 3))) for _ in range(40)]
    world = scenes.world_of(placed)
    culled, whole = build(world), build(world, cull=False)
    for eye in ((0, 0, 6), (3, 1, 0), (0.2, 0.1, 0.3)):
        view = scenes.front_view(world_from_view=look_at(eye, (-1, 0.5, 0)))
        a, b = culled.render(view), whole.render(view)
        np.testing.assert_array_equal(a.primitive_id, b.primitive_id)
        np.testing.assert_allclose(a.depth, b.depth, rtol=1e-6)
        assert (a.object_id > 0).any()


def test_the_near_plane_keeps_its_precision_far_away(build: Build) -> None:
    # Two quads 2 cm apart at 2 km, near 1 cm: 24 bits of depth alone would tear them.
    mesh = scenes.quad(half=2000)
    producer = build(
        scenes.world_of([(mesh, scenes.at(z=-2000.02)), (mesh, scenes.at(z=-2000.0)), (mesh, scenes.at(z=-2000.04))])
    )
    assert (producer.render(scenes.front_view(near=0.01)).object_id == 2).all()


def test_many_triangles_keep_their_ids_through_the_drawing_order(build: Build) -> None:
    # 64 x 64 cells of two triangles, materials scattered over them: every pixel sees the cell below it.
    n = 64
    x, y = np.meshgrid(np.arange(n + 1), np.arange(n + 1))
    positions = np.stack([x / n * 2 - 1, 1 - y / n * 2, 0 * x], -1).reshape(-1, 3).astype(np.float32)
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)[None]).reshape(-1)
    triangles = np.stack([np.stack([a, a + n + 1, a + n + 2], -1), np.stack([a, a + n + 2, a + 1], -1)], 1).reshape(
        -1, 3
    )
    material = np.random.default_rng(3).integers(-1, 3, len(triangles)).astype(np.int32)
    mesh = Mesh(
        "grid",
        positions,
        triangles.astype(np.int32),
        material,
        normals=np.tile(np.float32([0, 0, 1]), (len(positions), 1)),
    )
    world = scenes.world_of(
        [(mesh, scenes.at())], [Material(roughness=0.1), Material(roughness=0.2), Material(roughness=0.3)]
    )
    # A quarter pixel right keeps centres off the diagonals: all see the upper right triangle of their cell.
    buffer = build(world).render(scenes.front_view(jitter=(0.25, 0.0)))
    expected = np.arange(n * n).reshape(n, n) * 2 + 1
    np.testing.assert_array_equal(buffer.primitive_id, expected)
    np.testing.assert_array_equal(buffer.material_id, material[expected] + 1)
    np.testing.assert_allclose(buffer.roughness, np.array([1.0, 0.1, 0.2, 0.3])[material[expected] + 1], rtol=1e-6)


def test_every_triangle_gets_a_last_corner_of_its_own_and_keeps_its_winding() -> None:
    # A fan around vertex 0 and a second object; row numbers run backwards.
    triangles = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1], [0, 1, 2], [5, 6, 7], [5, 7, 6]], np.int32)
    owner = np.array([1, 1, 1, 1, 1, 2, 2], np.int32)
    row = np.arange(len(triangles))[::-1].astype(np.int32)
    result = own_corners(triangles, row, owner, 9, 2)
    last = result.triangles[:, 2]
    assert len(set(last.tolist())) == len(triangles)
    np.testing.assert_array_equal(result.vertex_row[last], row)
    source = np.concatenate([np.arange(9), result.copies])[result.triangles]
    turns = [np.roll(source, k, axis=1) for k in range(3)]
    assert np.any([(turn == triangles).all(axis=1) for turn in turns], axis=0).all()
    np.testing.assert_array_equal(np.diff(result.first_copy)[1:], np.bincount(owner[last >= 9], minlength=3)[1:])


def test_doubled_vertices_move_with_their_object(build: Build) -> None:
    # Every triangle of this fan but a few shares its vertices, so that most last corners are copies.
    ring = np.linspace(0, 2 * np.pi, 7)[:-1]
    positions = np.concatenate([np.zeros((1, 3)), np.stack([np.cos(ring), np.sin(ring), 0 * ring], -1) * 0.4]).astype(
        np.float32
    )
    fan = np.array([[0, 1 + k, 1 + (k + 1) % 6] for k in range(6)] * 3, np.int32)
    normals = np.tile(np.float32([0, 0, 1]), (7, 1))
    mesh = Mesh("fan", positions, fan, np.zeros(len(fan), np.int32), normals=normals)
    world = scenes.world_of([(mesh, scenes.at(x=-0.5)), (mesh, scenes.at(x=0.5))])
    producer = build(world)
    before = producer.render(scenes.front_view(), channels=("object_id", "position_world"))
    world.set_object_matrix(2, scenes.at(x=0.5, y=0.25))
    producer.update(world, world.advance(0.0))
    after = producer.render(scenes.front_view(), channels=("object_id", "position_world"))
    np.testing.assert_array_equal(after.object_id[:-8, 32:], before.object_id[8:, 32:])
    np.testing.assert_array_equal(after.object_id[:, :32], before.object_id[:, :32])
    moved = after.object_id[:-8, 32:] == 2
    expected = before.position_world[8:, 32:][moved] + [0, 0.25, 0]
    np.testing.assert_allclose(after.position_world[:-8, 32:][moved], expected, atol=2e-6)
