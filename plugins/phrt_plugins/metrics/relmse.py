"""relmse: squared error relative to the reference, in linear light.

The mean over pixels and channels of (I - R)^2 / (R^2 + epsilon), of the linear pictures with exposure applied, before tone
mapping. An error counts by its share of the light, in the shade as in the sun, and highlights above white count too. A few wrong
pixels of a highlight can decide it: look at it beside flip.

Columns: relmse. relmse_changeable, the same over the pixels that a decision could change; left out where there is none.
Options: epsilon.
Source: Rousselle et al. 2011; 0.01 is the usual epsilon for pictures whose white is near 1.

Example, in a configuration of `phrt bench`::

    metrics: [relmse]
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.metric import Column, Metric, Shot
from phrt_plugins.metrics.options import RelMseOptions
from phrt_plugins.metrics.pictures import both


class RelMse(Metric):
    """Of the linear pictures."""

    columns = (
        Column("relmse", "relative mean squared error in linear light, 0 is equal", "", "lower"),
        Column("relmse_changeable", "the same over the pixels that a decision could change", "", "lower"),
    )

    def __init__(self, options: RelMseOptions) -> None:
        self._epsilon = options.epsilon

    def of_shot(self, shot: Shot) -> dict[str, float]:
        for name, picture in (("picture", shot.image), ("reference", shot.reference)):
            if not np.isfinite(picture).all():
                raise ValueError(f"the linear {name} holds NaN or infinity")
        wanted = shot.reference.astype(np.float64)
        errors = np.square(shot.image - wanted) / (np.square(wanted) + self._epsilon)
        return both("relmse", errors, shot.changeable)
