"""What this package brings: one descriptor. Nothing heavy is imported."""

from __future__ import annotations

from phrt.registry import EffectPlugin, hookimpl
from phrt_caustics.options import CausticsOptions


@hookimpl
def phrt_effects() -> list[EffectPlugin]:
    return [
        EffectPlugin(
            name="caustics",
            summary="Light that glass and mirrors gather on diffuse surfaces: photons from the lights, splatted.",
            factory="phrt_caustics.effect:Caustics",
            options=CausticsOptions,
        )
    ]
