"""One real ray through a tracer, one real triangle through a G-buffer producer: the shortest proof that they work."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import numpy as np

from phrt.registry.descriptors import GBufferPlugin
from phrt.registry.manager import RegisteredPlugin, Registry

if TYPE_CHECKING:
    from phrt.interfaces.gbuffer import GBufferProducer
    from phrt.interfaces.tracer import Tracer
    from phrt.world import World

DISTANCE_M = 2.0
TOLERANCE_M = 1e-3
PICTURE = 16


def one_triangle() -> World:
    """A world of one triangle in the plane z = -2 that covers the middle of the view and leaves its corners free."""
    from phrt.model import CameraLens, Mesh
    from phrt.scene import Scene, SceneCamera, SceneNode, SceneObject
    from phrt.world import World

    corners = np.array([[-1, -1, -DISTANCE_M], [1, -1, -DISTANCE_M], [0, 1, -DISTANCE_M]], dtype=np.float32)
    mesh = Mesh(
        name="triangle",
        positions=corners,
        triangles=np.array([[0, 1, 2]], dtype=np.int32),
        triangle_material=np.array([-1], dtype=np.int32),
    )
    scene = Scene(
        name="doctor",
        nodes=[SceneNode("/triangle", -1, np.eye(4)), SceneNode("/camera", -1, np.eye(4))],
        objects=[SceneObject("/triangle", node=0, mesh=0)],
        meshes=[mesh],
        cameras=[SceneCamera("/camera", node=1, lens=CameraLens(fov_y=1.5))],
    )
    return World(scene)


def probe_tracer(registry: Registry, entry: RegisteredPlugin) -> str:
    """Trace one ray that hits and one that misses; gives the tracer's description. Raises when an answer is wrong."""
    from phrt.rays import RayBatch

    world = one_triangle()
    tracer: Tracer = registry.create("tracer", entry.name)
    try:
        tracer.build(world)
        rays = RayBatch(
            origin=np.zeros((2, 3), np.float32),
            direction=np.array([[0, 0, -1], [0, 0, 1]], np.float32),
            t_max=np.full(2, np.inf, np.float32),
        )
        distance = tracer.closest_hit(rays).distance
        if not (abs(distance[0] - DISTANCE_M) < TOLERANCE_M and np.isposinf(distance[1])):
            raise RuntimeError(f"hits at {distance.tolist()} m, expected {DISTANCE_M} m and a miss")
        if tracer.occluded(rays).tolist() != [True, False]:
            raise RuntimeError("occlusion is wrong")
        return tracer.capabilities.description
    finally:
        tracer.close()


def probe_gbuffer(registry: Registry, entry: RegisteredPlugin, tracer_name: str) -> str:
    """Draw one triangle; gives "" or the tracer that was used. Raises when the picture is wrong."""
    from phrt.workers import Workers

    world = one_triangle()
    with ExitStack() as closing:
        dependencies: dict[str, object] = {}
        if isinstance(entry.plugin, GBufferPlugin) and entry.plugin.needs_tracer:
            tracer: Tracer = registry.create("tracer", tracer_name)
            closing.callback(tracer.close)
            tracer.build(world)
            workers = Workers(1)
            closing.callback(workers.close)
            dependencies = {"tracer": tracer, "workers": workers}
        producer: GBufferProducer = registry.create("gbuffer", entry.name, None, **dependencies)
        closing.callback(producer.close)
        producer.build(world)
        picture = producer.render(world.view(PICTURE, PICTURE))
        depth = float(picture.depth[PICTURE // 2, PICTURE // 2])
        ids = picture.object_id
        if abs(depth - DISTANCE_M) > TOLERANCE_M or ids[PICTURE // 2, PICTURE // 2] != 1 or ids[0, 0] != 0:
            raise RuntimeError(f"the triangle lies at {depth} m, expected {DISTANCE_M} m, or its outline is wrong")
    return f"rays by {tracer_name}" if dependencies else ""
