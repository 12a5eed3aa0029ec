"""The built-in effects and loaders: descriptors only, nothing heavy is imported."""

from __future__ import annotations

from phrt.registry import EffectPlugin, LoaderPlugin, hookimpl
from phrt_plugins.effects.options import (
    AmbientOcclusionOptions,
    ReflectionsOptions,
    RefractionsOptions,
    ShadowsOptions,
)
from phrt_plugins.loaders.options import AtriumOptions, GltfOptions, MeshOptions


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
    ]
