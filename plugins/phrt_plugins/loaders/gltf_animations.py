"""glTF animations as tracks of node transforms."""

from __future__ import annotations

from typing import Literal, cast

import numpy as np

from phrt.model import Track
from phrt_plugins.loaders.gltf_accessors import Accessors
from phrt_plugins.loaders.gltf_json import MAX_MAGNITUDE, Document, Element, fail
from phrt_plugins.loaders.gltf_nodes import pick

Target = Literal["translation", "rotation", "scale"]
COMPONENTS = {"translation": 3, "rotation": 4, "scale": 3}
INTERPOLATIONS: dict[str, Literal["step", "linear", "cubic"]] = {
    "STEP": "step",
    "LINEAR": "linear",
    "CUBICSPLINE": "cubic",
}


class AnimationReader:
    """Reads tracks. `model_node` maps glTF nodes to the model's; `joints` are the glTF nodes that move skins in use."""

    def __init__(self, document: Document, accessors: Accessors, model_node: dict[int, int], joints: set[int]) -> None:
        self.document = document
        self.accessors = accessors
        self.model_node = model_node
        self.joints = joints

    def read(self, wanted: int | str | None) -> list[Track]:
        """The tracks of the animation asked for, or of all; the first wins where two move the same thing."""
        animations = self.document.lists["animations"]
        chosen = animations if wanted is None else [animations[pick(animations, wanted, "animation")]]
        tracks: dict[tuple[int, str], Track] = {}
        for animation in chosen:
            samplers = animation.items("samplers")
            for channel in animation.items("channels"):
                track = self._track(channel, samplers)
                if track is None:
                    continue
                if (track.node, track.target) in tracks:
                    self.document.warn(
                        "has several animations of the same nodes; the first is played (choose with 'animation')"
                    )
                tracks.setdefault((track.node, track.target), track)
        return list(tracks.values())

    def _track(self, channel: Element, samplers: list[Element]) -> Track | None:
        """One channel; None for what is not played."""
        target, number = channel.required("target"), channel.integer("sampler")
        if number >= len(samplers):
            channel.fail("sampler", f"points at sampler {number}, but there are {len(samplers)}")
        node, path = self.document.refer(target, "node", "nodes"), target.string("path")
        if path == "weights":
            self.document.warn("animated morph weights are not played; the mesh stays at its rest pose")
        elif path not in COMPONENTS:
            self.document.warn(f"animation of '{path}' is not played")
        elif node in self.joints:
            self.document.warn("animated skin joints do not move their mesh; it stays at its rest pose")
        if path not in COMPONENTS or node is None or node not in self.model_node:
            return None
        return self._keyframes(samplers[number], self.model_node[node], cast(Target, path))

    def _keyframes(self, sampler: Element, node: int, path: Target) -> Track | None:
        name = sampler.string("interpolation", "LINEAR")
        if name not in INTERPOLATIONS:
            sampler.fail("interpolation", f"is '{name}'; it must be {', '.join(INTERPOLATIONS)}")
        times = self._read(sampler, "input", 1)[:, 0]
        values = self._read(sampler, "output", COMPONENTS[path])
        per_key = 3 if name == "CUBICSPLINE" else 1
        if len(values) != len(times) * per_key:
            fail(sampler.where, f"has {len(values)} values for {len(times)} keyframes; {name} needs {per_key} each")
        if not len(times):
            return None
        if (np.diff(times) <= 0).any():
            self.document.warn(f"{sampler.where} has times that do not increase and is not played")
            return None
        if path == "rotation" and not self._unit_quaternions(values, per_key):
            self.document.warn(f"{sampler.where} has a rotation of length zero and is not played")
            return None
        if per_key == 3:
            values = values.reshape(len(times), 3, COMPONENTS[path])
        return Track(node, path, times, values, INTERPOLATIONS[name])

    @staticmethod
    def _unit_quaternions(values: np.ndarray, per_key: int) -> bool:
        """Make the rotations unit, in place (tangents stay as they are); False where one is zero."""
        keys = values if per_key == 1 else values[1::3]
        length = np.linalg.norm(keys.astype(np.float64), axis=1, keepdims=True)
        if (length < 1e-12).any():
            return False
        if per_key == 1:
            keys[:] = keys / length
        return True

    def _read(self, sampler: Element, key: str, components: int) -> np.ndarray:
        index = self.document.refer_required(sampler, key, "accessors")
        header = self.accessors.header(index)
        if header.components != components or header.columns != 1:
            fail(header.where, f"is {header.kind}, but the animation's {key} has {components} components")
        values = self.accessors.floats(index)
        if not (np.abs(values) < MAX_MAGNITUDE).all():
            fail(header.where, f"has values beyond {MAX_MAGNITUDE:g}")
        return values
