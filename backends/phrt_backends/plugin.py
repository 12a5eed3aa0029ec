"""The built-in G-buffer producers and tracers: descriptors only, nothing heavy is imported."""

from __future__ import annotations

from phrt.registry import Device, GBufferPlugin, TracerPlugin, hookimpl
from phrt_backends.availability import embree_reason, open3d_reason
from phrt_backends.gbuffers.moderngl_context import gl_info, moderngl_reason
from phrt_backends.gbuffers.moderngl_options import ModernglOptions
from phrt_backends.gbuffers.raycast_options import RaycastOptions
from phrt_backends.options import EmbreeOptions, NumpyOptions, Open3dOptions


def gl_device() -> Device:
    """What OpenGL draws with. Raises PluginError where there is none."""
    info = gl_info()
    return Device(f"{info.renderer}, {info.vendor}, OpenGL {info.version}", info.is_hardware)


@hookimpl
def phrt_gbuffers() -> list[GBufferPlugin]:
    return [
        GBufferPlugin(
            name="moderngl",
            summary="Deferred OpenGL 3.3 pass with mipmapped textures, headless by EGL, on a GPU or on Mesa.",
            factory="phrt_backends.gbuffers.moderngl_producer:ModernglProducer",
            options=ModernglOptions,
            unavailable_reason=moderngl_reason,
            device=gl_device,
        ),
        GBufferPlugin(
            name="raycast",
            summary="Primary rays through the chosen tracer; needs no OpenGL.",
            factory="phrt_backends.gbuffers.raycast:RaycastProducer",
            options=RaycastOptions,
            needs_tracer=True,
        ),
    ]


@hookimpl
def phrt_tracers() -> list[TracerPlugin]:
    return [
        TracerPlugin(
            name="embree",
            summary="Embree 4 in packets of 16, from the library that embreex ships.",
            factory="phrt_backends.tracers.embree:EmbreeTracer",
            options=EmbreeOptions,
            unavailable_reason=embree_reason,
        ),
        TracerPlugin(
            name="open3d",
            summary="Open3D's RaycastingScene.",
            factory="phrt_backends.tracers.open3d_scene:Open3dTracer",
            options=Open3dOptions,
            unavailable_reason=open3d_reason,
        ),
        TracerPlugin(
            name="numpy",
            summary="A small BVH in plain numpy: slow and obvious, the oracle of the others.",
            factory="phrt_backends.tracers.numpy_bvh:NumpyTracer",
            options=NumpyOptions,
        ),
    ]
