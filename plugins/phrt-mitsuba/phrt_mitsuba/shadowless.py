"""What casts no shadow (`casts_shadow: false`), for Mitsuba: light sources pass it, everything else meets it."""

from __future__ import annotations

from functools import cache
from typing import Any


@cache
def shadowless(variant: str) -> Any:
    """The class `Shadowless` for `variant`, which must be set."""
    import mitsuba

    mi: Any = mitsuba

    class Shadowless(mi.BSDF):  # type: ignore[misc]
        """`nested`, but `volpath` sees light sources through it as if it were not there."""

        def __init__(self, nested: Any) -> None:
            super().__init__(mi.Properties("phrt_shadowless"))
            self.nested = nested
            self.m_components = [nested.flags(index) for index in range(nested.component_count())]
            self.m_flags = nested.flags()

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            return self.nested.sample(ctx, si, sample1, sample2, active)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.nested.eval(ctx, si, wo, active)

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.nested.pdf(ctx, si, wo, active)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.nested.eval_pdf(ctx, si, wo, active)

        def eval_null_transmission(self, si: Any, active: Any = True) -> Any:
            return mi.Spectrum(1.0)

        def to_string(self) -> str:
            return f"Shadowless[{self.nested}]"

    return Shadowless
