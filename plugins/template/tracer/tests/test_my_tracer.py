import numpy as np
from phrt.testing import check_tracer
from phrt.testing.tracers import few_triangles, rays_between

from phrt_my_tracer import MyTracer, MyTracerOptions


def test_it_keeps_the_contract() -> None:
    check_tracer(MyTracer, MyTracerOptions())


def test_how_many_are_looked_at_together_changes_no_answer() -> None:
    rays, found = rays_between([-2] * 3, [2] * 3, 300, seed=1), []
    for chunk in (1_000, 500_000):
        tracer = MyTracer(MyTracerOptions(chunk=chunk))
        tracer.build(few_triangles())
        found.append(tracer.closest_hit(rays).distance)
    assert np.isfinite(found[0]).any()
    assert np.array_equal(found[0], found[1])
