import numpy as np
from phrt.testing import check_metric
from phrt.testing.metrics import shot_of

from phrt_my_metric import MyMetric, MyMetricOptions


def test_it_keeps_the_contract() -> None:
    check_metric(MyMetric, MyMetricOptions())


def test_pixels_beyond_the_threshold_count() -> None:
    reference = np.full((10, 10, 3), 100, np.uint8)
    display = reference.copy()
    display[:3, :, 0] += 9
    display[5:, :, 1] -= 8
    assert MyMetric(MyMetricOptions(threshold=8)).of_shot(shot_of(display, reference)) == {"my_metric": 0.3}
