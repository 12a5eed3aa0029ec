"""A composed stage becomes a `phrt.scene.Scene`: prims are checked, files read, everything placed."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from phrt.controls import checked_situation, known_situations, unknown_tags
from phrt.description.assets import AssetRoots, MissingAssetError
from phrt.description.convert import LightPrim, changed_material, lens_of, light_of, settings_of, texture_slots
from phrt.description.fields import Described
from phrt.description.inherited import Inherited, prim_name, unique, warn_of_unknown_effects
from phrt.description.layers import DESCRIPTOR_SUFFIXES, Stage
from phrt.description.models import ModelStore
from phrt.description.motion import animation_tracks, camera_rest, camera_tracks, look_at_matrix, matrix_of
from phrt.description.pictures import (
    MAX_TEXTURE_BYTES,
    PLACEHOLDER,
    checker_image,
    read_dome,
    read_texture,
    texture_ref,
)
from phrt.description.placing import ModelPlacer
from phrt.description.prims import (
    PRIM_TYPES,
    BoxPrim,
    CameraPrim,
    DistantLightPrim,
    DomeLightPrim,
    MaterialOver,
    MaterialPrim,
    MeshPrim,
    PlanePrim,
    PrimBase,
    RectLightPrim,
    ReferencePrim,
    RenderSettingsPrim,
    SphereLightPrim,
    SpherePrim,
    Split,
    Texture,
)
from phrt.description.problems import Mark, Problems, listed
from phrt.description.shapes import box, icosphere, inline_mesh, plane
from phrt.description.validation import validated
from phrt.description.values import Value
from phrt.errors import AssetError, InputError, OptionError, PhrtWarning, did_you_mean
from phrt.materials import TEXTURE_SLOTS
from phrt.model import Image, Material, Mesh, Model, TextureRef
from phrt.scene import Dome, Scene, SceneCamera, SceneLight, SceneNode, SceneObject

MATERIALS = "Materials"
"""Materials of a referenced model lie below the Reference under this name."""


class Builder:
    """Makes one scene. `propagate` lets loaders' errors through as they are, for a model file given by itself."""

    def __init__(
        self, stage: Stage, roots: AssetRoots, source: Path, problems: Problems, propagate: bool = False
    ) -> None:
        self.scene = Scene(name=stage.name, source=source, situations=tuple(stage.variants) or ("default",))
        self.stage = stage
        self.problems = problems
        self.materials: dict[str, int] = {}
        self.models: dict[str, Model] = {}
        self.model_materials: dict[str, list[int]] = {}
        self.store = ModelStore(roots)
        self._roots = roots
        self._propagate = propagate
        self._prims: dict[str, Described] = {}
        self._images: dict[object, int] = {}
        self._image_base: dict[int, int] = {}
        self._shapes: dict[object, Mesh] = {}
        self._mesh_ids: dict[tuple[object, ...], int] = {}
        self._kept: list[object] = []
        self._paths: set[str] = set()

    def build(self) -> Scene:
        """The scene. Raises SceneError with all problems found."""
        self._check_prims()
        self.problems.raise_if_any()
        visible = self._visible()
        for path in visible:
            self._read_model(path)
        for path in self._prims:
            self._read_material(path, ())
        self.problems.raise_if_any()
        self._walk(visible)
        self._settings()
        self.problems.raise_if_any()
        return self.scene

    # Checking

    def _check_prims(self) -> None:
        for path, value in self.stage.prims.items():
            model = self._type_of(path, value)
            prim = validated(model, value, path, self.problems) if model is not None else None
            if prim is not None:
                self._prims[path] = prim
        for kind in (DomeLightPrim, RenderSettingsPrim):
            found = [path for path, prim in self._prims.items() if isinstance(prim, kind)]
            for path in found[1:]:
                name = kind.__name__.removesuffix("Prim")
                self.problems.add(self.stage.prims[path].mark, path, f"a second {name}; the first is {found[0]}")
        for path, prim in self._prims.items():
            if isinstance(prim, PrimBase):
                warn_of_unknown_effects(prim, self.stage.prims[path], path)
            if isinstance(prim, PrimBase) and prim.material is not None and not self._below_reference(prim.material):
                self._check_material(prim.material, self.stage.prims[path].mark_of(("material",)), path)

    def _type_of(self, path: str, value: Value) -> type[Described] | None:
        given = value.data.get("type") if isinstance(value.data, dict) else None
        name = "Xform" if given is None else given.data
        if isinstance(name, str) and name in PRIM_TYPES:
            return PRIM_TYPES[name]
        allowed = list(PRIM_TYPES)
        mark = value.mark_of(("type",))
        shown = f"'{name}'" if isinstance(name, str) else repr(name)
        self.problems.add(
            mark, path, f"type: given {shown}; allowed: {', '.join(allowed)}.{did_you_mean(str(name), allowed)}"
        )
        return None

    def _below_reference(self, path: str) -> bool:
        return any(path.startswith(p + "/") and isinstance(prim, ReferencePrim) for p, prim in self._prims.items())

    def _check_material(self, material: str, mark: Mark, path: str) -> bool:
        """Is `material` a Material prim, or a material of a model that was read?"""
        if isinstance(self._prims.get(material), MaterialPrim) or material in self.materials:
            return True
        if material in self.stage.prims and material not in self._prims:
            # It is described, and what is wrong with it has been told.
            return False
        known = self._known_materials()
        allowed = listed(known) or "none is described"
        if material in self._prims:
            message = f"material: {material} is not a Material prim; allowed: {allowed}"
        else:
            message = f"material: there is no {material}; allowed: {allowed}.{did_you_mean(material, known)}"
        self.problems.add(mark, path, message)
        return False

    def _known_materials(self) -> list[str]:
        described = [path for path, prim in self._prims.items() if isinstance(prim, MaterialPrim)]
        return list(dict.fromkeys((*described, *self.materials)))

    def _visible(self) -> list[str]:
        """Paths of prims that are in the scene, parents before children."""
        result: list[str] = []
        hidden: set[str] = set()
        for path, prim in self._prims.items():
            if path.rpartition("/")[0] in hidden or (isinstance(prim, PrimBase) and not prim.visible):
                hidden.add(path)
            else:
                result.append(path)
        return result

    # Materials and models

    def _read_material(self, path: str, heirs: tuple[str, ...]) -> int | None:
        """Scene material of the Material prim (or the model's material) at `path`, read after what it inherits from."""
        prim = self._prims.get(path)
        if path in self.materials or not isinstance(prim, MaterialPrim):
            return self.materials.get(path)
        value = self.stage.prims[path]
        base: int | None = None
        if prim.inherits is not None:
            mark = value.mark_of(("inherits",))
            if prim.inherits in (*heirs, path):
                self.problems.add(mark, path, f"inherits: a cycle: {' -> '.join((*heirs, path, prim.inherits))}")
                return None
            base = self._read_material(prim.inherits, (*heirs, path))
            if base is None and not len(self.problems):
                known = self._known_materials()
                hint = did_you_mean(prim.inherits, known)
                message = f"inherits: there is no material {prim.inherits}; allowed: {listed(known)}.{hint}"
                self.problems.add(mark, path, message)
        start = replace(self.scene.materials[base], name=path) if base is not None else Material(name=path)
        self.scene.materials.append(self._changed(start, prim, path, value))
        self.materials[path] = len(self.scene.materials) - 1
        return self.materials[path]

    def _read_model(self, path: str) -> None:
        prim = self._prims[path]
        if isinstance(prim, (ReferencePrim, MeshPrim)) and not _is_descriptor(prim):
            model = self._model(path, prim)
            if model is not None:
                self.models[path] = model
                self.model_materials[path] = self._materials_of_model(path, model, prim)

    def _changed(self, material: Material, prim: MaterialPrim, path: str, value: Value) -> Material:
        material = changed_material(material, prim)
        for slot in texture_slots(prim):
            texture = getattr(prim, slot)
            ref = None if texture is None else self._texture(texture, path, value.mark_of((slot, "asset")))
            named: dict[str, Any] = {slot: ref}
            material = replace(material, **named)
        return material

    def _texture(self, texture: Texture, path: str, mark: Mark) -> TextureRef | None:
        if texture.checker is not None:
            return texture_ref(texture, self._image(texture.checker, checker_image(texture.checker)))
        try:
            file = self._find(mark, str(texture.asset))
            if file not in self._images:
                self._check_textures()
            return texture_ref(texture, self._image(file, None if file in self._images else read_texture(file)))
        except MissingAssetError as error:
            # The rest of the scene is worth a picture, which shows where the texture belongs.
            warnings.warn(f"{mark}: {path}: {error}; a magenta checker is shown", PhrtWarning, stacklevel=2)
            return texture_ref(texture, self._image(PLACEHOLDER, checker_image(PLACEHOLDER)))
        except InputError as error:
            self.problems.add(mark, path, str(error))
            return None

    def _check_textures(self) -> None:
        """Raises AssetError when the textures so far leave no room for another one."""
        if sum(image.pixels.nbytes for image in self.scene.images) > MAX_TEXTURE_BYTES:
            raise AssetError(f"the scene's textures have more than {MAX_TEXTURE_BYTES} bytes together")

    def _image(self, key: object, image: Image | None) -> int:
        if key not in self._images:
            assert image is not None
            self._images[key] = len(self.scene.images)
            self.scene.images.append(image)
        return self._images[key]

    def file(self, path: str, mark: Mark, asset: str) -> Path | None:
        """The file `asset` names, looked for beside the file that names it, or None with a problem added."""
        try:
            return self._find(mark, asset)
        except InputError as error:
            self.problems.add(mark, path, str(error))
            return None

    def _find(self, mark: Mark, asset: str) -> Path:
        beside = mark.file or self.scene.source
        assert beside is not None
        return self._roots.find(asset, beside.parent)

    def _model(self, path: str, prim: ReferencePrim | MeshPrim) -> Model | None:
        if prim.asset is None and isinstance(prim, MeshPrim):
            return None
        value = self.stage.prims[path]
        mark = value.mark_of(("asset" if prim.asset is not None else "loader",))
        file = None
        if prim.asset is not None:
            file = self.file(path, mark, prim.asset)
            if file is None:
                return None
        loader = prim.loader if isinstance(prim, ReferencePrim) else None
        assert self.scene.source is not None
        try:
            return self.store.model(file, loader, prim.options, mark.file or self.scene.source)
        except InputError as error:
            if self._propagate:
                raise
            self.problems.add(mark, path, str(error))
            return None

    def _materials_of_model(self, path: str, model: Model, prim: ReferencePrim | MeshPrim) -> list[int]:
        """Scene material of every material of `model` with this reference's changes; shared where there are none."""
        self._kept.append(model)
        if id(model) not in self._image_base:
            self._image_base[id(model)] = len(self.scene.images)
            self.scene.images.extend(model.images)
        names: set[str] = set()
        result: list[int] = []
        for number, material in enumerate(model.materials):
            material_path = unique(f"{path}/{MATERIALS}/{prim_name(material.name, f'material_{number}')}", names)
            index = self._model_material(path, material_path, model, number, prim)
            self.materials[material_path] = index
            result.append(index)
        return result

    def _model_material(
        self, path: str, material_path: str, model: Model, number: int, prim: ReferencePrim | MeshPrim
    ) -> int:
        """Scene material of material `number` of `model`: the shared one, or its own when something changes it here."""
        material = _with_image_base(model.materials[number], self._image_base[id(model)])
        changes: list[tuple[MaterialPrim, str, Value]] = []
        everywhere = prim.all_materials if isinstance(prim, ReferencePrim) else None
        if everywhere is not None:
            value = self.stage.prims[path].data
            assert isinstance(value, dict)
            changes.append((everywhere, path, value["all_materials"]))
        over = self.stage.overs.pop(material_path, None)
        own = validated(MaterialOver, over, material_path, self.problems) if over is not None else None
        if own is not None and over is not None:
            changes.append((own, material_path, over))
        key = ("material", id(model), number)
        if not changes and key in self._mesh_ids:
            return self._mesh_ids[key]
        for change, where, said in changes:
            material = self._changed(material, change, where, said)
        self.scene.materials.append(material)
        index = len(self.scene.materials) - 1
        if not changes:
            self._mesh_ids[key] = index
        return index

    # Placing

    def _walk(self, visible: list[str]) -> None:
        nodes: dict[str, int] = {}
        inherited: dict[str, Inherited] = {"": Inherited()}
        placer = ModelPlacer(self)
        for path in visible:
            prim = self._prims[path]
            if not isinstance(prim, PrimBase):
                continue
            parent = path.rpartition("/")[0]
            state = inherited.get(parent, Inherited()).below(prim, self.stage.prims[path])
            inherited[path] = state
            node = nodes[path] = self.add_node(path, nodes.get(parent, -1), self._matrix(prim))
            if prim.xform is not None and prim.xform.animation is not None:
                self.scene.tracks.extend(animation_tracks(prim.xform.animation, node))
            if isinstance(prim, ReferencePrim) and path in self.models:
                placer.place(path, node, self.models[path], state, prim)
            else:
                self._place(path, node, prim, state)
        placer.check_overs_used()

    def _matrix(self, prim: PrimBase) -> np.ndarray:
        if isinstance(prim, CameraPrim) and prim.look_at is not None:
            return look_at_matrix(prim.look_at)
        if isinstance(prim, CameraPrim) and prim.path is not None:
            return camera_rest(prim.path)
        return matrix_of(prim.xform)

    def add_node(self, path: str, parent: int, matrix: np.ndarray) -> int:
        self._paths.add(path)
        self.scene.nodes.append(SceneNode(path, parent, matrix))
        return len(self.scene.nodes) - 1

    def _place(self, path: str, node: int, prim: PrimBase, state: Inherited) -> None:
        name = path.rpartition("/")[2]
        if isinstance(prim, (SpherePrim, PlanePrim, BoxPrim)):
            self.add_object(path, node, self._shape(prim), [], state)
        elif isinstance(prim, MeshPrim):
            self._place_mesh(path, node, prim, state)
        elif isinstance(prim, CameraPrim):
            self.scene.cameras.append(SceneCamera(path, node, lens_of(prim, name)))
            if prim.path is not None:
                self.scene.tracks.extend(camera_tracks(prim.path, node))
        elif isinstance(prim, DomeLightPrim):
            self._place_dome(path, prim)
        elif isinstance(prim, (SphereLightPrim, DistantLightPrim, RectLightPrim)):
            light: LightPrim = prim
            self.scene.lights.append(SceneLight(path, node, light_of(light, name, state.casts_shadow)))

    def _shape(self, prim: SpherePrim | PlanePrim | BoxPrim) -> Mesh:
        """Equal shapes are one mesh."""
        if isinstance(prim, SpherePrim):
            key: tuple[object, ...] = ("Sphere", prim.radius, prim.subdivision)
        else:
            key = (prim.type, prim.size)
        if key not in self._shapes:
            if isinstance(prim, SpherePrim):
                self._shapes[key] = icosphere("Sphere", prim.radius, prim.subdivision)
            else:
                self._shapes[key] = plane("Plane", prim.size) if isinstance(prim, PlanePrim) else box("Box", prim.size)
        return self._shapes[key]

    def _place_mesh(self, path: str, node: int, prim: MeshPrim, state: Inherited) -> None:
        name = path.rpartition("/")[2]
        if prim.asset is not None:
            mesh = self.store.joined(self.models[path], name)
        else:
            mesh = inline_mesh(name, prim)
            self._kept.append(mesh)
        self.add_pieces(path, node, mesh, self.model_materials.get(path, []), state, prim.split, prim.smooth)

    def add_pieces(
        self, path: str, node: int, mesh: Mesh, materials: list[int], state: Inherited, split: Split, smooth: bool
    ) -> None:
        """One object per piece of `mesh`: at `path` when there is one piece, below it when there are several."""
        parts = self.store.pieces(mesh, split)
        for part in parts:
            part_path = path if len(parts) == 1 else self.unique_path(f"{path}/{prim_name(part.name, 'piece')}")
            self.add_object(part_path, node, part, materials, state, smooth)

    def add_object(
        self, path: str, node: int, mesh: Mesh, materials: list[int], state: Inherited, smooth: bool = False
    ) -> None:
        """An object of `mesh`, whose triangle_material is translated by `materials` or replaced by the binding."""
        bound = self._bound_material(path, state)
        key = ("mesh", id(mesh), bound, tuple(materials) if bound is None else (), smooth)
        if key not in self._mesh_ids:
            self._kept.append(mesh)
            self._mesh_ids[key] = len(self.scene.meshes)
            self.scene.meshes.append(
                replace(mesh, triangle_material=_translated(mesh, materials, bound), smooth=mesh.smooth or smooth)
            )
        self._paths.add(path)
        self.scene.objects.append(
            SceneObject(
                path=path,
                node=node,
                mesh=self._mesh_ids[key],
                casts_shadow=state.casts_shadow,
                effects=dict(state.effects),
                importance=dict(state.importance),
                tags=state.tags,
            )
        )

    def _bound_material(self, path: str, state: Inherited) -> int | None:
        if state.material is None:
            return None
        if state.material not in self.materials:
            assert state.material_mark is not None
            self._check_material(state.material, state.material_mark, path)
            return None
        return self.materials[state.material]

    def unique_path(self, path: str) -> str:
        return unique(path, self._paths)

    def _place_dome(self, path: str, prim: DomeLightPrim) -> None:
        pixels = None
        if prim.asset is not None:
            mark = self.stage.prims[path].mark_of(("asset",))
            file = self.file(path, mark, prim.asset)
            try:
                pixels = None if file is None else read_dome(file)
            except InputError as error:
                self.problems.add(mark, path, str(error))
        red, green, blue = (part * prim.intensity for part in prim.color)
        rotation = float(np.radians(prim.rotation))
        self.scene.dome = Dome((red, green, blue), pixels, rotation, prim.background)

    def _check_track(self, path: str, prim: RenderSettingsPrim) -> None:
        """The situations and tags that a track names must be some of this scene's."""
        value = self.stage.prims[path]
        for number, key in enumerate(prim.track):
            try:
                if key.situation is not None:
                    checked_situation(key.situation, known_situations(self.scene))
            except OptionError as error:
                mark = value.mark_of(("track", number, "situation"))
                self.problems.add(mark, path, f"track[{number}].situation: {error}")
            for message in unknown_tags(key.attention or (), self.scene):
                mark = value.mark_of(("track", number, "attention"))
                warnings.warn(f"{mark}: {path}: track[{number}].{message}", PhrtWarning, stacklevel=2)

    def _settings(self) -> None:
        """Render settings, and the camera they name first."""
        for path, prim in self._prims.items():
            if not isinstance(prim, RenderSettingsPrim):
                continue
            self.scene.settings = settings_of(prim)
            self._check_track(path, prim)
            if prim.camera is None:
                continue
            cameras = {camera.path: camera for camera in self.scene.cameras}
            if prim.camera not in cameras:
                known = list(cameras)
                mark = self.stage.prims[path].mark_of(("camera",))
                hint = did_you_mean(prim.camera, known)
                message = (
                    f"camera: there is no camera {prim.camera}; allowed: {listed(known) or 'none is described'}.{hint}"
                )
                self.problems.add(mark, path, message)
                continue
            self.scene.cameras.sort(key=lambda camera: camera.path != prim.camera)


def _is_descriptor(prim: ReferencePrim | MeshPrim) -> bool:
    return (
        isinstance(prim, ReferencePrim)
        and prim.asset is not None
        and Path(prim.asset).suffix.lower() in DESCRIPTOR_SUFFIXES
    )


def _with_image_base(material: Material, base: int) -> Material:
    """`material` with its textures looking into the scene's images, where the model's start at `base`."""
    refs = {slot: getattr(material, slot) for slot in TEXTURE_SLOTS}
    moved = {slot: replace(ref, image=ref.image + base) for slot, ref in refs.items() if ref is not None}
    return replace(material, **moved)


def _translated(mesh: Mesh, materials: list[int], bound: int | None) -> np.ndarray:
    """(T,) int32 scene material of every triangle."""
    if bound is not None:
        return np.full(len(mesh.triangles), bound, np.int32)
    table = np.array([*materials, -1], np.int32)
    index = mesh.triangle_material
    return table[np.where((index >= 0) & (index < len(materials)), index, len(materials))]
