"""The shipped atrium: a colonnaded courtyard, open to the sky, with vaulted galleries round it, made from parameters.

Options (`phrt_plugins.loaders.options.AtriumOptions`): bays_x, bays_z, storeys, detail, seed, statues, spheres. Equal
options give equal models. Every column, arch, vault, wall bay, drape, statue and sphere is a node of its own under
/columns, /arches, /vaults, ...; nodes of one kind share their meshes. The courtyard's floor is y = 0 and its centre the
origin.

Example, in a scene descriptor::

    /atrium: {type: Reference, loader: atrium, options: {bays_x: 6, bays_z: 4}}
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from phrt.interfaces.loader import LoadContext, Loader
from phrt.model import Model, Node
from phrt_plugins.loaders import atrium_architecture as architecture
from phrt_plugins.loaders import atrium_furniture as furniture
from phrt_plugins.loaders import atrium_statues as statues
from phrt_plugins.loaders.atrium_architecture import Detail
from phrt_plugins.loaders.atrium_materials import DYES, GLASS_TINTS, make_materials
from phrt_plugins.loaders.atrium_places import place_spheres, place_statues
from phrt_plugins.loaders.atrium_plan import BAY, LOWER_COLUMN, SIDES, STEP, VAULT, WALL, Plan, Storey
from phrt_plugins.loaders.atrium_textures import paint_textures
from phrt_plugins.loaders.meshing import build_mesh
from phrt_plugins.loaders.options import AtriumOptions
from phrt_plugins.loaders.shapes import Array, Part, box, sphere, translation, turn_y

WALL_KINDS = (("plain", "niche", "door", "niche"), ("window", "plain", "door", "plain"))
"""Which wall stands behind bay i, by storey (ground, above): repeated along each side."""


class AtriumLoader(Loader):
    def __init__(self, options: AtriumOptions) -> None:
        self.options = options

    def load(self, path: Path, context: LoadContext) -> Model:
        """The atrium of the options; `path` is not read."""
        return build_atrium(self.options)


def build_atrium(options: AtriumOptions) -> Model:
    """The whole model: the building from the ground up, then what stands in it."""
    plan = Plan(options.bays_x, options.bays_z, options.storeys)
    builder = Builder(options)
    add_floors(builder, plan)
    for level in plan.levels():
        add_colonnade(builder, plan, level)
        add_walls(builder, plan, level)
    add_roofs(builder, plan)
    add_fountain(builder)
    add_drapes(builder, plan)
    add_lanterns(builder, plan)
    add_pots(builder, plan)
    add_statues(builder, plan, options.statues)
    add_spheres(builder, plan, options.spheres)
    return builder.model


class Builder:
    """Collects nodes under named groups and builds every mesh once, by name."""

    def __init__(self, options: AtriumOptions) -> None:
        images = paint_textures(options.seed)
        self.model = Model(images=images, materials=make_materials(images))
        self.material_row = {material.name: row for row, material in enumerate(self.model.materials)}
        self.detail = Detail(options.detail)
        self.random = np.random.default_rng(options.seed + 1)
        self.groups: dict[str, int] = {}
        self.mesh_rows: dict[str, int] = {}
        self.counts: dict[str, int] = {}

    def mesh(self, name: str, make: Callable[[], list[Part]]) -> int:
        """Row of mesh `name`; `make` is called the first time."""
        if name not in self.mesh_rows:
            self.mesh_rows[name] = len(self.model.meshes)
            self.model.meshes.append(build_mesh(name, make(), self.material_row))
        return self.mesh_rows[name]

    def add(self, group: str, matrix: Array, mesh: int, name: str | None = None) -> None:
        """A node /`group`/`name` with that mesh; nameless ones are numbered within the group."""
        if group not in self.groups:
            self.groups[group] = len(self.model.nodes)
            self.model.nodes.append(Node(group))
        if name is None:
            stem = group[:-1] if group.endswith("s") else group
            name = f"{stem.replace('arche', 'arch')}_{self.counts.get(group, 0):02d}"
        self.counts[group] = self.counts.get(group, 0) + 1
        self.model.nodes.append(Node(name, self.groups[group], np.array(matrix, dtype=np.float64), [mesh]))


def add_floors(builder: Builder, plan: Plan) -> None:
    size = (2 * plan.half_x, 0.2, 2 * plan.half_z)
    court = builder.mesh("court_floor", lambda: [box("floor_tiles", size, (0, -0.1, 0))])
    builder.add("floors", np.eye(4), court, "court")
    for side, name in enumerate(SIDES):
        length, corners = plan.length(side), side % 2 == 0
        mesh = builder.mesh(f"gallery_floor_{side % 2}", partial(architecture.gallery_floor, length, corners))
        builder.add("floors", plan.side_frame(side), mesh, f"gallery_{name}")
    inlay = builder.mesh("inlay", lambda: furniture.floor_inlay(builder.detail, 1.7, 2.5))
    builder.add("floors", np.eye(4), inlay, "inlay")


def add_colonnade(builder: Builder, plan: Plan, level: Storey) -> None:
    """Columns, arches, vaults (ground floor), balustrades (above) and the cornices of one storey."""
    ground, detail = level.index == 0, builder.detail
    order = architecture.lower_column if ground else architecture.upper_column
    column = builder.mesh(f"column_{int(not ground)}", lambda: order(level.column, detail))
    for frame in plan.column_frames(level.floor):
        builder.add("columns", frame, column)
    arch = builder.mesh(
        f"arch_{int(not ground)}", lambda: architecture.arcade_arch(level.height - level.column, detail)
    )
    for side in range(4):
        for bay in range(plan.bays(side)):
            builder.add("arches", plan.bay_frame(side, bay, level.spring), arch)
            if not ground:
                rail = builder.mesh("balustrade", lambda: architecture.balustrade(detail))
                builder.add("balustrades", plan.bay_frame(side, bay, level.floor), rail)
        length = plan.length(side)
        cornice = builder.mesh(f"cornice_{side % 2}", partial(architecture.cornice, length))
        builder.add(
            "cornices",
            plan.side_frame(side) @ translation(0, level.top - 0.16),
            cornice,
            f"{SIDES[side]}_{level.index}",
        )
    if level.index < plan.storeys - 1:
        vault = builder.mesh(
            f"vault_{int(not ground)}", lambda: architecture.groin_vault(level.column, level.height, detail)
        )
        for side in range(4):
            for bay in range(plan.bays(side) + 1):
                builder.add("vaults", plan.bay_frame(side, bay, level.floor), vault)


def add_walls(builder: Builder, plan: Plan, level: Storey) -> None:
    """The outer wall, bay by bay, and solid piers at its corners."""
    ground = level.index == 0
    for side in range(4):
        for bay in range(-1, plan.bays(side) + 1):
            corner = bay in (-1, plan.bays(side))
            kind = "plain" if corner else WALL_KINDS[int(not ground)][(bay + side) % 4]
            mesh = builder.mesh(
                f"wall_{kind}_{int(not ground)}", partial(architecture.wall, level.height, kind, builder.detail)
            )
            builder.add("walls", plan.bay_frame(side, bay, level.floor), mesh)
        pier = builder.mesh(
            f"pier_{int(not ground)}",
            lambda: [box("stone_blocks", (WALL, level.height, WALL), (0, level.height / 2, 0))],
        )
        outside = translation(-BAY * 1.5 - WALL / 2, 0, -BAY - WALL / 2)
        builder.add("piers", plan.bay_frame(side, 0, level.floor) @ outside, pier)


def add_roofs(builder: Builder, plan: Plan) -> None:
    """Lean-to roofs with their tiles, over a timbered ceiling."""
    top = plan.levels()[-1].top
    for side, name in enumerate(SIDES):
        length, frame = plan.length(side), plan.side_frame(side) @ translation(0, top)
        for group, make in (
            ("roofs", partial(architecture.roof, length)),
            ("roof_tiles", partial(architecture.roof_tiles, length, builder.detail)),
            ("beams", partial(architecture.ceiling_beams, length)),
        ):
            builder.add(group, frame, builder.mesh(f"{group}_{side % 2}", make), name)


def add_fountain(builder: Builder) -> None:
    detail = builder.detail
    for name, make in (
        ("basin", furniture.fountain_basin),
        ("water", furniture.fountain_water),
        ("bowl", furniture.fountain_bowl),
    ):
        builder.add("fountain", np.eye(4), builder.mesh(f"fountain_{name}", partial(make, detail)), name)


def add_drapes(builder: Builder, plan: Plan) -> None:
    """Tied-back curtains in the north and south arcades, banners over the balustrades of all but the south side."""
    dyes = list(DYES)
    rod_height = STEP + 3.28
    for side in (0, 2):
        for place, bay in enumerate(range(0, plan.bays(side), 2)):
            frame = plan.bay_frame(side, bay, rod_height)
            dye = dyes[(place + side) % len(dyes)]
            builder.add("drapes", frame, builder.mesh("curtain_rod", furniture.curtain_rod), f"rod_{SIDES[side]}_{bay}")
            for half, name in ((-1.0, "left"), (1.0, "right")):
                mesh = builder.mesh(
                    f"curtain_{dye}_{name}",
                    partial(furniture.curtain, builder.detail, dye, builder.random, half),
                )
                builder.add("drapes", frame, mesh, f"curtain_{SIDES[side]}_{bay}_{name}")
    if plan.storeys < 2:
        return
    rail_top = plan.levels()[1].floor + 0.96
    for side in (0, 1, 3):
        for place, bay in enumerate(range(1 if side == 0 else 0, plan.bays(side), 2 if side == 0 else 3)):
            dye = dyes[(place * 2 + side) % len(dyes)]
            mesh = builder.mesh(f"banner_{dye}", partial(furniture.banner, builder.detail, dye, builder.random))
            builder.add(
                "drapes",
                plan.bay_frame(side, bay, rail_top),
                mesh,
                f"banner_{SIDES[side]}_{bay}",
            )


def add_lanterns(builder: Builder, plan: Plan) -> None:
    """A lantern in the crown of every other ground-floor vault of the long galleries."""
    crown = STEP + LOWER_COLUMN + VAULT if plan.storeys > 1 else plan.levels()[0].top
    mesh = builder.mesh("lantern", lambda: furniture.lantern(builder.detail, 1.5))
    for side in (0, 2):
        for bay in range(1, plan.bays(side), 3):
            builder.add("lanterns", plan.bay_frame(side, bay, crown) @ translation(0, 0, -BAY / 2), mesh)


def add_pots(builder: Builder, plan: Plan) -> None:
    """Agaves in the corners of the courtyard, jars along the galleries, urns in the niches."""
    detail = builder.detail
    agave = builder.mesh("agave", lambda: furniture.potted_plant(detail, builder.random))
    for side in range(4):
        corner = plan.bay_frame(side, 0) @ translation(-BAY / 2 + 0.95, 0, 0.95)
        builder.add("plants", corner @ turn_y(side * 0.7), agave)
    jar, urn = (
        builder.mesh("jar", lambda: furniture.vase(detail, False)),
        builder.mesh("urn", lambda: furniture.vase(detail, True)),
    )
    for side in range(4):
        for bay in range(plan.bays(side)):
            kind = WALL_KINDS[0][(bay + side) % 4]
            if kind == "niche":
                builder.add("vases", plan.bay_frame(side, bay, STEP + 0.87) @ translation(0, 0, -BAY - 0.28), urn)
            elif kind == "plain":
                builder.add("vases", plan.bay_frame(side, bay, STEP) @ translation(0.55, 0, -BAY + 0.55), jar)


def add_statues(builder: Builder, plan: Plan, count: int) -> None:
    """Statues on plinths; each kind is one mesh, leaning one way or the other."""
    kinds = list(statues.STATUES)
    plinth = builder.mesh("plinth", statues.plinth)
    for index, frame in enumerate(place_statues(plan, count)):
        kind = kinds[index % len(kinds)]
        sway = 0.8 if (index // len(kinds)) % 2 == 0 else -0.8
        mesh = builder.mesh(f"{kind}_{sway:+.0f}", partial(statues.STATUES[kind], builder.detail, sway))
        builder.add("plinths", frame, plinth)
        builder.add("statues", frame @ translation(0, statues.PLINTH, 0), mesh, f"{kind}_{index:02d}")


def add_spheres(builder: Builder, plan: Plan, count: int) -> None:
    """Mirror and glass balls in turn; every third mirror is gold, the glass clear, amber or teal."""
    glass = list(GLASS_TINTS)
    segments = builder.detail.of(36)
    for index, (frame, radius) in enumerate(place_spheres(plan, count)):
        turn = index // 2
        material = ("gold" if turn % 3 == 2 else "mirror") if index % 2 == 0 else glass[(0, 1, 0, 2)[turn % 4]]
        mesh = builder.mesh(f"ball_{material}_{radius:g}", partial(ball, radius, segments, material))
        name = f"{'mirror' if index % 2 == 0 else 'glass'}_{turn:02d}"
        builder.add("spheres", frame @ translation(0, radius, 0), mesh, name)


def ball(radius: float, segments: int, material: str) -> list[Part]:
    return [sphere(radius, segments, material)]


__all__ = ["AtriumLoader", "build_atrium"]
