"""A run: what its frames are chosen by, and what they teach. `Renderer.restart` ends one and begins another on the same ground."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from phrt.allowance import Allowance
from phrt.arguments import make_heuristic, one_of, scopes_of
from phrt.budget import Budget
from phrt.buffers import BufferPool
from phrt.candidates import GROUPINGS, GroupBy
from phrt.clock import Clock, WallClock, beneath
from phrt.controls import Conditions, Controls, changed, in_force
from phrt.cost_memory import CostMemory
from phrt.costs import COST_MODELS, CostModelName, CostModels
from phrt.errors import OptionError
from phrt.experience import Experience
from phrt.faults import Faults
from phrt.faults.tracer import GuardedTracer
from phrt.history import History
from phrt.interfaces.effect import RayEffect
from phrt.interfaces.heuristic import Heuristic
from phrt.interfaces.tracer import Tracer
from phrt.lightwise import by_light
from phrt.profile import Profile
from phrt.profile_use import known_costs, known_rays
from phrt.registry.auto import DEFAULT_HEURISTIC
from phrt.relevance import ObjectSight
from phrt.scene import Scene
from phrt.scheduler import BudgetScheduler
from phrt.world import World


@dataclass(frozen=True)
class Ground:
    """What all runs of a renderer begin on. effects: as they were made, whatever an item is; redefined: those with other options
    than the scene's; profile: what is known beforehand."""

    scene: Scene
    world: World
    tracer: Tracer
    aa: int
    effects: list[RayEffect]
    redefined: Collection[str]
    profile: Profile | None
    memory: CostMemory
    buffers: BufferPool


@dataclass(frozen=True)
class Terms:
    """What a run is asked to be; the arguments of `Renderer` of the same names, checked."""

    heuristic: Heuristic
    controls: Controls
    cost_model: CostModelName
    group_by: GroupBy
    clock: Clock
    history: bool
    reserve_ms: float
    strict: bool

    @classmethod
    def checked(
        cls,
        scene: Scene,
        aa: int,
        *,
        heuristic: str | Heuristic | None,
        heuristic_options: Mapping[str, object] | None,
        budget: str | Budget | None,
        persistence: float | None,
        cost_model: CostModelName,
        group_by: GroupBy,
        clock: Clock | None,
        history: bool,
        reserve_ms: float,
        strict: bool,
    ) -> Terms:
        """Raises OptionError and PluginError as `Renderer` does, before anything is built."""
        if not 0 <= reserve_ms < math.inf:
            raise OptionError(f"reserve_ms is {reserve_ms}; it must be 0 or more")
        one_of("cost_model", cost_model, COST_MODELS)
        one_of("group_by", group_by, GROUPINGS)
        controls = changed(Controls(), {"budget": budget, "persistence": persistence}, scene)
        for given in (controls, *(key.controls for key in scene.settings.track)):
            check_budget(given.budget, aa)
        chosen = heuristic or scene.settings.heuristic or DEFAULT_HEURISTIC
        return cls(
            heuristic=make_heuristic(chosen, heuristic_options),
            controls=controls,
            cost_model=cost_model,
            group_by=group_by,
            clock=clock or WallClock(),
            history=history and aa == 1,
            reserve_ms=reserve_ms,
            strict=strict,
        )


class RunState:
    """Everything that a run of frames changes or learns is here, so that a new one of these has forgotten it all.

    controls, conditions: as `Renderer` says; measure_change, measure_each: too
    effects   : by item: light by light where that was asked for; scopes: where each of them may act
    sight     : how objects were seen; experience, costs: what was learnt of them; history: the previous frame's layers
    faults    : what failed; scheduler, allowance: hold the budget; tracer: the renderer's, whose answers are checked
    next_index: the number of the next frame
    """

    def __init__(self, ground: Ground, terms: Terms) -> None:
        world = ground.world
        self._ground = ground
        self.terms = terms
        self.controls = terms.controls
        self.conditions: Conditions
        self.settle(0.0)
        self.measure_each = False
        self.measure_change = False
        self.next_index = 0
        one_by_one = terms.group_by == "object_effect_light"
        self.effects = by_light(ground.effects, world) if one_by_one else ground.effects
        self.scopes = scopes_of(self.effects, world)
        self.sight = ObjectSight(world)
        self.experience = self._expected()
        self.costs = self._known_costs()
        self.faults = Faults(strict=terms.strict)
        self.tracer: Tracer = GuardedTracer(ground.tracer, world, self.faults)
        self.scheduler = BudgetScheduler(self.costs, self.experience, self.faults, terms.clock)
        self.allowance = Allowance(terms.clock, terms.reserve_ms, ground.aa)
        self.history = History(world, self.effects, ground.buffers) if terms.history else None

    def begin_frame(self, index: int | None, time: float) -> int:
        """A frame at `time` seconds. Its number is `index`, else that of the one before and one more."""
        number = self.next_index if index is None else index
        self.next_index = number + 1
        self.faults.begin_frame(number)
        self.settle(time)
        return number

    def settle(self, time: float) -> None:
        """What holds at `time` seconds."""
        scene = self._ground.scene
        self.conditions = in_force(self.controls, scene.settings.track, time, scene)

    def end(self) -> None:
        """No frame follows: what real time taught of costs may be remembered."""
        if self._is_real and self.costs.learned:
            self._ground.memory.keep(self.costs.coefficients())

    @property
    def _is_real(self) -> bool:
        return isinstance(beneath(self.terms.clock), WallClock)

    def _expected(self) -> Experience:
        ground = self._ground
        made = Experience(ground.world.object_count, [scope.rays_per_pixel for scope in self.scopes])
        if ground.profile is not None:
            made.expect(known_rays(ground.profile, ground.scene, self.effects, ground.redefined))
        return made

    def _known_costs(self) -> CostModels:
        made = CostModels([effect.name for effect in self.effects])
        if self._is_real:
            made.warm(known_costs(self._ground.profile, self.effects))
            made.warm(self._ground.memory.known())
        return made


def check_budget(budget: Budget | str | None, aa: int) -> None:
    """Raises OptionError for a budget that cannot be held at `aa` samples per pixel."""
    if isinstance(budget, Budget) and budget.kind == "frame_ms" and aa > 1:
        raise OptionError(f"budget is {budget} and aa is {aa}; a budget for the whole frame needs aa 1")
