"""Lights of a world as Mitsuba's emitters. Units and falloffs are those of PHRT (docs/conventions.md).

Lights are not seen, as in PHRT: an extended one is sampled point by point, and no ray can hit it. Where Mitsuba has the very
light (a point, parallel rays) it is Mitsuba's own; everything else, a falloff of a spot, a range, an extent, is `extended_light`.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from phrt.lights import DIRECTIONAL, POINT, RECT, SPHERE, SPOT

if TYPE_CHECKING:
    from phrt.scene import Dome
    from phrt.world import World


def emitters(mitsuba: Any, world: World) -> dict[str, Any]:
    """Every light of `world` and its dome, by name, for `load_dict`."""
    low, high = world.bounds()
    outside = 2.0 * float(np.linalg.norm(high - low)) + 1.0
    found = {f"light{number}": emitter(mitsuba, record, outside) for number, record in enumerate(world.lights)}
    dome = environment(mitsuba, world.scene.dome)
    return found if dome is None else {**found, "dome": dome}


def emitter(mitsuba: Any, light: np.void, outside: float) -> Any:
    """One light, a row of LIGHT_DTYPE. outside: metres that lead out of the scene from anywhere in it."""
    color = {"type": "rgb", "value": light["color"].tolist()}
    plain = not light["inverse_range"] and not light["radius"] and not light["tan_half_angle"]
    if plain and light["kind"] in (POINT, SPHERE):
        return {"type": "point", "position": light["position"].tolist(), "intensity": color}
    if plain and light["kind"] == DIRECTIONAL:
        return {"type": "directional", "direction": light["direction"].tolist(), "irradiance": color}
    return extended_light(mitsuba.variant())(light, outside)


def environment(mitsuba: Any, dome: Dome) -> dict[str, Any] | None:
    """The dome, None where it is black."""
    if not np.any(dome.color):
        return None
    if dome.pixels is None:
        return {"type": "constant", "radiance": {"type": "rgb", "value": [float(value) for value in dome.color]}}
    pixels = np.ascontiguousarray(dome.pixels * np.asarray(dome.color, np.float32), np.float32)
    # Mitsuba's first column looks down -Z, ours does in the middle; both go on towards +X.
    turn = mitsuba.ScalarTransform4f().rotate([0, 1, 0], 180.0 + float(np.degrees(dome.rotation)))
    return {"type": "envmap", "bitmap": mitsuba.Bitmap(pixels), "to_world": turn}


@cache
def extended_light(variant: str) -> Any:
    """The class `ExtendedLight` for `variant`, which must be set."""
    import drjit
    import mitsuba

    dr: Any = drjit
    mi: Any = mitsuba

    class ExtendedLight(mi.Emitter):  # type: ignore[misc]
        """A light by the rules of PHRT. To Mitsuba it is one without extent: whenever it is asked, it picks a point of itself.

        Extents: a disc that faces what is lit (sphere), a cone of directions (directional), a rectangle. A rectangle's light is
        that of its surface, exactly; PHRT's own shading takes it as coming from its centre.
        """

        def __init__(self, light: np.void, outside: float) -> None:
            super().__init__(mi.Properties("phrt_light"))
            self.m_flags = +mi.EmitterFlags.DeltaPosition
            self.kind = int(light["kind"])
            self.color = mi.Color3f(light["color"].tolist())
            self.position = mi.Point3f(light["position"].tolist())
            self.direction = mi.Vector3f(light["direction"].tolist())
            self.half_u, self.half_v = (mi.Vector3f(light[name].tolist()) for name in ("half_u", "half_v"))
            self.area = 4.0 * float(np.linalg.norm(np.cross(light["half_u"], light["half_v"])))
            extent = "tan_half_angle" if self.kind == DIRECTIONAL else "radius"
            self.radius, self.inverse_range = float(light[extent]), float(light["inverse_range"])
            self.cos_inner, self.cos_outer = float(light["cos_inner"]), float(light["cos_outer"])
            self.outside = outside

        def sample_direction(self, it: Any, sample: Any, active: Any = True) -> tuple[Any, Any]:
            point, falloff = self.towards(it.p, sample)
            way = point - it.p
            distance = dr.norm(way)
            direction = way / distance
            if self.kind == SPOT:
                cosine = -dr.dot(direction, self.direction)
                inside = (cosine - self.cos_outer) / max(self.cos_inner - self.cos_outer, 1e-4)
                falloff *= dr.square(dr.clip(inside, 0.0, 1.0))
            elif self.kind == RECT:
                cosine = -dr.dot(direction, self.direction)
                falloff *= self.area * dr.maximum(cosine, 0.0) / dr.square(distance)
            record = mi.DirectionSample3f()
            record.p, record.n, record.uv, record.time = point, mi.Normal3f(-direction), sample, it.time
            record.pdf, record.delta = 1.0, True
            record.d, record.dist = direction, distance
            record.emitter = mi.EmitterPtr(self) if dr.is_jit_v(mi.Float) else self
            return record, mi.Spectrum(self.color * falloff) & active

        def towards(self, place: Any, sample: Any) -> tuple[Any, Any]:
            """A point of the light as seen from `place`, and what distance and range leave of it."""
            if self.kind == RECT:
                point = self.position + self.half_u * (2 * sample.x - 1) + self.half_v * (2 * sample.y - 1)
                return point, self.window(dr.squared_norm(self.position - place))
            disc = mi.warp.square_to_uniform_disk_concentric(sample) * self.radius
            if self.kind == DIRECTIONAL:
                frame = mi.Frame3f(-self.direction)
                way = dr.normalize(frame.n + frame.s * disc.x + frame.t * disc.y)
                return place + way * self.outside, mi.Float(1.0)
            way = self.position - place
            square = dr.squared_norm(way)
            frame = mi.Frame3f(way / dr.sqrt(square))
            point = self.position + frame.s * disc.x + frame.t * disc.y
            return point, self.window(square) / square

        def window(self, square: Any) -> Any:
            """What a range leaves of the light at a squared distance (KHR_lights_punctual)."""
            return dr.maximum(1.0 - dr.square(square * self.inverse_range**2), 0.0)

        def eval(self, si: Any, active: Any = True) -> Any:
            return mi.Spectrum(0.0)

        def pdf_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            return mi.Float(0.0)

        def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            return mi.Spectrum(0.0)

        def bbox(self) -> Any:
            return mi.ScalarBoundingBox3f()

        def to_string(self) -> str:
            return f"ExtendedLight[kind={self.kind}]"

    return ExtendedLight
