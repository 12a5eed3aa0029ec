"""Knapsacks solved exactly by looking at few states: bounds first, then what is left, one group after the other.

Source: Kellerer et al. 2004, chapters 3, 5 and 11: lists of states that no other one outdoes (Nemhauser and Ullmann 1969), taken
from the break solution outwards (the core), with bounds of the relaxed problem; for groups as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

ROUNDING = 1e-9
"""Relative. Sums of costs that are no whole numbers may pass the budget by so much, as rounding does: what fits exactly fits."""
NOTHING = 1e-15
"""Of the budget: so little is nothing."""
MOST_STATES = 50_000
"""With more states than this to look at, the search gives up."""


@dataclass(frozen=True)
class Problem:
    """n items; room: what costs may sum up to; groups are numbers, of which every one that occurs may be chosen from once."""

    benefit: np.ndarray
    cost: np.ndarray
    room: float
    group: np.ndarray

    @classmethod
    def of(cls, benefit: np.ndarray, cost: np.ndarray, budget: float, group: np.ndarray) -> Problem:
        """With numbers near 1: benefits and costs are divided by powers of two, which rounds nothing. What costs next to nothing
        costs nothing then. There is a little room for rounding where costs are no whole numbers."""
        whole = bool((cost == np.floor(cost)).all())
        room = budget if whole or math.isinf(budget) else budget * (1 + ROUNDING)
        most = float(benefit.max(initial=0.0))
        if most > 0:
            benefit = np.ldexp(benefit, -math.frexp(most)[1])
        if 0 < room < math.inf:
            exponent = -math.frexp(room)[1]
            # What is dearer than this does not fit anyway.
            cost = np.ldexp(np.where(cost > room, math.inf, cost), exponent)
            cost, room = np.where(cost < NOTHING, 0.0, cost), math.ldexp(room, exponent)
        return cls(benefit, cost, room, group)

    def __len__(self) -> int:
        return len(self.benefit)

    def part(self, rows: np.ndarray) -> Problem:
        """The items `rows`, their groups counted from 0."""
        group = np.unique(self.group[rows], return_inverse=True)[1]
        return Problem(self.benefit[rows], self.cost[rows], self.room, group)

    def worth_a_look(self) -> np.ndarray:
        """(k,) rows that bring something, fit, and bring more than all of their group that cost no more."""
        rows = np.flatnonzero((self.benefit > 0) & np.isfinite(self.cost) & (self.cost <= self.room))
        rows = rows[np.lexsort((-self.benefit[rows], self.cost[rows], self.group[rows]))]
        kept, last, best = [], None, 0.0
        for row in rows.tolist():
            if self.group[row] != last or self.benefit[row] > best:
                kept.append(row)
                last, best = self.group[row], self.benefit[row]
        return np.array(kept, np.int64)

    def mask(self, rows: np.ndarray) -> np.ndarray:
        """(n,) bool, True at `rows`."""
        chosen = np.zeros(len(self), bool)
        chosen[rows] = True
        return chosen

    def benefit_of(self, chosen: np.ndarray) -> float:
        """What `chosen` (n,) bool brings together."""
        return float(self.benefit[chosen].sum())

    def cost_of(self, chosen: np.ndarray) -> float:
        """What `chosen` (n,) bool costs together."""
        return float(self.cost[chosen].sum())

    def best_of_groups(self, worth: np.ndarray) -> np.ndarray:
        """(groups,) row of the item of each group with the highest `worth` (n,); of equals the cheapest."""
        order = np.lexsort((self.cost, -worth, self.group))
        first = np.ones(len(order), bool)
        first[1:] = np.diff(self.group[order]) != 0
        return order[first]


@dataclass(frozen=True)
class Relaxed:
    """A problem whose budget is replaced by a price of a unit of cost: then every group is decided by itself.

    price   : about the least at which what is worth it fits the budget: the Lagrangian multiplier
    chosen  : (n,) bool, what is worth it
    loss    : (n,) float64, 0 or more, what is lost by taking an item instead of what is best for its group at this price
    nothing : (groups,) float64, what is lost by taking nothing of a group
    upper   : price * budget + sum of what is best; no choice brings more. A choice brings `upper` less its losses, less price times
              what it leaves of the budget.
    """

    problem: Problem
    price: float
    chosen: np.ndarray
    loss: np.ndarray
    nothing: np.ndarray
    upper: float

    @classmethod
    def of(cls, problem: Problem) -> Relaxed:
        costly = problem.cost > 0
        low, high = 0.0, float((problem.benefit[costly] / problem.cost[costly]).max()) * 2
        for _ in range(60):
            middle = (low + high) / 2
            if problem.cost_of(cls._worth_it(problem, middle)[0]) <= problem.room:
                high = middle
            else:
                low = middle
        chosen, worth, most = cls._worth_it(problem, high)
        upper = high * problem.room + math.fsum(most.tolist())
        return cls(problem, high, chosen, most[problem.group] - worth, most, upper)

    @staticmethod
    def _worth_it(problem: Problem, price: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What is chosen (n,) bool, what items are worth (n,), and what the best of every group is worth, at least 0."""
        worth = problem.benefit - price * problem.cost
        best = problem.best_of_groups(worth)
        return problem.mask(best[worth[best] > 0]), worth, np.maximum(worth[best], 0.0)


def best_by_states(relaxed: Relaxed, tolerance: float = 0.0) -> tuple[np.ndarray, bool]:
    """The best choice (n,) bool, and whether it is proven to be: False where there were more than MOST_STATES to look at.

    From what is best at the price, groups are decided anew one after the other, those first that lose least for what they change in
    cost. A state is what some of these decisions cost and lose together; one that costs no less and brings no more than another is
    dropped, and one that has lost so much, or must lose so much more to use up the budget or to come down to it, that nothing
    better than the best so far can follow.
    """
    problem, price = relaxed.problem, relaxed.price
    groups = sorted(_options_of(relaxed), key=lambda group: min(group.rate_up, group.rate_down))
    # The least that a unit of cost more, or less, can lose in the groups that are left; a unit may also stay unused.
    up = np.minimum.accumulate([price, *(group.rate_up for group in groups[::-1])])[::-1]
    down = np.minimum.accumulate([math.inf, *(group.rate_down for group in groups[::-1])])[::-1]
    least = np.minimum.accumulate([math.inf, *(float(group.loss.min()) for group in groups[::-1])])[::-1]
    cost, loss = np.array([problem.cost_of(relaxed.chosen)]), np.zeros(1)
    lowest, best = math.inf, (0, 0)
    steps: list[_Step] = []
    margin = relaxed.upper * max(tolerance * (1 - tolerance), 1e-12)
    for number in range(len(groups) + 1):
        # The best state so far that fits.
        lost = np.where(cost <= problem.room, loss + price * (problem.room - cost), math.inf)
        row = int(np.argmin(lost))
        if lost[row] < lowest:
            lowest, best = float(lost[row]), (len(steps), row)
        limit = lowest - margin
        if least[number] >= limit:
            break
        options = groups[number].below(limit)
        # Every state as it is, and with every other choice of the group.
        parent = np.tile(np.arange(len(cost)), len(options.rows) + 1)
        choice = np.repeat(np.arange(-1, len(options.rows)), len(cost))
        cost = np.concatenate([cost, (cost + options.cost[:, None]).reshape(-1)])
        loss = np.concatenate([loss, (loss + options.loss[:, None]).reshape(-1)])
        # What can still become better than the best so far, and of these what no other one outdoes.
        over = cost - problem.room
        least_up, least_down = float(up[number + 1]), float(down[number + 1])
        still = over * np.where(over > 0, least_down, -least_up)
        order = np.flatnonzero(loss + still < limit)
        order = order[np.lexsort((loss[order], cost[order]))]
        brings = price * cost[order] - loss[order]
        ahead = np.maximum.accumulate(np.concatenate([[-math.inf], brings[:-1]]))
        order = order[brings > ahead]
        if not len(order):
            break
        cost, loss = cost[order], loss[order]
        steps.append(_Step(options, parent[order], choice[order]))
        if len(order) > MOST_STATES:
            return _walked_back(relaxed, steps, best), False
    return _walked_back(relaxed, steps, best), True


@dataclass(frozen=True)
class _Options:
    """What could be done with a group instead of what is best at the price: rows of items, -1 for none; cost and loss against
    that. rate_up, rate_down: the least loss for a unit of cost more, and less."""

    group: int
    rows: np.ndarray
    cost: np.ndarray
    loss: np.ndarray

    @cached_property
    def rate_up(self) -> float:
        return float((self.loss / self.cost)[self.cost > 0].min(initial=math.inf))

    @cached_property
    def rate_down(self) -> float:
        return float((self.loss / -self.cost)[self.cost < 0].min(initial=math.inf))

    def below(self, limit: float) -> _Options:
        """Those that lose less than `limit`."""
        kept = self.loss < limit
        return _Options(self.group, self.rows[kept], self.cost[kept], self.loss[kept])


def _options_of(relaxed: Relaxed) -> list[_Options]:
    """Of every group that has any. What changes no cost only loses, and is none."""
    problem, made = relaxed.problem, []
    order = np.argsort(problem.group, kind="stable")
    ends = np.cumsum(np.bincount(problem.group, minlength=len(relaxed.nothing)))
    for group, mine in enumerate(np.split(order, ends[:-1])):
        now = mine[relaxed.chosen[mine]]
        rows = mine[~relaxed.chosen[mine]]
        paid = float(problem.cost[now].sum())
        cost, loss = problem.cost[rows] - paid, relaxed.loss[rows]
        if len(now):
            rows, cost, loss = np.append(rows, -1), np.append(cost, -paid), np.append(loss, relaxed.nothing[group])
        kept = cost != 0
        if kept.any():
            made.append(_Options(group, rows[kept], cost[kept], loss[kept]))
    return made


@dataclass(frozen=True)
class _Step:
    """How the states after a group came about: parent (s,), of which state before; choice (s,), by which option, -1 for none."""

    options: _Options
    parent: np.ndarray
    choice: np.ndarray


def _walked_back(relaxed: Relaxed, steps: list[_Step], at: tuple[int, int]) -> np.ndarray:
    """The choice (n,) bool of state `at`: after how many steps, and which of the states there."""
    chosen, (count, state) = relaxed.chosen.copy(), at
    for step in reversed(steps[:count]):
        option = int(step.choice[state])
        if option >= 0:
            chosen[relaxed.problem.group == step.options.group] = False
            if (row := step.options.rows[option]) >= 0:
                chosen[row] = True
        state = int(step.parent[state])
    return chosen
