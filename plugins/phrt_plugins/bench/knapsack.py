"""The knapsack: which items bring the most within a budget, exactly.

    maximise  sum of benefit[i] x[i]   with   sum of cost[i] x[i] <= budget,   x[i] 0 or 1,

and, where items come in groups, at most one of each group (the multiple-choice knapsack). The knapsacks of a frame are solved in
some milliseconds by `knapsack_states`; where that has too much to look at, HiGHS (scipy.optimize.milp; Huangfu and Hall 2018) is
asked, which takes 10 to 350 ms for the same.
"""

from __future__ import annotations

import math
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from phrt.errors import PhrtWarning
from phrt_plugins.bench.knapsack_states import Problem, Relaxed, best_by_states

PROVEN = 1e-9
"""Relative: a choice that HiGHS leaves short of the optimum by no more than this is called the optimum."""
TIME_LIMIT_S = 10.0
_SCALE = 1e4
"""What budgets and the largest benefit are scaled to: HiGHS's own tolerances are absolute, 1e-6."""


@dataclass(frozen=True)
class Solution:
    """chosen (n,) bool; gap: the optimum may be better by at most this share of what was found, 0 when it is the optimum."""

    chosen: np.ndarray
    gap: float = 0.0


def best_items(
    benefit: np.ndarray, cost: np.ndarray, budget: float, *, time_limit_s: float = TIME_LIMIT_S
) -> np.ndarray:
    """(n,) bool, the items that bring the most together and cost no more than `budget` together.

    benefit, cost : (n,), any unit; cost 0 or more, infinite for what cannot be had. budget : in the unit of cost; may be infinite
    time_limit_s  : for the solver. Where it ends first, the best choice so far is returned, and a PhrtWarning says how far it
                    may be from the optimum.

    An item of benefit 0 or less is never taken, one that costs nothing and brings something always. Raises ValueError for NaN, a
    negative cost, and arrays that do not match.
    """
    return warned(solve(benefit, cost, budget, time_limit_s=time_limit_s)).chosen


def warned(solution: Solution) -> Solution:
    """`solution`; a PhrtWarning where it is not proven to be the optimum."""
    if solution.gap:
        warnings.warn(
            f"a knapsack of {len(solution.chosen)} items was not solved in time: the optimum may be better by up to "
            f"{solution.gap:.3%}",
            PhrtWarning,
            stacklevel=3,
        )
    return solution


def solve(
    benefit: np.ndarray,
    cost: np.ndarray,
    budget: float,
    group: np.ndarray | None = None,
    *,
    tolerance: float = 0.0,
    time_limit_s: float = TIME_LIMIT_S,
) -> Solution:
    """As `best_items`, with at most one item of each group, and without a warning.

    group     : (n,) integers; None, each its own
    tolerance : a choice is good enough when the optimum brings no more than this share more
    """
    benefit, cost = np.asarray(benefit, np.float64), np.asarray(cost, np.float64)
    group = np.arange(benefit.size) if group is None else np.asarray(group)
    _check(benefit, cost, budget, group)
    problem = Problem.of(benefit, cost, max(float(budget), 0.0), group)
    chosen = np.zeros(len(benefit), bool)
    rows = problem.worth_a_look()
    found, gap = _solve_part(problem.part(rows), tolerance, time_limit_s)
    chosen[rows[found]] = True
    return Solution(chosen, gap)


def _check(benefit: np.ndarray, cost: np.ndarray, budget: float, group: np.ndarray) -> None:
    if benefit.ndim != 1 or not benefit.shape == cost.shape == group.shape:
        raise ValueError(f"benefit {benefit.shape}, cost {cost.shape} and group {group.shape} must be one row of items")
    if not np.isfinite(benefit).all():
        raise ValueError("a benefit is NaN or infinite; every benefit must be a finite number")
    if math.isnan(budget) or np.isnan(cost).any():
        raise ValueError(f"a cost or the budget is NaN: the budget is {budget}, {np.isnan(cost).sum()} costs are NaN")
    if (cost < 0).any():
        raise ValueError(f"the smallest cost is {cost.min()}; it must be 0 or more")


def _solve_part(problem: Problem, tolerance: float, time_limit_s: float) -> tuple[np.ndarray, float]:
    """What is chosen, (n,) bool, and the gap, of a problem whose items all bring something and fit."""
    if not len(problem):
        return np.zeros(0, bool), 0.0
    everything = problem.mask(problem.best_of_groups(problem.benefit))
    if problem.cost_of(everything) <= problem.room:
        return everything, 0.0
    relaxed = Relaxed.of(problem)
    found, proven = best_by_states(relaxed, tolerance)
    if proven:
        return found, 0.0
    other, bound = _highs(problem, tolerance, time_limit_s)
    if problem.cost_of(other) <= problem.room and problem.benefit_of(other) > problem.benefit_of(found):
        found = other
    value = problem.benefit_of(found)
    gap = min(relaxed.upper, bound) / value - 1 if value > 0 else math.inf
    return found, gap if gap > max(PROVEN, tolerance) else 0.0


def _highs(problem: Problem, tolerance: float, time_limit_s: float) -> tuple[np.ndarray, float]:
    """What HiGHS chooses, (n,) bool, nothing where it found nothing in time, and what no choice can pass."""
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import csr_array

    count, groups = len(problem), int(problem.group.max()) + 1
    scale = float(problem.benefit.max()) / _SCALE
    constraints = [LinearConstraint(problem.cost[None] * (_SCALE / problem.room), -np.inf, _SCALE)]
    if groups < count:
        member = csr_array((np.ones(count), (problem.group, np.arange(count))), shape=(groups, count))
        constraints.append(LinearConstraint(member, -np.inf, 1.0))
    with _no_prints():
        result = milp(
            -problem.benefit / scale,
            constraints=constraints,
            integrality=np.ones(count),
            bounds=Bounds(0, 1),
            options={"time_limit": time_limit_s, "mip_rel_gap": tolerance},
        )
    bound = math.inf if result.mip_dual_bound is None else -result.mip_dual_bound * scale
    if result.x is None:
        return np.zeros(count, bool), bound
    return result.x > 0.5, bound


@contextmanager
def _no_prints() -> Iterator[None]:
    """Lines that HiGHS 1.12 prints past its own switch, into the middle of what a command prints, go nowhere."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)
