"""A config and what it names: scenes load, plugins and options exist, frames are there. The result is the plan.

All problems are told at once, each with file, line and key.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path as FilePath
from typing import Any, TypeVar

from phrt.arguments import camera_number, make_effects
from phrt.cli.parsing import parse_frames, parse_size
from phrt.description.assets import ASSETS_VARIABLE, AssetRoots
from phrt.description.problems import Problems
from phrt.errors import InputError, OptionError, PluginError, SceneError
from phrt.registry import get_registry
from phrt.registry.auto import choose_gbuffer, choose_tracer
from phrt.registry.local import is_file_source, owner_of, register_source
from phrt.registry.options import validate_options
from phrt.scene import Scene
from phrt_plugins.bench.config import HeuristicEntry, SceneEntry
from phrt_plugins.bench.content import scene_digest
from phrt_plugins.bench.paths import path_reference
from phrt_plugins.bench.plan import Cell, Path, PathReference, Plan, Setup, short_hash, slug
from phrt_plugins.bench.plugin_code import codes_of
from phrt_plugins.bench.reading import ConfigFile
from phrt_plugins.bench.scenes import open_scene
from phrt_plugins.packages import simplification_reason

SMALLEST_SIDE = 7
"""Pixels: metrics look at windows of this size."""

T = TypeVar("T")
Merged = dict[str, dict[str, Any]]


def checked_plan(file: ConfigFile) -> Plan:
    """Everything that the config asks for. Loads every scene once. Raises OptionError with every problem."""
    return _Checker(file).plan()


class _Checker:
    """One use: collects problems while the plan is made."""

    def __init__(self, file: ConfigFile) -> None:
        self._file, self._config = file, file.config
        self._problems = Problems("config")
        self._reference: PathReference | None = None

    def plan(self) -> Plan:
        config = self._config
        self._add_plugins()
        tracers = [self._backend("tracer", i, name) for i, name in enumerate(config.tracers)]
        gbuffers = [self._backend("gbuffer", i, name) for i, name in enumerate(config.gbuffers)]
        self._check_sizes()
        self._check_metrics()
        self._check_reference()
        for number, heuristic in enumerate(config.heuristics):
            self._check_heuristic(number, heuristic)
        scenes = [self._scene(number, entry) for number, entry in enumerate(config.scenes)]
        self._check_names(scenes)
        try:
            self._problems.raise_if_any()
        except SceneError as error:
            raise OptionError(str(error)) from None
        setups: dict[str, Setup] = {}
        cells: dict[str, Cell] = {}
        for base in scenes:
            for size in config.sizes:
                for tracer in dict.fromkeys(tracers):
                    for gbuffer in dict.fromkeys(gbuffers):
                        for budget in config.budgets:
                            for heuristic in config.heuristics:
                                setup = self._setup(base or {}, parse_size(size), tracer, gbuffer, heuristic)
                                setups.setdefault(setup.id, setup)
                                for repeat in range(config.repeats):
                                    cell = _cell(setup, heuristic, budget, repeat)
                                    cells[cell.id] = cell
        return Plan(tuple(setups.values()), tuple(cells.values()), config.oracle)

    # What is named

    def _at(self, *location: int | str) -> Callable[[str], None]:
        """Adds a problem of the value at `location`."""
        place = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in location).lstrip(".")
        return lambda message: self._problems.add(self._file.value.mark_of(location), place, message)

    def _trying(self, complain: Callable[[str], None], action: Callable[[], T]) -> T | None:
        """What `action` gives; None, with its InputError as a problem."""
        try:
            return action()
        except InputError as error:
            complain(str(error))
            return None

    def _add_plugins(self) -> None:
        for number, source in enumerate(self._config.plugins):
            full = plugin_source(source, self._file.folder)
            self._trying(self._at("plugins", number), partial(register_source, full))

    def _backend(self, kind: str, number: int, name: str) -> str:
        """The name of a tracer or producer that can run here; "auto" becomes what it stands for."""
        registry = get_registry()

        def found() -> str:
            if name == "auto":
                return (choose_tracer if kind == "tracer" else choose_gbuffer)(registry).name
            reason = registry.find(kind, name).unavailable_reason()
            if reason is not None:
                raise PluginError(f"{kind} '{name}' is not available here: {reason}")
            return name

        return self._trying(self._at(f"{kind}s", number), found) or name

    def _check_sizes(self) -> None:
        for number, size in enumerate(self._config.sizes):
            if min(parse_size(size)) < SMALLEST_SIDE:
                self._at("sizes", number)(f"given '{size}'; metrics need {SMALLEST_SIDE} pixels a side and more")

    def _check_metrics(self) -> None:
        for number, name in enumerate(self._config.metrics or ()):
            self._trying(self._at("metrics", number), partial(get_registry().find, "metric", name))

    def _check_reference(self) -> None:
        if (entry := self._config.reference) is not None:
            self._reference = self._trying(self._at("reference", "tracer"), lambda: path_reference(entry))

    def _check_heuristic(self, number: int, entry: HeuristicEntry) -> None:
        registry = get_registry()
        found = self._trying(
            self._at("heuristics", number, "heuristic"), lambda: registry.find("heuristic", entry.heuristic)
        )
        if found is None:
            return
        title = f"heuristic '{entry.heuristic}'"
        complain = self._at("heuristics", number, "options")
        self._trying(complain, lambda: validate_options(title, found.plugin.options, entry.options))
        if (reason := found.unavailable_reason()) is not None:
            self._at("heuristics", number, "heuristic")(f"{title} is not available here: {reason}")

    # Scenes

    def _scene(self, number: int, entry: SceneEntry) -> dict[str, Any] | None:
        """What setups of this scene have in common; None where it has problems."""
        file = self._trying(self._at("scenes", number, "scene"), lambda: find_scene(entry.scene, self._file.folder))
        if file is None:
            return None
        scene = self._trying(
            self._at("scenes", number, "scene"),
            lambda: open_scene(file, entry.variant, entry.overrides),
        )
        if scene is None:
            return None
        before = len(self._problems)
        if entry.simplify is not None and (reason := simplification_reason()) is not None:
            self._at("scenes", number, "simplify")(f"meshes cannot be simplified here: {reason}")
        self._trying(self._at("scenes", number, "camera"), lambda: camera_number(scene, entry.camera))
        self._check_effects(scene, entry.effects, self._at("scenes", number, "effects"))
        for other, heuristic in enumerate(self._config.heuristics):
            if heuristic.effects:
                effects = merged(entry.effects, heuristic.effects)
                self._check_effects(scene, effects, self._at("heuristics", other, "effects"))
        path = self._path(number, entry, scene)
        if len(self._problems) > before or path is None:
            return None
        name = entry.name or "-".join(filter(None, (FilePath(entry.scene).stem, entry.variant)))
        return {
            "scene": name, "file": str(file), "content": scene_digest(scene), "variant": entry.variant,
            "overrides": dict(entry.overrides), "camera": entry.camera, "path": path, "simplify": entry.simplify,
            "effects": entry.effects, "tone_map": scene.settings.tone_map or "neutral", "given": entry.scene,
            "own": list(scene.settings.effects),
        }  # fmt: skip

    def _check_effects(
        self, scene: Scene, effects: Mapping[str, Mapping[str, Any]], complain: Callable[[str], None]
    ) -> None:
        self._trying(complain, lambda: make_effects(scene, effects))

    def _path(self, number: int, entry: SceneEntry, scene: Scene) -> Path | None:
        """The walk through `scene`; a problem where it leaves the scene's frames."""
        there, fps = scene.settings.frames, entry.fps or scene.settings.fps
        # The scene's path lasts as long as it does: at another rate it has another number of frames.
        available = max(1, round((there - 1) * fps / scene.settings.fps) + 1)
        chosen = parse_frames(entry.frames or f"0:{available}")
        if chosen.stop > available and there > 1:
            self._at("scenes", number, "frames")(
                f"given '{entry.frames}'; the scene has frames 0:{available} at {fps:g} a second (more: `laps`)"
            )
            return None
        return Path(chosen.first, len(chosen), fps, entry.laps)

    def _check_names(self, scenes: list[dict[str, Any] | None]) -> None:
        names = [None if scene is None else scene["scene"] for scene in scenes]
        for number, name in enumerate(names):
            if name is not None and name in names[:number]:
                self._at("scenes", number)(f"two scenes are called '{name}'; give one of them a `name`")

    def _setup(
        self, base: dict[str, Any], size: tuple[int, int], tracer: str, gbuffer: str, heuristic: HeuristicEntry
    ) -> Setup:
        config = self._config
        known = {name: value for name, value in base.items() if name not in ("effects", "given", "own")}
        values = known | {
            "size": size, "tracer": tracer, "gbuffer": gbuffer, "base_effects": merged(base["effects"], {}),
            "effects": merged(base["effects"], heuristic.effects), "clock": config.clock.rays if config.clock else None,
            "threads": config.threads, "block": config.block, "warm_up": config.warm_up, "judge_every": config.judge_every,
            "pictures": config.pictures,
        }  # fmt: skip
        # What an id says holds on every machine: the file as it was named, and not what is in it.
        said = values | {"file": base["given"], "content": None, "path": asdict(base["path"])}
        name = slug(base["scene"], f"{size[0]}x{size[1]}", tracer, gbuffer)
        used = [
            ("tracer", tracer),
            ("gbuffer", gbuffer),
            *(("effect", each) for each in (*base["own"], *base["effects"])),
        ]
        if config.reference is not None:
            said["reference"] = config.reference.model_dump()
            used.append(("tracer", config.reference.tracer))
        return Setup(id=f"{name}-{short_hash(said)}", **values, plugins=codes_of(used), reference=self._reference)


def _cell(setup: Setup, entry: HeuristicEntry, budget: str, repeat: int) -> Cell:
    said: dict[str, Any] = {
        "setup": setup.id, "scene": setup.scene, "label": entry.shown, "heuristic": entry.heuristic,
        "options": dict(entry.options), "budget": budget, "size": setup.size, "tracer": setup.tracer,
        "gbuffer": setup.gbuffer, "clock": setup.clock, "persistence": entry.persistence, "cost_model": entry.cost_model,
        "group_by": entry.group_by, "history": entry.history, "repeat": repeat,
    }  # fmt: skip
    # A contestant whose code was changed is another one; those that ship with PHRT are the same on every machine.
    codes = codes_of([("heuristic", entry.heuristic), *(("effect", effect) for effect in entry.effects)])
    said |= {"plugins": codes} if codes else {}
    name = slug(setup.scene, f"{setup.size[0]}x{setup.size[1]}", budget, entry.shown, f"r{repeat}")
    return Cell(id=f"{name}-{short_hash(said)}", **said)


def merged(weaker: Mapping[str, Mapping[str, Any]], stronger: Mapping[str, Mapping[str, Any]]) -> Merged:
    """Options by effect, those of `stronger` over those of `weaker`."""
    names = {**weaker, **stronger}
    return {name: {**weaker.get(name, {}), **stronger.get(name, {})} for name in names}


def plugin_source(source: str, folder: FilePath) -> str:
    """A plugin's module, or the whole path of its file, which is given relative to `folder`."""
    return owner_of(str(folder / source)) if is_file_source(source) else source


def find_scene(name: str, folder: FilePath) -> FilePath:
    """The scene file `name`: absolute, relative to the config's `folder`, or in a folder of PHRT_ASSETS. Raises OptionError."""
    places = [folder, *(root for root in AssetRoots(folder).folders if root != folder)]
    for place in places:
        if (place / name).is_file():
            return (place / name).resolve()
    looked = ", ".join(str(place) for place in places)
    raise OptionError(
        f"there is no scene file '{name}'; looked in: {looked}. More folders can be named in {ASSETS_VARIABLE}"
    )
