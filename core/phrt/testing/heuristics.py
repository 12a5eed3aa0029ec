"""check_heuristic: the rules of `phrt.interfaces.heuristic.Heuristic`, on candidates of all sorts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from pydantic import BaseModel

from phrt.interfaces.heuristic import NEVER_TRACED, PASSES, BudgetUnit, Candidates, Heuristic, Request
from phrt.testing.candidates import OBJECTS, Tally, candidates, context, one_frame, rows
from phrt.testing.contract import BROKEN_BY_THE_PLUGIN, BrokenContract, Contract, Given, Maker
from phrt.watchdog import PATIENCE_S, Guard, NeverReturned

__tracebackhide__ = BROKEN_BY_THE_PLUGIN

EFFECTS = ("shadows", "reflections")
MOST_ITEMS = 30
MS_PER_RAY = 0.01


@dataclass(frozen=True)
class Case:
    """items: (predicted rays, relevance, mandatory); budget of rays, or of ms at `MS_PER_RAY`; seed: of all other columns, and of
    an order of the items; left: what is said to be left, call by call, in a frame of its own."""

    items: tuple[tuple[int, int, bool], ...]
    budget: float
    unit: BudgetUnit
    seed: int
    left: tuple[int, ...] = ()

    def candidates(self) -> Candidates:
        """Objects with two effects each; some were measured, traced, or hold values of earlier frames, some not."""
        n, random = len(self.items), np.random.default_rng(self.seed)

        def some(values: np.ndarray, otherwise: float) -> np.ndarray:
            return np.where(random.random(n) < 0.5, values, otherwise).astype(np.float32)

        rays = np.array([item[0] for item in self.items], np.float32)
        return candidates(
            rays * np.float32(self.scale),
            [item[1] for item in self.items],
            [item[2] for item in self.items],
            effect_names=EFFECTS,
            object_id=(np.arange(n) // len(EFFECTS) + 1).astype(np.int32),
            effect=(np.arange(n) % len(EFFECTS)).astype(np.int32),
            pixel_count=np.maximum(rays.astype(np.int32) // random.integers(1, 4, n).astype(np.int32), 1),
            predicted_rays=rays,
            predicted_ms_measured=rays * np.float32(MS_PER_RAY),
            center_closeness=some(random.random(n), 0.0),
            distance=random.uniform(0.01, 100, n).astype(np.float32),
            history_share=some(random.random(n), 0.0),
            was_selected=random.random(n) < 0.3,
            frames_since_traced=random.choice([1, 5, NEVER_TRACED], n).astype(np.int32),
            measured_change=some(random.random(n), np.nan),
            measured_strength=some(random.random(n), np.nan),
            measured_detail=some(random.random(n), np.nan),
            measured_drift=some(random.random(n), np.nan),
            measured_ms_per_pixel=some(random.random(n), np.nan),
        )

    @property
    def scale(self) -> float:
        """Of the budget's unit for one ray."""
        return MS_PER_RAY if self.unit == "ms" else 1.0


FIXED = (
    Case((), math.inf, "none", 0),
    Case((), 0.0, "rays", 0),
    Case(((5, 1, False),), math.inf, "none", 0, (5,)),
    Case(((5, 1, False),), 5.0, "rays", 0, (4, 5)),
    Case(((5, 1, False),), 4.0, "rays", 0, (0,)),
    Case(((5, 0, True),), 5.0, "rays", 1, (4, 5)),
    Case(((5, 0, False),) * 20, 50.0, "rays", 2, (5,) * 20),
    Case(((50, 3, False), (10, 1, True), (10, 1, True)), 20.0, "rays", 3, (60, 30)),
)
"""Nothing, one item, all equal ones, mandatory ones that just fit."""


def check_heuristic(
    heuristic: Given,
    options: Mapping[str, object] | BaseModel | None = None,
    *,
    mandatory: bool = True,
    any_order: bool = True,
    cases: int = 100,
    patience_s: float = PATIENCE_S,
) -> None:
    """Put a heuristic through its contract. Raises BrokenContract naming the rule and the case.

    heuristic : the name of a registered one, a descriptor, or a class that takes `options`
    mandatory : False for one that leaves mandatory items out on purpose
    any_order : False for one whose decisions depend on the order of the candidates, as the contract asks them not to
    cases     : how many are looked at beside the fixed ones
    patience_s: how long a call may take
    """
    make = Maker("heuristic", heuristic, options)
    contract = make.contract
    contract.holds(isinstance(make(), Heuristic), "it is a phrt.interfaces.heuristic.Heuristic")
    guard = Guard(patience_s)

    def check(case: Case) -> None:
        try:
            with guard:
                contract.call("a frame", lambda: _check_case(contract, make, case, mandatory, any_order), case)
        except NeverReturned:
            raise BrokenContract(contract.message(f"calls return; one took {patience_s:g} seconds", case)) from None

    for case in FIXED:
        check(case)
    search(check, cases)


def search(check: Callable[[Case], None], cases: int) -> None:
    """`check` of many cases: found and shrunk by hypothesis where it is installed, else drawn with a fixed seed."""
    try:
        from hypothesis import HealthCheck, given, settings
        from hypothesis import strategies as st
    except ImportError:
        random = np.random.default_rng(1)
        for _ in range(cases):
            check(drawn(random))
        return
    items = st.lists(st.tuples(st.integers(1, 50), st.integers(0, 8), st.booleans()), max_size=MOST_ITEMS).map(tuple)
    left = st.lists(st.integers(0, 80), max_size=50).map(tuple)
    limited = st.builds(
        Case, items, st.integers(0, 600).map(float), st.sampled_from(["rays", "ms"]), st.integers(0, 99), left
    )
    free = st.builds(Case, items, st.just(math.inf), st.just("none"), st.integers(0, 99), left)
    quiet = settings(
        max_examples=cases, deadline=None, database=None, print_blob=False, suppress_health_check=list(HealthCheck)
    )
    quiet(given(st.one_of(limited, free))(check))()


def drawn(random: np.random.Generator) -> Case:
    """A random case."""
    n = int(random.integers(0, MOST_ITEMS + 1))
    columns = random.integers(1, 51, n), random.integers(0, 9, n), random.random(n) < 0.3
    items = tuple((int(c), int(r), bool(m)) for c, r, m in zip(*columns, strict=True))
    left = tuple(int(value) for value in random.integers(0, 81, random.integers(0, 51)))
    if random.random() < 0.2:
        return Case(items, math.inf, "none", int(random.integers(100)), left)
    unit: BudgetUnit = "rays" if random.random() < 0.5 else "ms"
    return Case(items, float(random.integers(0, 601)), unit, int(random.integers(100)), left)


def _check_case(
    contract: Contract, make: Callable[[], Heuristic], case: Case, mandatory: bool, any_order: bool
) -> None:
    """Every rule in one case, each by a heuristic of its own."""
    work, budget = case.candidates(), case.budget * case.scale
    given = [array.copy() for array in _arrays(work)]

    def frame(heuristic: Heuristic, work: Candidates, index: int = 0, **how: Any) -> list[tuple[int, int]]:
        return one_frame(heuristic, work, budget, index, contract=contract, case=case, budget_unit=case.unit, **how)

    chosen = frame(make(), work)
    same = all(np.array_equal(a, b, equal_nan=True) for a, b in zip(_arrays(work), given, strict=True))
    contract.holds(same, "the candidates are not changed", case)
    contract.holds(frame(make(), work) == chosen, "the same candidates give the same decisions", case)
    if mandatory:
        _check_mandatory(contract, case, work, budget, [item for item, _ in chosen])
    if any_order:
        order = np.random.default_rng(case.seed).permutation(len(work))
        found = [(int(order[item]), passes) for item, passes in frame(make(), rows(work, order))]
        contract.holds(found == chosen, "decisions do not depend on the order of the candidates", case)
    _check_left(contract, make(), case, work)
    _check_take(contract, make(), case, work, budget)
    _check_frames(make(), case, work, frame)


def _check_mandatory(contract: Contract, case: Case, work: Candidates, budget: float, chosen: list[int]) -> None:
    first = [bool(work.mandatory[item]) for item in chosen]
    contract.holds(first == sorted(first, reverse=True), "mandatory items come first", case)
    if float(work.predicted_cost[work.mandatory].sum()) <= budget:
        missing = sorted(set(np.flatnonzero(work.mandatory).tolist()) - set(chosen))
        contract.holds(not missing, f"mandatory items that fit are asked for; missing: {missing}", case)


def _check_left(contract: Contract, heuristic: Heuristic, case: Case, work: Candidates) -> None:
    """What is left may also rise between calls, when items took less than predicted."""
    tally = Tally(contract, work, case)
    heuristic.begin_frame(work, context(80.0 * case.scale, budget_unit="rays" if case.unit == "none" else case.unit))
    for left in case.left:
        answer = heuristic.next(left * case.scale)
        if answer is not None:
            tally.add(tally.request(answer), left * case.scale)
    heuristic.end_frame()


def _check_take(contract: Contract, heuristic: Heuristic, case: Case, work: Candidates, budget: float) -> None:
    """Many at once keep the same rules, and those before the last one are not more than was asked for."""
    tally, left = Tally(contract, work, case), budget
    heuristic.begin_frame(work, context(budget, budget_unit=case.unit))
    for _ in range(len(work) * PASSES + 1):
        enough = left if case.seed % 2 else 0.3 * left
        taken = heuristic.take(left, enough)
        if taken is None or not len(taken):
            break
        table = _as_table(contract, taken, case)
        contract.holds(len(np.unique(table[:, 0])) == len(table), "take names no item twice in one answer", case)
        costs = []
        for item, passes in table.tolist():
            costs.append(tally.add(tally.request(Request(item, passes)), left))
            left -= costs[-1]
        before = sum(costs[:-1])
        contract.holds(before <= enough or math.isinf(enough), f"take is content with {enough:g}, not {before:g}", case)
    else:
        contract.holds(False, "answers of take end", case)
    heuristic.end_frame()


def _as_table(contract: Contract, taken: object, case: Case) -> np.ndarray:
    """(k, 2) items and passes of what `take` returned."""
    fits = (
        isinstance(taken, np.ndarray)
        and taken.dtype.kind in "iu"
        and (taken.ndim == 1 or (taken.ndim == 2 and taken.shape[1] == 2))
    )
    contract.holds(fits, f"take returns (k,) or (k, 2) integers or None, not {taken!r:.80}", case)
    array = np.asarray(taken)
    return array if array.ndim == 2 else np.stack([array, np.full(len(array), PASSES)], axis=1)


def _check_frames(heuristic: Heuristic, case: Case, work: Candidates, frame: Callable[..., object]) -> None:
    """Four frames in a row: items come and go, the second has two sub-pixel samples, reports come late."""
    random = np.random.default_rng(case.seed + OBJECTS)
    for index, samples in enumerate((1, 2, 1, 1)):
        for sample in range(samples):
            some = np.flatnonzero(random.random(len(work)) < 0.6)
            frame(heuristic, rows(work, some), index, late=index, sample=sample, samples=samples)


def _arrays(work: Candidates) -> list[np.ndarray]:
    return [value for f in fields(work) if isinstance(value := getattr(work, f.name), np.ndarray)]
