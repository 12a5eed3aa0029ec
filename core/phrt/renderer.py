"""Renderer: a scene, a G-buffer producer, a tracer, effects and a heuristic, put together and run frame by frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from os import PathLike
from types import TracebackType

import numpy as np

from phrt.arguments import camera_number, checked_matrix, checked_size, make_effects
from phrt.backends import Backends
from phrt.budget import Budget
from phrt.buffers import BufferPool
from phrt.camera import CameraView
from phrt.candidates import GroupBy
from phrt.clock import Clock
from phrt.controls import Conditions, Controls, changed
from phrt.cost_memory import CostMemory, run_key
from phrt.costs import CostModelName
from phrt.errors import OptionError, did_you_mean
from phrt.faults.fault import PluginFailure
from phrt.frame import Decisions, FrameResult
from phrt.interfaces.effect import RayEffect
from phrt.interfaces.gbuffer import GBufferProducer
from phrt.interfaces.heuristic import Heuristic
from phrt.interfaces.tracer import Tracer
from phrt.ledger import over_samples
from phrt.profile import Profile
from phrt.profile_use import profiled
from phrt.quiet import garbage_waits
from phrt.registry.auto import choose_gbuffer, choose_tracer
from phrt.registry.manager import get_registry
from phrt.run_state import Ground, RunState, Terms, check_budget
from phrt.sample import Moment, Sample, as_result, take_sample
from phrt.sampling import jitter_pattern
from phrt.scene import Scene
from phrt.stages import Stages
from phrt.workers import Workers
from phrt.world import World

DEFAULT_SIZE = (640, 360)


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
    strict    : a plugin that fails is a PluginError instead of a PhrtWarning (phrt.faults)

    controls  : what was asked for with `control`
    conditions: what holds in the latest frame; its budget and persistence are attributes of their own as well
    run       : everything that frames change and learn (`phrt.run_state.RunState`); `restart` begins another
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
        registry = get_registry()
        known, self.scene = profiled(profile, scene)
        self.aa = aa
        terms = Terms.checked(
            self.scene, aa, heuristic=heuristic, heuristic_options=heuristic_options, budget=budget,
            persistence=persistence, cost_model=cost_model, group_by=group_by, clock=clock, history=history,
            reserve_ms=reserve_ms, strict=strict,
        )  # fmt: skip
        self.tracer_name = choose_tracer(registry).name if tracer == "auto" else tracer
        self.gbuffer_name = choose_gbuffer(registry).name if gbuffer == "auto" else gbuffer
        made = make_effects(self.scene, effects)
        self._closed = self._moved = False
        self.fallbacks_hold = False
        with ExitStack() as undo:
            # Where something cannot be made, what was made before is given back.
            self.workers = Workers(threads)
            undo.callback(self.workers.close)
            self.world = World(self.scene)
            self._backends = Backends(self.tracer_name, self.gbuffer_name, self.world, self.workers)
            undo.callback(self._backends.close)
            self.tracer: Tracer = self._backends.tracer
            self.producer: GBufferProducer = self._backends.producer
            self.traces_primary = self._backends.traces_primary
            self.buffers = BufferPool()
            key = run_key(self.scene.name, self.tracer_name, self.workers.threads) if remember_costs else None
            self._memory = CostMemory(key)
            self._ground = Ground(
                self.scene, self.world, self.tracer, aa, made, effects or (), known, self._memory, self.buffers
            )
            self.run = RunState(self._ground, terms)
            undo.pop_all()
        self._backends.producer.thorough = strict

    def restart(
        self,
        *,
        heuristic: str | Heuristic | None = None,
        heuristic_options: Mapping[str, object] | None = None,
        budget: str | Budget | None = None,
        persistence: float | None = None,
        cost_model: CostModelName = "measured",
        group_by: GroupBy = "object_effect",
        clock: Clock | None = None,
        reserve_ms: float = 0.0,
        history: bool = True,
        strict: bool = False,
    ) -> None:
        """Begin another run: the frames that follow are those of a new renderer with these arguments and otherwise the same ones.

        What was learnt, asked for with `control` and `move`, measured and switched off is forgotten. The scene as arrays, the
        tracer's structures, and fallbacks that still hold are not made again, so it takes no time to speak of. Costs that
        `remember_costs` keeps are as they were found by the first run; those of the last run are left for the next renderer.

        Raises what making a renderer raises, and then the run goes on as it was.
        """
        self._check_open()
        terms = Terms.checked(
            self.scene, self.aa, heuristic=heuristic, heuristic_options=heuristic_options, budget=budget,
            persistence=persistence, cost_model=cost_model, group_by=group_by, clock=clock, history=history,
            reserve_ms=reserve_ms, strict=strict,
        )  # fmt: skip
        ended, self.run = self.run, RunState(self._ground, terms)
        self._backends.producer.thorough = strict
        ended.end()
        if self._moved or ended.faults.tracer_failure is not None:
            # A tracer may hold what was moved by hand in another way than what stood still from the start; one that failed may hold
            # anything.
            self.world.overrides.clear()
            self.world.advance(0.0)
            self._moved = False
            self._backends.build()
            self.fallbacks_hold = False
        for effect in self._ground.effects:
            self.run.faults.begin_run(effect)
        if ended.faults.any_fallback_lost or ended.terms.group_by != terms.group_by:
            self.fallbacks_hold = False

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except PluginFailure:
            # What fails at the end does not hide what failed before.
            if value is None:
                raise

    def close(self) -> None:
        """Give threads, tracer and GL context back. Nothing can be rendered after it; closing again does nothing.

        A plugin that fails in it costs a PhrtWarning, with `strict` a PluginFailure once everything is closed.
        """
        if self._closed:
            return
        self._closed = True
        self.run.end()
        self._memory.write()
        self.run.faults.begin_frame(None)
        failed = None
        for kind, plugin, error in self._backends.close():
            try:
                self.run.faults.not_closed(kind, plugin, error)
            except PluginFailure as told:
                failed = failed or told
        self.workers.close()
        if failed is not None:
            raise failed

    # What holds in this run

    @property
    def heuristic(self) -> Heuristic:
        return self.run.terms.heuristic

    @property
    def effects(self) -> list[RayEffect]:
        return self.run.effects

    @property
    def clock(self) -> Clock:
        return self.run.terms.clock

    @property
    def controls(self) -> Controls:
        return self.run.controls

    @property
    def conditions(self) -> Conditions:
        return self.run.conditions

    @property
    def budget(self) -> Budget:
        return self.run.conditions.budget

    @property
    def persistence(self) -> float:
        return self.run.conditions.persistence

    @property
    def measure_change(self) -> bool:
        return self.run.measure_change

    @measure_change.setter
    def measure_change(self, wanted: bool) -> None:
        self.run.measure_change = wanted

    @property
    def measure_each(self) -> bool:
        return self.run.measure_each

    @measure_each.setter
    def measure_each(self, wanted: bool) -> None:
        self.run.measure_each = wanted

    def control(self, **changes: object) -> None:
        """From the next frame on these fields of `phrt.controls.Controls` hold: budget, persistence, situation, attention,
        view_speed, parameters. Each one given replaces that field, None gives it back to the scene's track and the defaults.

        Raises OptionError for what cannot be, and then changes nothing; a tag that no object has is a PhrtWarning.
        """
        controls = changed(self.run.controls, changes, self.scene)
        check_budget(controls.budget, self.aa)
        self.run.controls = controls

    def costs(self) -> dict[str, dict[str, float]]:
        """By effect, what was learnt of its costs so far: ms_per_item and ms_per_ray."""
        return self.run.costs.coefficients()

    def move(self, path: str, matrix: np.ndarray | None) -> None:
        """From the next frame on, object `path` stands at `matrix` (4, 4) world_from_local; None returns it to its node.

        Raises OptionError for an unknown object, and for a matrix that is not (4, 4), finite and affine.
        """
        self._check_open()
        for object_id, entry in enumerate(self.scene.objects, start=1):
            if entry.path == path:
                self.world.set_object_matrix(object_id, None if matrix is None else checked_matrix(path, matrix))
                self._moved = True
                return
        raise OptionError(
            f"no object '{path}' in scene '{self.scene.name}'.{did_you_mean(path, [o.path for o in self.scene.objects])}"
        )

    def render(
        self, time: float = 0.0, *, frame_index: int | None = None, camera: int | str | CameraView = 0
    ) -> FrameResult:
        """One frame at `time` seconds, seen by scene camera `camera` (number or path) or by a view of your own.

        frame_index: what randomness is seeded with; by default frames count up from 0.

        Raises OptionError for a time that is not finite and an unknown camera, RuntimeError once closed, and PluginError when the
        G-buffer producer fails, or, with `strict`, any plugin.
        """
        self._check_open()
        if not math.isfinite(time):
            raise OptionError(f"time is {time}; it must be a finite number of seconds")
        with garbage_waits():
            try:
                return self._render(time, frame_index, camera)
            except PluginFailure as failed:
                self.run.faults.note(failed.fault)
                raise

    def _render(self, time: float, frame_index: int | None, camera: int | str | CameraView) -> FrameResult:
        """`render`, with what was given checked."""
        run, stages, began_ms = self.run, Stages(), self.clock.now_ms()
        index = run.begin_frame(frame_index, time)
        self._advance(time)
        view = self._view(camera)
        run.sight.begin_frame(self.world, view, time, run.conditions)
        stages.done("update")
        samples = _Samples(self.aa)
        for number, (x, y) in enumerate(jitter_pattern(self.aa)):
            moment = Moment(view.with_jitter(x, y), index, number, time, began_ms)
            samples.add(take_sample(self, moment, stages))
            stages.done("composite")
        run.experience.note_selected(samples.decisions)
        last = samples.latest
        ended_ms = self.clock.now_ms()
        result = replace(
            as_result(self, last, samples.means(), stages.milliseconds),
            decisions=over_samples(samples.decisions),
            rays=samples.rays,
            clock_ms=ended_ms - began_ms + run.terms.reserve_ms,
            samples=tuple(samples.decisions),
            headroom_ms=run.allowance.headroom_ms(self.budget),
        )
        run.allowance.finished(self.budget, result.clock_ms, ended_ms - last.rays_ended_ms)
        stages.done("composite")
        return result

    def _advance(self, time: float) -> None:
        """The world, and all who hold a part of it, at `time` seconds."""
        changes = self.world.advance(time)
        if changes.objects:
            self._backends.follow(changes, self.run.faults)
        if changes:
            self.fallbacks_hold = False

    def _view(self, camera: int | str | CameraView) -> CameraView:
        if isinstance(camera, CameraView):
            return camera
        return self.world.view(*self.size, camera_number(self.scene, camera))

    def _check_open(self) -> None:
        if self._closed:
            raise RuntimeError("the renderer was closed")


class _Samples:
    """The sub-pixel samples of a frame, summed up as they come."""

    def __init__(self, count: int) -> None:
        self.latest: Sample
        self.decisions: list[Decisions] = []
        self.rays: dict[str, int] = {}
        self._count = count
        self._sums: dict[str, np.ndarray] = {}

    def add(self, sample: Sample) -> None:
        """One more."""
        self.latest = sample
        self.decisions.append(sample.decisions)
        for name, count in sample.rays.items():
            self.rays[name] = self.rays.get(name, 0) + count
        if self._count == 1:
            return
        for name, array in sample.pictures().items():
            if name in self._sums:
                self._sums[name] += array
            else:
                self._sums[name] = array.copy()

    def means(self) -> dict[str, np.ndarray]:
        """Of picture and layers where there are several samples, by the names of `Sample.pictures`."""
        return {name: total / np.float32(self._count) for name, total in self._sums.items()}
