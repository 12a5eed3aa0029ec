"""Which pictures of a block are kept."""

from __future__ import annotations

import numpy as np
import pytest

from phrt_plugins.bench.blocks import worth_a_look

JUDGED = [10, 15, 20]


@pytest.mark.parametrize(
    ("kept", "columns", "expected"),
    [
        ({10}, {"flip": [0.1, 0.3, 0.2]}, {10, 15}),
        ({15}, {"flip": [0.1, 0.3, np.nan]}, {15}),
        ({10}, {"flip": [0.1, 0.2, 0.3], "display_error": [0.9, 0.0, 0.0]}, {10, 20}),
        ({20}, {"display_error": [0.9, 0.0, 0.0]}, {10, 20}),
        ({10}, {"ssim": [0.1, 0.3, 0.2]}, {10}),
        ({10}, {"flip": [np.nan, np.nan, np.nan]}, {10}),
        (set(), {"flip": [0.1, 0.3, 0.2]}, set()),
    ],
)
def test_the_worst_picture_is_kept_beside_the_chosen_ones(
    kept: set[int], columns: dict[str, list[float]], expected: set[int]
) -> None:
    assert worth_a_look(kept, JUDGED, {name: np.array(values) for name, values in columns.items()}) == expected
