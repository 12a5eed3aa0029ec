"""raster_only: trace nothing.

No item is traced, not even one that the scene marks `always`: every effect shows its fallback, as in a plain
rasterizer. It is the other end of the scale from `all_trace`, and shows what the fallbacks alone are worth.

Options: none.
Source: the raster-only side of the comparisons in Andrade et al. 2014, section 5.

Example::

    phrt render scenes/atrium.yaml -o atrium_raster.png --heuristic raster_only
"""

from __future__ import annotations

from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.registry import Options


class RasterOnly(Heuristic):
    """Yields no candidate."""

    def __init__(self, options: Options) -> None:
        return None

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        return None

    def next(self, remaining: float) -> int | None:
        return None
