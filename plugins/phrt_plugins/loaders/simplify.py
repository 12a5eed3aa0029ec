"""Simplified objects: scenes and models whose meshes keep but a share of their triangles (Andrade et al. 2014, section 5).

Two ways to ask for it, both need the library fast-simplification:

- a whole scene, from Python and by `simplify` in a benchmark's config::

      scene = simplified(load_scene("scenes/atrium.yaml"), 0.25)

- one model, as a loader around another one, in a scene descriptor::

      /Statue: {type: Reference, loader: simplified, asset: armadillo.obj, options: {share: 0.25}}
      /Atrium: {type: Reference, loader: simplified, options: {share: 0.25, of: atrium, options: {bays_x: 6}}}

Objects stay objects: nodes, materials, tags and the order of everything are those of the original. How a mesh is simplified, and
when it is rather left alone, is said in `decimate`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from phrt.errors import AssetError, OptionError
from phrt.faults.loading import load_model
from phrt.interfaces.loader import LoadContext, Loader
from phrt.model import Mesh, Model
from phrt.registry import get_registry
from phrt.scene import Scene
from phrt_plugins.loaders.decimate import decimated
from phrt_plugins.loaders.options import SimplifiedOptions
from phrt_plugins.packages import simplification_reason


@dataclass(frozen=True)
class Simplification:
    """What became of meshes. before, after: triangles of all of them. left: names of those that kept every triangle."""

    before: int
    after: int
    meshes: int
    left: tuple[str, ...]

    def __str__(self) -> str:
        return (
            f"{self.after} of {self.before} triangles kept ({self.after / max(self.before, 1):.0%}); "
            f"{len(self.left)} of {self.meshes} meshes as they were"
        )


def simplified(scene: Scene, share: float) -> Scene:
    """`scene` whose meshes keep about `share` (above 0, at most 1) of their triangles each; `scene` itself for 1.

    Meshes that cannot be simplified without harm keep more, or all: `simplification(scene, result)` counts them. Raises OptionError
    for another share, and where fast-simplification is missing.
    """
    return scene if check_share(share) == 1.0 else replace(scene, meshes=_decimated(scene.meshes, share))


def simplification(before: Scene, after: Scene) -> Simplification:
    """What `simplified` did to the meshes of scene `before`."""
    pairs = list(zip(before.meshes, after.meshes, strict=True))
    return Simplification(
        before=sum(len(old.triangles) for old, _ in pairs),
        after=sum(len(new.triangles) for _, new in pairs),
        meshes=len(pairs),
        left=tuple(old.name for old, new in pairs if len(new.triangles) == len(old.triangles)),
    )


def check_share(share: float) -> float:
    """`share`. Raises OptionError where it is no share, or nothing can be simplified here."""
    if not 0.0 < share <= 1.0:
        raise OptionError(f"simplify: given {share:g}; wanted the share of triangles to keep, above 0 and at most 1")
    if share < 1.0 and (reason := simplification_reason()):
        raise OptionError(f"simplify: {reason}")
    return share


def _decimated(meshes: Sequence[Mesh], share: float) -> list[Mesh]:
    return [decimated(mesh, share) for mesh in meshes]


class SimplifiedLoader(Loader):
    """Another loader's model, simplified."""

    def __init__(self, options: SimplifiedOptions) -> None:
        self.options = options

    def load(self, path: Path, context: LoadContext) -> Model:
        """The model in `path`, or the procedural one named by `of`, with fewer triangles."""
        registry = get_registry()
        plugin = registry.loader_for(path.suffix)
        name = self.options.of or (plugin.name if plugin is not None else None)
        if name is None:
            raise AssetError(
                f"{path.name}: loader 'simplified': no loader reads '{path.suffix}' files; name one by `of`"
            )
        if name == "simplified":
            raise OptionError("loader 'simplified': `of` must name another loader")
        model = load_model(name, self.options.options, path, context)
        return replace(model, meshes=_decimated(model.meshes, check_share(self.options.share)))
