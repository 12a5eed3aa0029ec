import numpy as np
from phrt.testing import check_heuristic
from phrt.testing.candidates import candidates, items_of

from phrt_my_heuristic import MyHeuristic, MyHeuristicOptions


def test_it_keeps_the_contract() -> None:
    check_heuristic(MyHeuristic, MyHeuristicOptions())


def test_nearer_items_come_first_and_those_that_do_not_fit_are_passed_over() -> None:
    work = candidates([10, 10, 30], distance=np.array([3, 2, 1], np.float32))
    assert items_of(MyHeuristic(MyHeuristicOptions()), work) == [2, 1, 0]
    assert items_of(MyHeuristic(MyHeuristicOptions()), work, budget=20) == [1, 0]
