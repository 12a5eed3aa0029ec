"""What surfaces do in PHRT that Mitsuba's do not by themselves: cast no shadow, and absorb on the way through a body."""

from __future__ import annotations

from functools import cache
from typing import Any


@cache
def surface_class(variant: str) -> Any:
    """The class `Surface` for `variant`, which must be set."""
    import drjit
    import mitsuba

    dr: Any = drjit
    mi: Any = mitsuba

    class Surface(mi.BSDF):  # type: ignore[misc]
        """`nested`, with one of these, or both:

        absorbed   : (3,) per metre. A path that comes from inside has gone through the body since its last corner: it is left what
                     Beer and Lambert leave it. No noise comes of it, as it would of a medium of Mitsuba's.
        casts_shadow: False lets `volpath` see light sources through it as if it were not there.
        """

        def __init__(self, nested: Any, absorbed: tuple[float, float, float], casts_shadow: bool) -> None:
            super().__init__(mi.Properties("phrt_surface"))
            self.nested, self.absorbed, self.casts_shadow = nested, mi.Color3f(list(absorbed)), casts_shadow
            self.m_components = [nested.flags(index) for index in range(nested.component_count())]
            self.m_flags = nested.flags()

        def left(self, si: Any) -> Any:
            """What is left of the light on its way through the body."""
            inside = mi.Frame3f.cos_theta(si.wi) < 0.0
            return dr.select(inside, dr.exp(-self.absorbed * si.t), mi.Color3f(1.0))

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            record, weight = self.nested.sample(ctx, si, sample1, sample2, active)
            return record, weight * self.left(si)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.nested.eval(ctx, si, wo, active) * self.left(si)

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.nested.pdf(ctx, si, wo, active)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            value, density = self.nested.eval_pdf(ctx, si, wo, active)
            return value * self.left(si), density

        def eval_null_transmission(self, si: Any, active: Any = True) -> Any:
            return self.nested.eval_null_transmission(si, active) if self.casts_shadow else mi.Spectrum(1.0)

        def to_string(self) -> str:
            return f"Surface[{self.nested}]"

    return Surface
