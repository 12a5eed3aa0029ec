"""The raster picture: values of a small picture, by object."""

from __future__ import annotations

import numpy as np

from phrt.kernels.jit import kernel


@kernel
def sum_by_object(object_id, column, row, values, sums, counts):
    """sums (N + 1,) float64 += values (h, w) at the place of every pixel, by object; counts (N + 1,) int64 += how many those are.

    object_id (H, W); column (W,) and row (H,) int32: the place in `values` of every column and row of pixels.
    """
    for y in range(object_id.shape[0]):
        line = values[row[y]]
        # Neighbours mostly show the same object.
        current, total, run = object_id[y, 0], 0.0, 0
        for x in range(object_id.shape[1]):
            o = object_id[y, x]
            if o != current:
                sums[current] += total
                counts[current] += run
                current, total, run = o, 0.0, 0
            total += np.float64(line[column[x]])
            run += 1
        sums[current] += total
        counts[current] += run
