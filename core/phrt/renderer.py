"""The frame loop: a scene, a G-buffer producer, a tracer, effects and a heuristic, put together and run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from types import TracebackType

import numpy as np

from phrt.allowance import Allowance, unit_of
from phrt.arguments import camera_number, checked_matrix, checked_size, make_effects, make_heuristic, one_of, scopes_of
from phrt.budget import Budget
from phrt.buffers import BufferPool
from phrt.camera import CameraView
from phrt.candidates import GROUPINGS, GroupBy, WorkItems, find_work
from phrt.change import ChangeSample, measure_change, pick_sample
from phrt.channels import CHANNELS, GBuffer
from phrt.clock import Clock, WallClock, beneath
from phrt.composite import all_rows, compose, light_surfaces
from phrt.controls import Conditions, Controls, changed, in_force
from phrt.cost_memory import recall, remember, run_key
from phrt.costs import COST_MODELS, CostModelName, CostModels
from phrt.errors import OptionError, did_you_mean
from phrt.experience import Experience
from phrt.faults import Faults
from phrt.frame import Decisions, Frame, FrameResult
from phrt.history import History
from phrt.interfaces.effect import RayEffect
from phrt.interfaces.gbuffer import GBufferProducer
from phrt.interfaces.heuristic import FrameContext, Heuristic
from phrt.interfaces.tracer import Tracer
from phrt.kernels.arrays import environment_arrays, geometry_arrays, material_arrays, surface_arrays
from phrt.layers import LayerSet, apply_fallbacks, clear_layers
from phrt.ledger import over_samples
from phrt.lightwise import OneLight, by_light
from phrt.profile import Profile
from phrt.profile_use import known_costs, known_rays, profiled
from phrt.quiet import garbage_waits
from phrt.registry.auto import DEFAULT_HEURISTIC, choose_gbuffer, choose_tracer
from phrt.registry.manager import get_registry
from phrt.relevance import ObjectSight
from phrt.sampling import jitter_pattern
from phrt.scene import Scene
from phrt.scheduler import BudgetScheduler
from phrt.stages import Stages
from phrt.workers import Workers
from phrt.world import World

DEFAULT_SIZE = (640, 360)
_IMAGE = "(image)"
FRAME_CHANNELS = tuple(name for name in CHANNELS if name != "motion")


class Renderer:
    """Renders frames of one scene.

    scene     : what `phrt.load_scene` returned
    size      : (width, height) in pixels; by default the scene's own, else 640 x 360
    heuristic : name of a heuristic plugin, or a `Heuristic`; by default the scene's own, else "all_trace"
    heuristic_options: its options; `{"seed": 3}` for "random"
    budget    : what a frame may take: "50ms" (the whole frame), "rays:20ms" (its ray phase), "200000rays" (secondary rays); None
                or "none" for no limit. Sub-pixel samples share it, and the first kind is for one sample only
    cost_model: what budgets are held by: "measured" (rays of the object, time of a ray) or "paper" (one price for C)
    group_by  : what a work item is: "object" with all effects, "object_effect", or "object_effect_light"
    clock     : what budgets of time are read from; by default real time
    reserve_ms: what the host needs of a frame budget for itself, for tone mapping and presenting, say
    persistence: I of the paper, how much having been traced in the previous frame counts; 0 or more; by default 0.0001
    profile   : what `phrt analyze` wrote, or its file: importance, effects that change nothing, Q and costs to start from
    gbuffer   : "moderngl", "raycast", "auto" (moderngl on a hardware GL, else raycast), or a plugin's name
    tracer    : "embree", "open3d", "numpy", "auto" (the first available in this order), or a plugin's name
    threads   : how many; by default one per usable core
    effects   : options by effect name, over those of the scene; `{"shadows": {"samples": 4}}`
    aa        : samples per pixel by sub-pixel jitter; 1 for real time
    remember_costs: start from what earlier runs on this machine learnt of costs, and keep what this one learns; real clocks only
    history   : where nothing is traced, values of earlier frames stand in for the fallback as long as they hold; not with aa
    strict    : an effect that fails raises instead of being switched off

    controls  : what was asked for with `control`
    conditions: what holds in the latest frame; its budget and persistence are attributes of their own as well
    measure_change: what tracing changes is measured even if the heuristic does not look at it; may be set between frames.
    measure_each: every item is traced and counted by itself, which takes longer and teaches no times; may be set between frames.

    Use it as a context manager; it holds threads, a tracer and perhaps a GL context, and must be used from one thread.
    Raises OptionError for a bad size, aa, budget, persistence or option, PluginError for a plugin that is unknown or unavailable,
    ProfileError for a profile that cannot be read or is of another scene.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        size: tuple[int, int] | None = None,
        heuristic: str | Heuristic | None = None,
        heuristic_options: Mapping[str, object] | None = None,
        budget: str | Budget | None = None,
        persistence: float | None = None,
        profile: Profile | str | PathLike[str] | None = None,
        cost_model: CostModelName = "measured",
        group_by: GroupBy = "object_effect",
        clock: Clock | None = None,
        reserve_ms: float = 0.0,
        gbuffer: str = "auto",
        tracer: str = "auto",
        threads: int | None = None,
        effects: Mapping[str, Mapping[str, object]] | None = None,
        aa: int = 1,
        remember_costs: bool = True,
        history: bool = True,
        strict: bool = False,
    ) -> None:
        self.size = checked_size(size or scene.settings.size or DEFAULT_SIZE)
        if not 1 <= aa <= 1024:
            raise OptionError(f"aa is {aa}; it must be 1 to 1024 samples per pixel")
        if threads is not None and not 1 <= threads <= 1024:
            raise OptionError(f"threads is {threads}; it must be 1 to 1024")
        if not 0 <= reserve_ms < math.inf:
            raise OptionError(f"reserve_ms is {reserve_ms}; it must be 0 or more")
        self.cost_model: CostModelName = one_of("cost_model", cost_model, COST_MODELS)
        self.group_by: GroupBy = one_of("group_by", group_by, GROUPINGS)
        self.clock = clock or WallClock()
        self.reserve_ms = reserve_ms
        registry = get_registry()
        self.aa = aa
        known, scene = profiled(profile, scene)
        self.scene = scene
        self.controls = Controls()
        self.control(budget=budget, persistence=persistence)
        self._settle(0.0)
        for key in scene.settings.track:
            self._check_budget(key.controls.budget)
        self.measure_each = False
        self.measure_change = False
        self.tracer_name = choose_tracer(registry).name if tracer == "auto" else tracer
        self.gbuffer_name = choose_gbuffer(registry).name if gbuffer == "auto" else gbuffer
        self.effects: list[RayEffect] = make_effects(scene, effects)
        self.heuristic: Heuristic = make_heuristic(
            heuristic or scene.settings.heuristic or DEFAULT_HEURISTIC, heuristic_options
        )
        self.workers = Workers(threads)
        self.world = World(scene)
        self.tracer: Tracer = registry.create("tracer", self.tracer_name)
        self.tracer.build(self.world)
        self._traces_primary = bool(getattr(registry.get("gbuffer", self.gbuffer_name), "needs_tracer", False))
        dependencies = {"tracer": self.tracer, "workers": self.workers} if self._traces_primary else {}
        self.producer: GBufferProducer = registry.create("gbuffer", self.gbuffer_name, **dependencies)
        self.producer.build(self.world)
        if self.group_by == "object_effect_light":
            self.effects = by_light(self.effects, self.world)
        self._scopes = scopes_of(self.effects, self.world)
        self._sight = ObjectSight(self.world)
        self._experience = Experience(self.world.object_count, [scope.rays_per_pixel for scope in self._scopes])
        self._faults = Faults(strict=strict)
        self._costs = CostModels([effect.name for effect in self.effects])
        real = isinstance(beneath(self.clock), WallClock)
        self._costs_key = (
            run_key(scene.name, self.tracer_name, self.workers.threads) if real and remember_costs else None
        )
        if real:
            self._costs.warm(known_costs(known, self.effects))
        if self._costs_key:
            self._costs.warm(recall(self._costs_key))
        if known is not None:
            self._experience.expect(known_rays(known, scene, self.effects, effects or ()))
        self._scheduler = BudgetScheduler(self._costs, self._experience, self._faults, self.clock)
        self._allowance = Allowance(self.clock, self.reserve_ms, aa)
        self._buffers = BufferPool()
        self.history = history and aa == 1
        self._history = History(self.world, self.effects, self._buffers) if self.history else None
        self._fallbacks_ready = False
        self._index = 0
        self._closed = False

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give threads, tracer and GL context back. Nothing can be rendered after it; closing again does nothing."""
        if self._closed:
            return
        self._closed = True
        if self._costs_key and self._costs.learned:
            remember(self._costs_key, self._costs.coefficients())
        self.producer.close()
        self.tracer.close()
        self.workers.close()

    def control(self, **changes: object) -> None:
        """From the next frame on these fields of `phrt.controls.Controls` hold: budget, persistence, situation, attention,
        view_speed, parameters. Each one given replaces that field, None gives it back to the scene's track and the defaults.

        Raises OptionError for what cannot be, and then changes nothing; a tag that no object has is a PhrtWarning.
        """
        controls = changed(self.controls, changes, self.scene)
        self._check_budget(controls.budget)
        self.controls = controls

    def _settle(self, time: float) -> None:
        """What holds at `time`."""
        self.conditions: Conditions = in_force(self.controls, self.scene.settings.track, time, self.scene)
        self.budget, self.persistence = self.conditions.budget, self.conditions.persistence

    def _check_budget(self, budget: Budget | str | None) -> None:
        if isinstance(budget, Budget) and budget.kind == "frame_ms" and self.aa > 1:
            raise OptionError(f"budget is {budget} and aa is {self.aa}; a budget for the whole frame needs aa 1")

    def costs(self) -> dict[str, dict[str, float]]:
        """By effect, what was learnt of its costs so far: ms_per_item and ms_per_ray."""
        return self._costs.coefficients()

    def move(self, path: str, matrix: np.ndarray | None) -> None:
        """From the next frame on, object `path` stands at `matrix` (4, 4) world_from_local; None returns it to its node.

        Raises OptionError for an unknown object, and for a matrix that is not (4, 4), finite and affine.
        """
        self._check_open()
        for object_id, entry in enumerate(self.scene.objects, start=1):
            if entry.path == path:
                self.world.set_object_matrix(object_id, None if matrix is None else checked_matrix(path, matrix))
                return
        raise OptionError(
            f"no object '{path}' in scene '{self.scene.name}'.{did_you_mean(path, [o.path for o in self.scene.objects])}"
        )

    def render(
        self, time: float = 0.0, *, frame_index: int | None = None, camera: int | str | CameraView = 0
    ) -> FrameResult:
        """One frame at `time` seconds, seen by scene camera `camera` (number or path) or by a view of your own.

        frame_index: what randomness is seeded with; by default frames count up from 0.

        Raises OptionError for a time that is not finite and an unknown camera, RuntimeError once closed, and PluginError
        when the heuristic fails.
        """
        self._check_open()
        if not math.isfinite(time):
            raise OptionError(f"time is {time}; it must be a finite number of seconds")
        with garbage_waits():
            return self._render(time, frame_index, camera)

    def _render(self, time: float, frame_index: int | None, camera: int | str | CameraView) -> FrameResult:
        """`render`, with what was given checked."""
        stages, began = Stages(), self.clock.now_ms()
        index = self._index if frame_index is None else frame_index
        self._index = index + 1
        self._settle(time)
        self._scheduler.each_alone = self.measure_each
        changes = self.world.advance(time)
        if changes.objects:
            self.tracer.update(self.world, changes)
            self.producer.update(self.world, changes)
        if changes:
            self._fallbacks_ready = False
        view = self._view(camera)
        self._sight.begin_frame(self.world, view, time, self.conditions)
        stages.done("update")
        pattern = jitter_pattern(self.aa)
        sums: dict[str, np.ndarray] = {}
        rays: dict[str, int] = {}
        decisions: list[Decisions] = []
        for number, (x, y) in enumerate(pattern):
            sample = self._sample(view.with_jitter(x, y), index, number, time, stages, began)
            for name, count in sample.rays.items():
                rays[name] = rays.get(name, 0) + count
            decisions.append(sample.decisions)
            if self.aa > 1:
                for name, array in {_IMAGE: sample.image, **sample.layers.arrays}.items():
                    if name in sums:
                        sums[name] += array
                    else:
                        sums[name] = array.copy()
            stages.done("composite")
        self._experience.note_selected(decisions)
        means = {name: total / np.float32(self.aa) for name, total in sums.items()}
        last = replace(sample, decisions=over_samples(decisions), rays=rays)
        ended = self.clock.now_ms()
        result = replace(
            self._result(last, means, stages.milliseconds, index, time),
            clock_ms=ended - began + self.reserve_ms,
            samples=tuple(decisions),
            headroom_ms=self._allowance.headroom_ms(self.budget),
        )
        self._allowance.finished(self.budget, result.clock_ms, ended - sample.rays_ended_ms)
        stages.done("composite")
        return result

    def _check_open(self) -> None:
        if self._closed:
            raise RuntimeError("the renderer was closed")

    def _result(
        self, last: _Sample, means: dict[str, np.ndarray], stages: dict[str, float], index: int, time: float
    ) -> FrameResult:
        """The frame of its last sample, and of the samples' means where there were several."""
        height, width = last.gbuffer.height, last.gbuffer.width
        views = {effect.writes.name for effect in self.effects if isinstance(effect, OneLight)}
        layers = [(name, array) for name, array in last.layers.arrays.items() if name not in views]
        return FrameResult(
            image=means.get(_IMAGE, last.image).reshape(height, width, 3),
            gbuffer=last.gbuffer,
            layers={name: means.get(name, array).reshape(height, width, -1) for name, array in layers},
            direct=last.direct.reshape(height, width, -1, 3),
            masks={name: mask.reshape(height, width) for name, mask in last.layers.masks.items()},
            decisions=last.decisions,
            stages=stages,
            rays=last.rays,
            index=index,
            time=time,
            exposure=self._exposure(last.view),
            effect_layers={effect.name: effect.writes.name for effect in self.effects},
            budget=self.budget,
            light_layers=frozenset(
                ["visibility", *(effect.writes.name for effect in self.effects if not effect.writes.components)]
            ),
            world=self.world,
            view=last.view,
        )

    def _exposure(self, view: CameraView) -> float:
        return view.exposure * self.scene.settings.exposure

    def _view(self, camera: int | str | CameraView) -> CameraView:
        if isinstance(camera, CameraView):
            return camera
        return self.world.view(*self.size, camera_number(self.scene, camera))

    def _sample(
        self, view: CameraView, index: int, number: int, time: float, stages: Stages, began_ms: float
    ) -> _Sample:
        """One G-buffer, traced and composed."""
        gbuffer = self.producer.render(view, channels=FRAME_CHANNELS)
        surfaces = surface_arrays(gbuffer)
        stages.done("gbuffer")
        count = view.width * view.height
        world, materials = self.world, material_arrays(self.world)
        direct = self._buffers.take((count, len(world.lights), 3))
        light_surfaces(surfaces, materials.materials, world.lights, view, direct, self.workers)
        stages.done("direct")
        frame = Frame(
            world=world,
            view=view,
            gbuffer=gbuffer,
            surfaces=surfaces,
            direct=direct,
            tracer=self.tracer,
            producer=self.producer,
            workers=self.workers,
            geometry=geometry_arrays(world),
            materials=materials,
            environment=environment_arrays(world),
            index=index,
            time=time,
            seed=(index * self.aa + number) & 0x7FFFFFFF,
        )
        unit = unit_of(self.budget)
        layers = clear_layers(self.effects, world, count, self._buffers, self.workers)
        if self._history and not (self.heuristic.traces_everything and unit == "none"):
            layers.ages = self._history.reproject(frame, layers, self._faults)
            stages.done("history")
        work = find_work(
            frame, self.effects, self._scopes, self._sight, self._experience, self._costs,
            persistence=self.persistence, budget_unit=unit, cost_model=self.cost_model, group_by=self.group_by,
            masks=layers.masks, ages=layers.ages,
        )  # fmt: skip
        stages.done("candidates")
        context = FrameContext(
            world=world,
            frame_index=index,
            time=time,
            budget=self._allowance.of(self.budget, began_ms),
            budget_unit=unit,
            sample=number,
            samples=self.aa,
            history=self.history,
            situation=self.conditions.situation,
            attention=self.conditions.attention,
            view_speed=self._sight.view_speed,
            parameters=self.conditions.parameters,
        )
        sample = None
        if self.measure_change or (self.heuristic.wants_change and unit != "none"):
            sample = pick_sample(frame, self.effects, self._scopes, work, layers)
        stages.done("change")
        decisions = self._scheduler.run(frame, self.effects, work, self.heuristic, context, layers)
        rays_ended = self.clock.now_ms()
        stages.done("rays")
        if (decisions.traced_pixels < decisions.candidates.pixel_count).any():
            self._prepare_fallbacks(frame)
            apply_fallbacks(frame, self.effects, work, decisions, layers, self._faults)
        stages.done("fallbacks")
        image = self._buffers.take((count, 3))
        compose(
            surfaces, materials.materials, frame.environment, world.environment.visible, view, all_rows(count), direct,
            layers.arrays, layers.masks, self._exposure(view), image, self.workers,
        )  # fmt: skip
        stages.done("composite")
        if sample is not None:
            self._learn_change(frame, work, sample, decisions, layers, image)
            stages.done("change")
        if self._history:
            self._history.keep(frame, layers, holds=bool(decisions.chosen.any() or layers.ages))
        rays = {"primary": count if self._traces_primary else 0, **layers.rays}
        return _Sample(view, image, gbuffer, direct, layers, decisions, rays, rays_ended)

    def _prepare_fallbacks(self, frame: Frame) -> None:
        if not self._fallbacks_ready:
            for effect in self.effects:
                self._faults.prepare_fallback(effect, frame)
            self._fallbacks_ready = True

    def _learn_change(
        self,
        frame: Frame,
        work: WorkItems,
        sample: ChangeSample,
        decisions: Decisions,
        layers: LayerSet,
        image: np.ndarray,
    ) -> None:
        """Measure on `sample` what was gained by tracing."""
        self._prepare_fallbacks(frame)
        units, effect = work.units, self.effects[sample.effect]
        traced = decisions.chosen[units.item]
        measured = measure_change(
            frame, effect, sample, traced, layers, image, self._exposure(frame.view), self._faults
        )
        self._experience.exploration.learn_change(units.object_id, units.effect, measured)


@dataclass(frozen=True)
class _Sample:
    """One sub-pixel sample of a frame; arrays (P, ...)."""

    view: CameraView
    image: np.ndarray
    gbuffer: GBuffer
    direct: np.ndarray
    layers: LayerSet
    decisions: Decisions
    rays: dict[str, int]
    rays_ended_ms: float
