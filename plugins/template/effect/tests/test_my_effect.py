import numpy as np
from phrt.camera import look_at
from phrt.testing import check_effect
from phrt.testing.frames import frame_of
from phrt.testing.worlds import at, box, front_view, world_of

from phrt_my_effect import MyEffect, MyEffectOptions


def test_it_keeps_the_contract() -> None:
    check_effect(MyEffect, MyEffectOptions())


def test_it_is_dark_under_a_roof_and_not_on_top_of_it() -> None:
    floor, roof = (box(0.5), at(y=-0.75, scale=(3, 0.5, 1))), (box(0.5), at(x=0.5, y=0.5, scale=(1, 0.2, 1)))
    view = front_view(world_from_view=look_at((0, 1.2, 3), (0, 0, 0)))
    with frame_of(world_of([floor, roof]), view) as frame:
        facing_up = (frame.surfaces.geometric_normal[:, 1] > 0.9) & (frame.surfaces.object_id > 0)
        pixels = np.flatnonzero(facing_up).astype(np.int32)
        values = MyEffect(MyEffectOptions(strength=0.7)).trace(frame, pixels).values[:, 0]
        under_roof = (frame.surfaces.object_id[pixels] == 1) & (np.abs(frame.surfaces.position[pixels, 0] - 0.5) < 0.4)
        np.testing.assert_allclose(values[under_roof], 0.3, rtol=1e-6)
        assert under_roof.any()
        np.testing.assert_allclose(values[frame.surfaces.object_id[pixels] == 2], 1.0)
