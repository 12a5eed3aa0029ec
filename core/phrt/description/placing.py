"""Placing a model file's nodes, objects, lights, cameras and animation below a Reference prim, overs applied."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from phrt.description.convert import changed_lens, changed_light
from phrt.description.inherited import Inherited, prim_name, warn_of_unknown_effects
from phrt.description.motion import animation_tracks, matrix_of
from phrt.description.prims import CameraOver, LightOver, ModelOver, ReferencePrim
from phrt.description.validation import validated
from phrt.description.values import Value
from phrt.errors import did_you_mean
from phrt.model import Model, Node, Track
from phrt.scene import SceneCamera, SceneLight

if TYPE_CHECKING:
    from phrt.description.build import Builder


LONGEST_PATH = 4096
"""Characters. A chain of nodes has paths whose lengths add up to the square of its depth."""


@dataclass(frozen=True)
class Placement:
    """A model and the Reference that places it. materials: scene index of each of the model's materials."""

    model: Model
    prim: ReferencePrim
    materials: list[int]


class ModelPlacer:
    """Puts models into the scene that `builder` makes."""

    def __init__(self, builder: Builder) -> None:
        self._builder = builder
        self._known: list[str] = list(builder.materials)
        self._unused: dict[str, Value] = dict(builder.stage.overs)

    def place(self, path: str, node: int, model: Model, state: Inherited, prim: ReferencePrim) -> None:
        """Everything of `model` below scene node `node`, whose prim is `prim` at `path`."""
        builder = self._builder
        scene = builder.scene
        placement = Placement(model, prim, builder.model_materials[path])
        nodes: list[int | None] = []
        paths: list[str] = []
        states: list[Inherited] = []
        tracks: dict[int, list[Track]] = {}
        for track in model.tracks:
            tracks.setdefault(track.node, []).append(track)
        for index, entry in enumerate(model.nodes):
            root = entry.parent < 0
            own_path = builder.unique_path(f"{path if root else paths[entry.parent]}/{_name(entry, index)}")
            if len(own_path) > LONGEST_PATH:
                message = f"its nodes are nested too deeply: a path has more than {LONGEST_PATH} characters"
                builder.problems.add(builder.stage.prims[path].mark, path, message)
                return
            self._known.append(own_path)
            paths.append(own_path)
            parent = node if root else nodes[entry.parent]
            above = state if root else states[entry.parent]
            over, own_state = self._over(own_path, entry, above)
            states.append(own_state)
            if parent is None or (over is not None and not over.visible):
                nodes.append(None)
                continue
            placed = over is not None and over.xform is not None
            matrix = matrix_of(over.xform) if over is not None and placed else np.asarray(entry.matrix, np.float64)
            number = builder.add_node(own_path, parent, matrix)
            nodes.append(number)
            if over is not None and over.xform is not None and over.xform.animation is not None:
                scene.tracks.extend(animation_tracks(over.xform.animation, number))
            self._contents(own_path, number, entry, placement, own_state, over)
            if not placed:
                scene.tracks.extend(replace(track, node=number) for track in tracks.get(index, ()))

    def _over(self, path: str, node: Node, above: Inherited) -> tuple[ModelOver | None, Inherited]:
        """The checked over of a model's node, if there is one, and what holds at the node."""
        value = self._unused.pop(path, None)
        if value is None:
            return None, above
        kind = LightOver if node.light is not None else CameraOver if node.camera is not None else ModelOver
        over = validated(kind, value, path, self._builder.problems)
        if over is not None:
            warn_of_unknown_effects(over, value, path)
        return over, above if over is None else above.below(over, value)

    def _contents(
        self, path: str, number: int, node: Node, placement: Placement, state: Inherited, over: ModelOver | None
    ) -> None:
        """Objects, light and camera of one node."""
        builder = self._builder
        model = placement.model
        if node.light is not None:
            light = model.lights[node.light]
            if isinstance(over, LightOver):
                light = changed_light(light, over, state.casts_shadow)
            elif not state.casts_shadow:
                light = replace(light, casts_shadow=False)
            builder.scene.lights.append(SceneLight(path, number, light))
        if node.camera is not None:
            lens = model.cameras[node.camera]
            lens = changed_lens(lens, over) if isinstance(over, CameraOver) else lens
            builder.scene.cameras.append(SceneCamera(path, number, lens))
        for index in node.meshes:
            self._objects(path, number, index, placement, state, alone=len(node.meshes) == 1)

    def _objects(self, path: str, number: int, index: int, placement: Placement, state: Inherited, alone: bool) -> None:
        """The objects that mesh `index` becomes, at the node's path when there is but one, else below it."""
        builder = self._builder
        prim = placement.prim
        parts = builder.store.pieces(placement.model.meshes[index], prim.split)
        for part in parts:
            if alone and len(parts) == 1:
                builder.add_object(path, number, part, placement.materials, state, prim.smooth)
                continue
            part_path = builder.unique_path(f"{path}/{prim_name(part.name, f'mesh_{index}')}")
            own = self._part_state(part_path, path, state)
            if own is not None:
                builder.add_object(part_path, number, part, placement.materials, own, prim.smooth)

    def _part_state(self, part_path: str, path: str, state: Inherited) -> Inherited | None:
        """What holds for one of several objects at a node; None when an over hides it."""
        self._known.append(part_path)
        value = self._unused.pop(part_path, None)
        over = None if value is None else validated(ModelOver, value, part_path, self._builder.problems)
        if over is None or value is None:
            return state
        if over.xform is not None:
            message = f"this is a part of {path} and has no place of its own; give xform there"
            self._builder.problems.add(value.mark_of(("xform",)), part_path, message)
        return state.below(over, value) if over.visible else None

    def check_overs_used(self) -> None:
        """Overs that met nothing are problems."""
        for path, value in self._unused.items():
            hint = did_you_mean(path, self._known)
            self._builder.problems.add(value.mark, path, f"over: there is no such prim in the referenced model.{hint}")


def _name(node: Node, index: int) -> str:
    return prim_name(node.name, f"node_{index}")
