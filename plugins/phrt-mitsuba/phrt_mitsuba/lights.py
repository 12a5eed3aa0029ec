"""Lights of a world as Mitsuba's emitters. Units and falloffs are those of PHRT (docs/conventions.md).

Lights are not seen, as in PHRT: an extended one is sampled point by point, and no ray can hit it. All lights together are one
emitter, which takes them as often as they matter at a place: Mitsuba by itself takes all equally often, and most of a dozen
lamps are far away. In scalar variants, where Python is slow, what Mitsuba has itself (a point, parallel rays) is Mitsuba's.
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
    scalar = mitsuba.variant().startswith("scalar")
    plain = [plain_emitter(light) if scalar else None for light in world.lights]
    found: dict[str, Any] = {f"light{number}": made for number, made in enumerate(plain) if made is not None}
    others = [light for light, made in zip(world.lights, plain, strict=True) if made is None]
    if others:
        low, high = world.bounds()
        outside = 2.0 * float(np.linalg.norm(high - low)) + 1.0
        found["lights"] = lights_class(mitsuba.variant())(others, outside)
    dome = environment(mitsuba, world.scene.dome)
    return found if dome is None else {**found, "dome": dome}


def plain_emitter(light: np.void) -> dict[str, Any] | None:
    """Mitsuba's own emitter for a row of LIGHT_DTYPE, None where it has none."""
    if light["inverse_range"] or light["radius"] or light["tan_half_angle"]:
        return None
    color = {"type": "rgb", "value": light["color"].tolist()}
    if light["kind"] in (POINT, SPHERE):
        return {"type": "point", "position": light["position"].tolist(), "intensity": color}
    if light["kind"] == DIRECTIONAL:
        return {"type": "directional", "direction": light["direction"].tolist(), "irradiance": color}
    return None


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


TINY = 1e-30


class LightOf:
    """One light by the rules of PHRT, in the arrays of a variant: a row of LIGHT_DTYPE. outside: metres that lead out of the
    scene from anywhere in it.

    Extents: a disc that faces what is lit (sphere), a cone of directions (directional), a rectangle. A rectangle's light is
    that of its surface, exactly; PHRT's own shading takes it as coming from its centre.
    """

    def __init__(self, mi: Any, dr: Any, light: np.void, outside: float) -> None:
        self.mi, self.dr, self.outside = mi, dr, outside
        self.kind = int(light["kind"])
        self.color = mi.Color3f(light["color"].tolist())
        self.position = mi.Point3f(light["position"].tolist())
        self.direction = mi.Vector3f(light["direction"].tolist())
        self.half_u, self.half_v = (mi.Vector3f(light[name].tolist()) for name in ("half_u", "half_v"))
        self.brightness = float(light["color"].max())
        self.area = 4.0 * float(np.linalg.norm(np.cross(light["half_u"], light["half_v"])))
        self.radius = float(light["tan_half_angle" if self.kind == DIRECTIONAL else "radius"])
        self.inverse_range = float(light["inverse_range"])
        self.cos_inner, self.cos_outer = float(light["cos_inner"]), float(light["cos_outer"])

    def weight(self, place: Any) -> Any:
        """How much of it should arrive at `place`, about; 0 only where nothing does."""
        if self.kind == DIRECTIONAL:
            return self.mi.Float(self.brightness)
        square = self.dr.squared_norm(self.position - place)
        near = self.area / np.pi if self.kind == RECT else self.radius**2
        return self.brightness * self.shape(place) / self.dr.maximum(square, near + 1e-8)

    def sample(self, place: Any, sample: Any) -> tuple[Any, Any]:
        """A point of it as seen from `place`, and the light that arrives from there, were it all of the light."""
        dr = self.dr
        if self.kind == RECT:
            point = self.position + self.half_u * (2 * sample.x - 1) + self.half_v * (2 * sample.y - 1)
            way = point - place
            square = dr.squared_norm(way)
            cosine = dr.maximum(-dr.dot(way, self.direction), 0.0) / dr.sqrt(square)
            window = self.window(dr.squared_norm(self.position - place))
            return point, self.color * (window * self.area * cosine / square)
        disc = self.mi.warp.square_to_uniform_disk_concentric(sample) * self.radius
        if self.kind == DIRECTIONAL:
            frame = self.mi.Frame3f(-self.direction)
            way = dr.normalize(frame.n + frame.s * disc.x + frame.t * disc.y)
            return place + way * self.outside, self.color
        way = self.position - place
        square = dr.squared_norm(way)
        frame = self.mi.Frame3f(way / dr.sqrt(square))
        point = self.position + frame.s * disc.x + frame.t * disc.y
        # Nothing comes nearer to the middle of a ball than its radius.
        return point, self.color * (self.shape(place) / dr.maximum(square, self.radius**2))

    def shape(self, place: Any) -> Any:
        """What cone, side and range leave of it at `place`."""
        dr = self.dr
        way = place - self.position
        square = dr.squared_norm(way)
        left = self.window(square)
        if self.kind in (SPOT, RECT):
            cosine = dr.dot(way, self.direction) / dr.sqrt(square)
            if self.kind == RECT:
                return left * dr.maximum(cosine, 0.0)
            inside = (cosine - self.cos_outer) / max(self.cos_inner - self.cos_outer, 1e-4)
            return left * dr.square(dr.clip(inside, 0.0, 1.0))
        return left

    def window(self, square: Any) -> Any:
        """What a range leaves of it at a squared distance (KHR_lights_punctual)."""
        return self.dr.maximum(1.0 - self.dr.square(square * self.inverse_range**2), 0.0)


@cache
def lights_class(variant: str) -> Any:
    """The class `Lights` for `variant`, which must be set."""
    import drjit
    import mitsuba

    dr: Any = drjit
    mi: Any = mitsuba

    class Lights(mi.Emitter):  # type: ignore[misc]
        """All lights. To Mitsuba it is one light without extent: whenever it is asked, it picks a light, and a point of that."""

        def __init__(self, lights: list[np.void], outside: float) -> None:
            super().__init__(mi.Properties("phrt_lights"))
            self.m_flags = +mi.EmitterFlags.DeltaPosition
            self.lights = [LightOf(mi, dr, light, outside) for light in lights]

        def sample_direction(self, it: Any, sample: Any, active: Any = True) -> tuple[Any, Any]:
            shares = self.shares(it.p)
            # One light by its share; what is left of the random number is as good as new.
            rest, point, arriving = sample.x, mi.Point3f(0.0), mi.Color3f(0.0)
            found = mi.Bool(False)
            for light, share in zip(self.lights, shares, strict=True):
                taken = ~found & (rest < share) if dr.is_jit_v(mi.Float) else not found and rest < share
                within = mi.Point2f(dr.clip(rest / dr.maximum(share, TINY), 0.0, 1.0), sample.y)
                there, color = light.sample(it.p, within)
                point = dr.select(taken, there, point)
                arriving = dr.select(taken, color / dr.maximum(share, TINY), arriving)
                found |= taken
                rest = rest - share
            way = point - it.p
            distance = dr.norm(way)
            record = mi.DirectionSample3f()
            record.p, record.n, record.uv, record.time = point, mi.Normal3f(-way / distance), sample, it.time
            record.pdf, record.delta = dr.select(found, mi.Float(1.0), mi.Float(0.0)), mi.Bool(True)
            record.d, record.dist = way / distance, distance
            record.emitter = mi.EmitterPtr(self) if dr.is_jit_v(mi.Float) else self
            return record, mi.Spectrum(arriving) & (active & found)

        def shares(self, place: Any) -> list[Any]:
            """How often each light is taken at `place`: half of the time by what should arrive of it, else any that reaches it,
            because a highlight may be of one that is far away."""
            weights = [light.weight(place) for light in self.lights]
            total = dr.maximum(sum(weights), TINY)
            reaching = [dr.select(weight > 0.0, mi.Float(1.0), mi.Float(0.0)) for weight in weights]
            count = dr.maximum(sum(reaching), 1.0)
            return [(weight / total + one / count) / 2 for weight, one in zip(weights, reaching, strict=True)]

        def eval(self, si: Any, active: Any = True) -> Any:
            return mi.Spectrum(0.0)

        def pdf_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            return mi.Float(0.0)

        def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            return mi.Spectrum(0.0)

        def bbox(self) -> Any:
            return mi.ScalarBoundingBox3f()

        def to_string(self) -> str:
            return f"Lights[{len(self.lights)}]"

    return Lights
