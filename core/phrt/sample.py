"""One sub-pixel sample of a frame: a G-buffer, traced within the budget, and composed. A frame without antialiasing has one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from phrt.allowance import unit_of
from phrt.camera import CameraView
from phrt.candidates import WorkItems, find_work
from phrt.change import ChangeSample, measure_change, pick_sample
from phrt.channels import CHANNELS, GBuffer
from phrt.composite import all_rows, compose, light_surfaces
from phrt.faults.fault import CAUGHT, raised
from phrt.frame import Decisions, Frame, FrameResult
from phrt.interfaces.heuristic import FrameContext
from phrt.kernels.arrays import environment_arrays, geometry_arrays, material_arrays, surface_arrays
from phrt.layers import LayerSet, apply_fallbacks, clear_layers
from phrt.lightwise import OneLight
from phrt.raster_picture import FramePicture
from phrt.stages import Stages

if TYPE_CHECKING:
    from phrt.renderer import Renderer
    from phrt.run_state import RunState

FRAME_CHANNELS = tuple(name for name in CHANNELS if name != "motion")
_IMAGE = "(image)"


@dataclass(frozen=True)
class Moment:
    """What is sampled: frame `index` at `time` seconds, its sample `number`, seen by `view`; the frame began at `began_ms`."""

    view: CameraView
    index: int
    number: int
    time: float
    began_ms: float


@dataclass(frozen=True)
class Sample:
    """What came of it; arrays (P, ...). rays_ended_ms: when its ray phase was over."""

    moment: Moment
    image: np.ndarray
    gbuffer: GBuffer
    direct: np.ndarray
    layers: LayerSet
    decisions: Decisions
    rays: dict[str, int]
    rays_ended_ms: float

    def pictures(self) -> dict[str, np.ndarray]:
        """What is averaged over samples: the image and the layers."""
        return {_IMAGE: self.image, **self.layers.arrays}


def take_sample(renderer: Renderer, moment: Moment, stages: Stages) -> Sample:
    """The G-buffer of `moment`, lit, traced, filled up with fallbacks, and composed."""
    run, world, workers, buffers = renderer.run, renderer.world, renderer.workers, renderer.buffers
    view, count = moment.view, moment.view.width * moment.view.height
    gbuffer = renderer.producer.render(view, channels=FRAME_CHANNELS)
    surfaces = surface_arrays(gbuffer)
    stages.done("gbuffer")
    materials = material_arrays(world)
    direct = buffers.take((count, len(world.lights), 3))
    light_surfaces(surfaces, materials.materials, world.lights, view, direct, workers)
    stages.done("direct")
    frame = Frame(
        world=world,
        view=view,
        gbuffer=gbuffer,
        surfaces=surfaces,
        direct=direct,
        tracer=run.tracer,
        producer=renderer.producer,
        workers=workers,
        geometry=geometry_arrays(world),
        materials=materials,
        environment=environment_arrays(world),
        index=moment.index,
        time=moment.time,
        seed=(moment.index * renderer.aa + moment.number) & 0x7FFFFFFF,
    )
    unit = unit_of(run.conditions.budget)
    layers = clear_layers(run.effects, world, count, buffers, workers)
    stages.done("clear")
    if run.history and not (unit == "none" and run.faults.says(run.terms.heuristic, "traces_everything")):
        layers.ages = run.history.reproject(frame, layers, run.faults)
        stages.done("history")
    work = find_work(
        frame, run.effects, run.scopes, run.sight, run.experience, run.costs,
        persistence=run.conditions.persistence, budget_unit=unit, cost_model=run.terms.cost_model,
        group_by=run.terms.group_by, masks=layers.masks, ages=layers.ages,
    )  # fmt: skip
    stages.done("candidates")
    context = _context(renderer, moment, frame)
    looked_at = None
    if run.measure_change or (unit != "none" and run.faults.says(run.terms.heuristic, "wants_change")):
        looked_at = pick_sample(frame, run.effects, run.scopes, work, layers)
    stages.done("change")
    run.scheduler.each_alone = run.measure_each
    decisions = run.scheduler.run(frame, run.effects, work, run.terms.heuristic, context, layers)
    decisions = replace(decisions, score=_scores(run, len(work.candidates)))
    rays_ended_ms = run.terms.clock.now_ms()
    stages.done("rays")
    if (decisions.traced_pixels < decisions.candidates.pixel_count).any():
        _prepare_fallbacks(renderer, frame)
        # What repeats a recorded run has no budget, and knows what that run was short of.
        short_of = getattr(run.terms.heuristic, "recorded_unit", unit)
        apply_fallbacks(frame, run.effects, work, decisions, layers, run.faults, detailed=short_of != "ms")
    stages.done("fallbacks")
    image = buffers.take((count, 3))
    compose(
        surfaces, materials.materials, frame.environment, world.environment.visible, view, all_rows(count), direct,
        layers.arrays, layers.masks, _exposure(renderer, view), image, workers, layers.adds,
    )  # fmt: skip
    stages.done("composite")
    if looked_at is not None:
        learn_change(renderer, frame, work, looked_at, decisions, layers, image)
        stages.done("change")
    if run.history:
        run.history.keep(frame, layers, holds=bool(decisions.chosen.any() or layers.ages))
    rays = {"primary": count if renderer.traces_primary else 0, **layers.rays}
    return Sample(moment, image, gbuffer, direct, layers, decisions, rays, rays_ended_ms)


def learn_change(
    renderer: Renderer,
    frame: Frame,
    work: WorkItems,
    looked_at: ChangeSample,
    decisions: Decisions,
    layers: LayerSet,
    image: np.ndarray,
) -> None:
    """Measure on the pixels `looked_at` what was gained by tracing."""
    run = renderer.run
    _prepare_fallbacks(renderer, frame)
    units, effect = work.units, run.effects[looked_at.effect]
    traced = decisions.chosen[units.item]
    measured = measure_change(
        frame, effect, looked_at, traced, layers, image, _exposure(renderer, frame.view), run.faults
    )
    run.experience.exploration.learn_change(units.object_id, units.effect, measured)


def as_result(renderer: Renderer, last: Sample, means: dict[str, np.ndarray], stages: dict[str, float]) -> FrameResult:
    """The frame of its last sample, and of the samples' means where there were several."""
    run, moment = renderer.run, last.moment
    height, width = last.gbuffer.height, last.gbuffer.width
    views = {effect.writes.name for effect in run.effects if isinstance(effect, OneLight)}
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
        index=moment.index,
        time=moment.time,
        exposure=_exposure(renderer, moment.view),
        effect_layers={effect.name: effect.writes.name for effect in run.effects},
        added_layers=last.layers.adds,
        budget=run.conditions.budget,
        faults=run.faults.of_frame,
        light_layers=frozenset(
            ["visibility", *(effect.writes.name for effect in run.effects if not effect.writes.components)]
        ),
        world=renderer.world,
        view=moment.view,
    )


def _context(renderer: Renderer, moment: Moment, frame: Frame) -> FrameContext:
    """What the heuristic is told."""
    run, held = renderer.run, renderer.run.conditions
    return FrameContext(
        world=renderer.world,
        frame_index=moment.index,
        time=moment.time,
        budget=run.allowance.of(held.budget, moment.began_ms),
        budget_unit=unit_of(held.budget),
        sample=moment.number,
        samples=renderer.aa,
        history=run.terms.history,
        situation=held.situation,
        attention=held.attention,
        view_speed=run.sight.view_speed,
        parameters=held.parameters,
        raster=FramePicture(frame, _exposure(renderer, moment.view)),
    )


def _scores(run: RunState, count: int) -> np.ndarray:
    """(count,) float32, what the heuristic says it ranked the items by; NaN where it says nothing that is as long."""
    nothing, heuristic = np.full(count, np.nan, np.float32), run.terms.heuristic
    if run.faults.heuristic_is_off:
        return nothing
    try:
        scores = getattr(heuristic, "scores", None)
    except CAUGHT as error:
        run.faults.lose_heuristic(heuristic, raised("scores", error), error)
        return nothing
    if isinstance(scores, np.ndarray) and scores.shape == (count,) and scores.dtype.kind == "f":
        return scores.astype(np.float32)
    return nothing


def _prepare_fallbacks(renderer: Renderer, frame: Frame) -> None:
    """Once, until the scene changes."""
    if not renderer.fallbacks_hold:
        for effect in renderer.run.effects:
            renderer.run.faults.prepare_fallback(effect, frame)
        renderer.fallbacks_hold = True


def _exposure(renderer: Renderer, view: CameraView) -> float:
    return view.exposure * renderer.scene.settings.exposure
