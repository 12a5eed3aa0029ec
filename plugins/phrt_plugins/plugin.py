"""The built-in effects, loaders and metrics: descriptors only, nothing heavy is imported."""

from __future__ import annotations

from phrt.registry import CommandPlugin, EffectPlugin, LoaderPlugin, MetricPlugin, hookimpl
from phrt_plugins.effects.options import (
    AmbientOcclusionOptions,
    ReflectionsOptions,
    RefractionsOptions,
    ShadowsOptions,
)
from phrt_plugins.loaders.options import AtriumOptions, GltfOptions, MeshOptions, SimplifiedOptions
from phrt_plugins.metrics.options import FlipOptions, RelMseOptions
from phrt_plugins.packages import flip_reason, simplification_reason, ssim_reason


@hookimpl
def phrt_effects() -> list[EffectPlugin]:
    return [
        EffectPlugin(
            name="shadows",
            summary="Shadow rays to every light: hard for point lights, soft for lights with an area.",
            factory="phrt_plugins.effects.shadows:Shadows",
            options=ShadowsOptions,
            order=10,
        ),
        EffectPlugin(
            name="reflections",
            summary="Mirror and glossy reflections, hits shaded with shadows.",
            factory="phrt_plugins.effects.reflections:Reflections",
            options=ReflectionsOptions,
            order=20,
        ),
        EffectPlugin(
            name="refractions",
            summary="Glass: Fresnel, total internal reflection, Beer-Lambert.",
            factory="phrt_plugins.effects.refractions:Refractions",
            options=RefractionsOptions,
            order=30,
        ),
        EffectPlugin(
            name="ambient_occlusion",
            summary="How much of the ambient light reaches a point past its surroundings.",
            factory="phrt_plugins.effects.ambient_occlusion:AmbientOcclusion",
            options=AmbientOcclusionOptions,
            order=40,
        ),
    ]


@hookimpl
def phrt_loaders() -> list[LoaderPlugin]:
    return [
        LoaderPlugin(
            name="gltf",
            summary="glTF 2.0, text and binary, with the material and light extensions.",
            factory="phrt_plugins.loaders.gltf:GltfLoader",
            options=GltfOptions,
            suffixes=(".gltf", ".glb"),
        ),
        LoaderPlugin(
            name="mesh",
            summary="OBJ with MTL, PLY and STL.",
            factory="phrt_plugins.loaders.mesh:MeshLoader",
            options=MeshOptions,
            suffixes=(".obj", ".ply", ".stl"),
        ),
        LoaderPlugin(
            name="atrium",
            summary="A colonnaded two-storey courtyard, made from parameters.",
            factory="phrt_plugins.loaders.atrium:AtriumLoader",
            options=AtriumOptions,
        ),
        LoaderPlugin(
            name="simplified",
            summary="What another loader reads, with a share of its triangles.",
            factory="phrt_plugins.loaders.simplify:SimplifiedLoader",
            options=SimplifiedOptions,
            unavailable_reason=simplification_reason,
        ),
    ]


@hookimpl
def phrt_metrics() -> list[MetricPlugin]:
    return [
        MetricPlugin(
            name="flip",
            summary="The difference that a viewer sees, pictures shown in turns: mean FLIP.",
            factory="phrt_plugins.metrics.flip:Flip",
            options=FlipOptions,
            unavailable_reason=flip_reason,
        ),
        MetricPlugin(
            name="ssim",
            summary="How much of the structure of the reference is there.",
            factory="phrt_plugins.metrics.ssim:Ssim",
            unavailable_reason=ssim_reason,
        ),
        MetricPlugin(
            name="psnr",
            summary="Peak signal-to-noise ratio of the displays.",
            factory="phrt_plugins.metrics.psnr:Psnr",
        ),
        MetricPlugin(
            name="relmse",
            summary="Squared error relative to the reference, in linear light.",
            factory="phrt_plugins.metrics.relmse:RelMse",
            options=RelMseOptions,
        ),
        MetricPlugin(
            name="error",
            summary="Mean absolute difference of the displays.",
            factory="phrt_plugins.metrics.error:DisplayError",
        ),
        MetricPlugin(
            name="temporal",
            summary="Change from frame to frame that is not the reference's: flicker, lag, popping.",
            factory="phrt_plugins.metrics.temporal:Temporal",
        ),
        MetricPlugin(
            name="pacing",
            summary="Are frames in time, and how evenly do they come?",
            factory="phrt_plugins.metrics.pacing:Pacing",
        ),
        MetricPlugin(
            name="flips",
            summary="How often decisions change from one frame to the next.",
            factory="phrt_plugins.metrics.flips:Flips",
        ),
        MetricPlugin(
            name="costs",
            summary="How far off the predictions of the cost models are.",
            factory="phrt_plugins.metrics.costs:Costs",
        ),
    ]


@hookimpl
def phrt_commands() -> list[CommandPlugin]:
    return [
        CommandPlugin(
            name="bench",
            summary="Compares heuristics on the same paths, fairly: pictures, decisions, times and measures in a folder.",
            factory="phrt_plugins.bench.command:make_command",
        ),
        CommandPlugin(
            name="report",
            summary="What a comparison came to: one HTML page that opens without a network, or tables for a text.",
            factory="phrt_plugins.report.command:make_command",
        ),
    ]
