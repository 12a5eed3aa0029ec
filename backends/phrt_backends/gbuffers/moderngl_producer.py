"""The `moderngl` G-buffer producer: a deferred OpenGL 3.3 pass with mipmapped textures, headless by EGL.

Works on a GPU and on Mesa's llvmpipe. One pass draws into as many float32 attachments as the requested channels need
(`moderngl_layout`), with a shader variant per set of channels and material features; nothing that was not asked for is
drawn or read back. `("depth",)` alone draws positions into one float: the fast path of shadow maps.

Row 0 of our pictures is the top one and OpenGL's the bottom one, so the projection is flipped in y; front faces are
then clockwise on the screen.

Depth comparison is OpenGL's 24 bit: two surfaces nearer than about depth^2 / (2^24 near) cannot be told apart. The near
plane is therefore moved out to the nearest cluster in view (nothing lies between) while drawing.

An OpenGL context belongs to one thread: a producer is used on the thread that made it, or `RuntimeError` says so.
Several producers may live on one thread; each has its own context.

Example: `producer = ModernglProducer(ModernglOptions()); producer.build(world); producer.render(world.view(640, 360))`
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from phrt.buffers import BufferPool
from phrt.camera import CameraView
from phrt.channels import CHANNELS, GBuffer
from phrt.interfaces.gbuffer import GBufferProducer
from phrt.kernels.motion import motion_vectors
from phrt.world import Changes, World
from phrt_backends.gbuffers.moderngl_context import ThreadGuard, open_context
from phrt_backends.gbuffers.moderngl_geometry import DrawGeometry, Visible
from phrt_backends.gbuffers.moderngl_layout import Layout, checked_channels, layout_for, unpack
from phrt_backends.gbuffers.moderngl_materials import DrawState, MaterialSet, varying_channels
from phrt_backends.gbuffers.moderngl_options import ModernglOptions
from phrt_backends.gbuffers.moderngl_resolve import CODE_BITS, resolve_constants, resolve_normals, resolve_points
from phrt_backends.gbuffers.moderngl_shaders import SAMPLERS, fragment_source, vertex_source

FLIP_Y = np.diag([1.0, -1.0, 1.0, 1.0])
KEPT_TARGETS = 6


@dataclass
class Target:
    """A framebuffer of one size and layout, and the host memory its attachments are read into."""

    framebuffer: Any
    resources: list[Any]
    packed: list[np.ndarray]


@dataclass
class Past:
    """Where things were in the previous frame: unjittered clip_from_world (4, 4), and object_matrix (N + 1, 4, 4)."""

    clip_from_world: np.ndarray
    object_matrix: np.ndarray


@dataclass
class Variant:
    """A compiled program with the vertex array that feeds it."""

    program: Any
    vertex_array: Any
    view_set: int = -1

    def put(self, name: str, value: object) -> None:
        """Set uniform `name` if the compiler kept it."""
        if name in self.program:
            self.program[name].value = value

    def put_matrix(self, name: str, matrix: np.ndarray) -> None:
        """Set matrix uniform `name` from row-major (4, 4) if the compiler kept it."""
        if name in self.program:
            self.program[name].write(matrix.T.astype(np.float32).tobytes())


class ModernglProducer(GBufferProducer):
    """Rasterizes with OpenGL. See the module's text for threads, precision and orientation.

    Motion looks back to the previous `render` that asked for motion with the same `hidden`; zero in the first.
    """

    def __init__(self, options: ModernglOptions | None = None) -> None:
        self._options = options or ModernglOptions()
        self._guard = ThreadGuard()
        self._gl: Any = open_context(self._options.device)
        self._world: World | None = None
        self._geometry: DrawGeometry | None = None
        self._materials: MaterialSet | None = None
        self._targets: dict[tuple[int, int, Layout], Target] = {}
        self._variants: dict[tuple[frozenset[str], Layout], Variant] = {}
        self._states: dict[frozenset[str], tuple[list[DrawState], np.ndarray]] = {}
        self._past: dict[bytes, Past] = {}
        self._varying: frozenset[str] = frozenset()
        self._buffers = BufferPool()
        self._renders = 0

    def build(self, world: World) -> None:
        """Upload geometry, materials and textures of `world`, in place of what was there."""
        with self._current():
            self._release_world()
            self._world = world
            self._varying = varying_channels(world)
            if len(world.triangles):
                self._geometry = DrawGeometry(self._gl, world)
                self._materials = MaterialSet(self._gl, world)

    def update(self, world: World, changes: Changes) -> None:
        """Rewrite the vertex ranges of `changes.objects`, and the corners' order of `changes.turned`."""
        if changes.objects and self._geometry is not None:
            with self._current():
                self._geometry.update(world, changes)

    def render(
        self,
        view: CameraView,
        *,
        channels: Iterable[str] = tuple(CHANNELS),
        hidden: np.ndarray | None = None,
        pixels: np.ndarray | None = None,
    ) -> GBuffer:
        """The G-buffer of `view` with exactly `channels`, all pixels of it: `pixels` would not make it cheaper.

        Raises `ValueError` for unknown channels or before `build`.
        """
        wanted = checked_channels(channels)
        with self._current():
            if self._world is None:
                raise ValueError("the moderngl producer was asked to render before build(world)")
            layout = layout_for(wanted, self._varying)
            target = self._target(view.width, view.height, layout)
            target.framebuffer.use()
            target.framebuffer.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
            if self._geometry is not None:
                self._draw(view, layout, hidden)
            buffer = self._read(view, layout, target)
        if "motion" in wanted:
            self._motion(view, buffer, target.packed[0], b"" if hidden is None else hidden.tobytes())
        return buffer

    def gl_error(self) -> str:
        """OpenGL's error flag, 'GL_NO_ERROR' when all is well; reading clears it."""
        with self._current():
            return str(self._gl.error)

    def close(self) -> None:
        """Release everything and the context itself. A second call does nothing."""
        if self._gl is None:
            return
        with self._current():
            self._release_world()
            for target in self._targets.values():
                _release(target)
            self._targets.clear()
        self._gl.release()
        self._gl = None

    @contextmanager
    def _current(self) -> Iterator[None]:
        """Our context made current, and the one that was before restored; on our thread only."""
        self._guard.check()
        if self._gl is None:
            raise RuntimeError("the moderngl producer was closed")
        with self._gl:
            yield

    def _release_world(self) -> None:
        for variant in self._variants.values():
            variant.vertex_array.release()
            variant.program.release()
        self._variants.clear()
        self._states.clear()
        self._past.clear()
        if self._geometry is not None and self._materials is not None:
            self._geometry.release()
            self._materials.release()
        self._geometry = self._materials = self._world = None

    # Drawing

    def _draw(self, view: CameraView, layout: Layout, hidden: np.ndarray | None) -> None:
        geometry, materials = self._geometry, self._materials
        assert geometry is not None
        assert materials is not None
        depth_row = -view.view_from_world()[2]
        drawn = np.ones(len(geometry.cluster_object), bool) if hidden is None else ~hidden[geometry.cluster_object]
        visible = geometry.visible(view.clip_from_world(), depth_row, drawn, self._options.cull)
        if not len(visible.clusters):
            return
        clip = FLIP_Y @ _tightened(view, visible).clip_from_world()
        states, state_of_material = self._draw_states(layout)

        # Neighbouring clusters that need the same state are one draw. Drawing near ones first was measured: on llvmpipe
        # the extra changes of state cost more (10 ms of 67) than the hidden pixels that are not shaded bring.
        clusters = visible.clusters
        state = state_of_material[geometry.cluster_material[clusters]]
        first, rows = geometry.cluster_first[clusters], geometry.cluster_rows[clusters]
        cut = (np.diff(state) != 0) | (first[1:] != first[:-1] + rows[:-1])
        starts = np.concatenate([[0], np.flatnonzero(cut) + 1])
        counts = np.add.reduceat(rows, starts)

        gl = self._gl
        gl.enable_only(gl.DEPTH_TEST | gl.CULL_FACE)
        gl.front_face, gl.cull_face = "cw", "back"
        self._renders += 1
        bound_state, variant, culls = -1, None, True
        for start, count in zip(starts.tolist(), counts.tolist(), strict=True):
            if variant is None or state[start] != bound_state:
                bound_state = int(state[start])
                variant = self._variant(states[bound_state], layout, view.orthographic)
                materials.bind(states[bound_state])
                if variant.view_set != self._renders:
                    variant.view_set = self._renders
                    variant.put_matrix("clip_from_world", clip)
                    variant.put("depth_row", tuple(float(x) for x in depth_row))
                if culls == states[bound_state].double_sided:
                    culls = not culls
                    (gl.enable if culls else gl.disable)(gl.CULL_FACE)
            variant.vertex_array.render(gl.TRIANGLES, vertices=3 * count, first=3 * int(first[start]))

    def _draw_states(self, layout: Layout) -> tuple[list[DrawState], np.ndarray]:
        """The distinct states of all materials for `layout`, and (materials,) which one each needs."""
        channels = layout.drawn
        if channels not in self._states:
            assert self._materials is not None
            assert self._world is not None
            index: dict[DrawState, int] = {}
            of_material = [
                index.setdefault(self._materials.state(row, channels), len(index))
                for row in range(len(self._world.materials))
            ]
            self._states[channels] = (list(index), np.array(of_material, np.int32))
        return self._states[channels]

    def _variant(self, state: DrawState, layout: Layout, orthographic: bool) -> Variant:
        features = state.features | {"ORTHOGRAPHIC"} if orthographic else state.features
        key = (features, layout)
        if key not in self._variants:
            assert self._geometry is not None
            program = self._gl.program(
                vertex_shader=vertex_source(features), fragment_shader=fragment_source(features, layout)
            )
            content = [
                (buffer, self._geometry.formats[name], name)
                for name, buffer in self._geometry.buffers.items()
                if name in program
            ]
            indices = self._geometry.indices if "in_row" in program else self._geometry.shared_indices
            vertex_array = self._gl.vertex_array(program, content, index_buffer=indices, index_element_size=4)
            variant = Variant(program, vertex_array)
            for unit, slot in enumerate(SAMPLERS):
                variant.put(slot, unit)
            if "Material" in program:
                program["Material"].binding = 0
            self._variants[key] = variant
        return self._variants[key]

    # Targets and reading back

    def _target(self, width: int, height: int, layout: Layout) -> Target:
        """The framebuffer for this size and layout; the few used last are kept."""
        key = (width, height, layout)
        target = self._targets.pop(key, None) or self._new_target(width, height, layout)
        self._targets[key] = target
        while len(self._targets) > KEPT_TARGETS:
            _release(self._targets.pop(next(iter(self._targets))))
        return target

    def _new_target(self, width: int, height: int, layout: Layout) -> Target:
        gl, size = self._gl, (width, height)
        colors = [gl.texture(size, attachment.components, dtype="f4") for attachment in layout.attachments]
        packed = [np.empty((width * height, attachment.components), np.float32) for attachment in layout.attachments]
        depth = gl.depth_renderbuffer(size)
        return Target(gl.framebuffer(colors, depth), [*colors, depth], packed)

    def _read(self, view: CameraView, layout: Layout, target: Target) -> GBuffer:
        """Read the attachments of `target` and turn them into the channels of `layout`, motion excepted."""
        buffer = GBuffer(view.width, view.height)
        for name in layout.channels:
            channel = CHANNELS[name]
            buffer.arrays[name] = self._buffers.take(channel.shape(view.height, view.width), channel.dtype)
        for i, (attachment, packed) in enumerate(zip(layout.attachments, target.packed, strict=True)):
            target.framebuffer.read_into(
                packed, components=attachment.components, attachment=i, alignment=1, dtype="f4"
            )
            for name, first in attachment.parts:
                if name == "inverse_depth":
                    with np.errstate(divide="ignore"):
                        np.divide(np.float32(1.0), packed[:, 0], out=buffer.flat("depth"))
                elif name == "point":
                    self._resolve_points(view, layout, packed, buffer)
                elif name == "normal_uv":
                    bits = target.packed[0].view(np.uint32)
                    resolve_normals(packed, bits, _flat_or_none(buffer, "normal_world"), _flat_or_none(buffer, "uv"))
                else:
                    unpack(name, first, packed, buffer.flat(name))
        return buffer

    def _resolve_points(self, view: CameraView, layout: Layout, packed: np.ndarray, buffer: GBuffer) -> None:
        """Position, depth, ids, triangle normals and what is one value a material, from packed (pixels, 4)."""
        geometry, materials = self._geometry, self._materials
        if geometry is None or materials is None:
            for name, array in buffer.arrays.items():
                array.fill(CHANNELS[name].clear)
            return
        material_id = _flat_or_none(buffer, "material_id")
        if layout.constants and not len(material_id):
            material_id = self._buffers.take((view.width * view.height,), np.uint32)
        resolve_points(
            packed,
            packed.view(np.uint32),
            view.world_from_view[:3, 3].astype(np.float32),
            -view.world_from_view[:3, 2].astype(np.float32),
            geometry.row_object,
            geometry.row_primitive,
            geometry.row_material,
            geometry.code_normal,
            _flat_or_none(buffer, "position_world"),
            _flat_or_none(buffer, "depth"),
            _flat_or_none(buffer, "object_id"),
            _flat_or_none(buffer, "primitive_id"),
            material_id,
            _flat_or_none(buffer, "normal_geometric_world"),
        )
        for name in layout.constants:
            resolve_constants(material_id, materials.constant(name), buffer.flat(name).reshape(len(material_id), -1))

    def _motion(self, view: CameraView, buffer: GBuffer, packed: np.ndarray, hidden: bytes) -> None:
        """Fill `motion` from packed (pixels, 4), points with codes, and remember this picture for the next."""
        assert self._world is not None
        clip, matrix = view.with_jitter(0.0, 0.0).clip_from_world().astype(np.float32), self._world.object_matrix
        past = self._past.get(hidden)
        self._past[hidden] = Past(clip, matrix.copy())
        moved = np.zeros(len(matrix), bool) if past is None else (past.object_matrix != matrix).any(axis=(1, 2))
        if past is None or self._geometry is None or not (moved.any() or (past.clip_from_world != clip).any()):
            buffer.motion.fill(0.0)
            return
        delta = np.tile(np.eye(4, dtype=np.float32), (len(matrix), 1, 1))
        for object_id in np.flatnonzero(moved):
            delta[object_id] = past.object_matrix[object_id] @ np.linalg.pinv(matrix[object_id])
        object_id = self._geometry.row_object[(packed[:, 3].view(np.uint32) & CODE_BITS) >> np.uint32(1)]
        size = np.array([view.width, view.height], np.float32)
        motion_vectors(packed, object_id, delta, clip, past.clip_from_world, size, buffer.flat("motion"))


def _flat_or_none(buffer: GBuffer, name: str) -> np.ndarray:
    """Channel `name` with its pixels in one row, or an array of length 0 where it was not asked for."""
    if name in buffer.arrays:
        return buffer.flat(name)
    channel = CHANNELS[name]
    return np.empty(0 if channel.components == 1 else (0, channel.components), channel.dtype)


def _tightened(view: CameraView, visible: Visible) -> CameraView:
    """`view` with near and far planes as close around what is visible as they may be, which spares depth precision."""
    near = max(view.near, visible.nearest - 1e-3 * abs(visible.nearest))
    far = visible.farthest + 1e-3 * abs(visible.farthest)
    far = min(view.far, max(far, near + 1e-3 * max(abs(near), 1.0)))
    if not view.orthographic and not math.isfinite(view.far):
        far = math.inf
    return replace(view, near=near, far=far)


def _release(target: Target) -> None:
    target.framebuffer.release()
    for resource in target.resources:
        resource.release()
