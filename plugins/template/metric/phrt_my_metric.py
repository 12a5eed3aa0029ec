"""my_metric: how much of the picture is visibly wrong.

Column: my_metric, the share of the pixels of which a channel of the 8-bit display is off by more than `threshold`; 0 to 1.

Options: threshold. Example, in a configuration of `phrt bench`: `metrics: [my_metric, flip]`
"""

import numpy as np
from phrt.interfaces.metric import Column, Metric, Shot
from phrt.registry import MetricPlugin, Options, hookimpl
from pydantic import Field


class MyMetricOptions(Options):
    threshold: int = Field(default=8, ge=0, le=254, description="Steps of 255 that a channel may be off.")


class MyMetric(Metric):
    columns = (Column("my_metric", "share of the pixels that are off by more than the threshold", "", "lower"),)

    def __init__(self, options: MyMetricOptions) -> None:
        self.options = options

    def of_shot(self, shot: Shot) -> dict[str, float]:
        off = np.abs(shot.display.astype(np.int16) - shot.reference_display).max(axis=2)
        return {"my_metric": float(np.mean(off > self.options.threshold))}


@hookimpl
def phrt_metrics() -> list[MetricPlugin]:
    factory = f"{__name__}:MyMetric"
    return [MetricPlugin("my_metric", "Share of the pixels that are visibly wrong.", factory, MyMetricOptions)]
