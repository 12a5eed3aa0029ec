"""The folder of layers: which files, and that they show what is in the arrays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from scene_kit import LAMBERT, PLAIN_FALLBACKS, Stage, at, ball, floor

from phrt.errors import OptionError
from phrt.frame import MASK_FALLBACK, MASK_FILLED, MASK_NONE, MASK_TRACED, FrameResult
from phrt.model import Material
from phrt.output.layers import depth_preview, id_preview, layer_preview, normal_preview, write_layers, write_light_exr
from phrt.output.raster import raster_picture
from phrt.output.tonemap import to_8bit

HEIGHT, WIDTH = 8, 12


def lit_ball(lights: int = 3, **options: Any) -> FrameResult:
    """A ball on a floor under some lights and a dome, the camera at half exposure."""
    made = Stage(dome=(0.3, 0.4, 0.6))
    made.add("/floor", floor(), LAMBERT, at(0, -0.5, 0))
    made.add("/ball", ball(0.5, 2), Material(base_color=(0.8, 0.2, 0.1, 1), roughness=0.2, emissive=(0.1, 0.2, 0.3)))
    for number in range(lights):
        made.light("point", at(number - 1, 2, 1), intensity=4.0 + number)
    made.camera((0, 0.5, 3), (0, 0, 0), fov_y=0.8)
    made.scene.settings.exposure = 0.25
    return made.render((WIDTH, HEIGHT), **options)


@pytest.fixture
def frame() -> FrameResult:
    """A frame whose layers are noise."""
    random = np.random.default_rng(2)

    def noise(components: int) -> np.ndarray:
        return random.random((HEIGHT, WIDTH, components), dtype=np.float32)

    layers = {"visibility": noise(3), "reflection": noise(3), "refraction": noise(3)}
    layers |= {"ambient_occlusion": noise(1), "several": noise(6)}
    masks = {"shadows": random.integers(0, 4, (HEIGHT, WIDTH), dtype=np.uint8)}
    return replace(lit_ball(), image=noise(3), layers=layers, masks=masks, exposure=1.0)


def exr_channels(path: Path) -> dict[str, np.ndarray]:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: channel.pixels for name, channel in file.channels().items()}


def read(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image)


def test_the_four_images_of_figure_1_and_every_layer_are_written(tmp_path: Path, frame: FrameResult) -> None:
    files = {path.name for path in write_layers(tmp_path / "new" / "folder", frame)}
    assert files == {path.name for path in (tmp_path / "new" / "folder").iterdir()}
    figure = {
        "figure1_a_raster",
        "figure1_b_shadows",
        "figure1_c_reflections",
        "figure1_c_refractions",
        "figure1_d_composite",
    }
    assert {f"{name}.png" for name in figure} <= files
    assert {f"layer_{name}.png" for name in frame.layers} <= files
    assert {"layer_visibility_0.png", "layer_visibility_2.png", "traced_shadows.png", "layers.exr"} <= files
    assert {"gbuffer_depth.png", "gbuffer_normal_world.png", "gbuffer_base_color.png", "gbuffer_object_id.png"} <= files


def test_previews_show_the_arrays(tmp_path: Path, frame: FrameResult) -> None:
    write_layers(tmp_path, frame, tone_map="aces")
    assert np.array_equal(read(tmp_path / "figure1_d_composite.png"), to_8bit(frame.image, "aces"))
    assert np.array_equal(read(tmp_path / "figure1_c_reflections.png"), to_8bit(frame.layers["reflection"], "aces"))
    mean = np.repeat(frame.layers["visibility"].mean(axis=2, keepdims=True), 3, axis=2)
    assert np.array_equal(read(tmp_path / "figure1_b_shadows.png"), to_8bit(mean, "srgb")[:, :, 0])
    traced = read(tmp_path / "traced_shadows.png")
    for value, shade in ((MASK_NONE, 0), (MASK_FALLBACK, 85), (MASK_TRACED, 255), (MASK_FILLED, 170)):
        assert (traced[frame.masks["shadows"] == value] == shade).all()


def test_the_exr_holds_every_value(tmp_path: Path, frame: FrameResult) -> None:
    write_layers(tmp_path, frame)
    channels = exr_channels(tmp_path / "layers.exr")
    assert np.array_equal(channels["G"], frame.image[:, :, 1])
    assert np.array_equal(channels["visibility.light2"], frame.layers["visibility"][:, :, 2])
    assert np.array_equal(channels["several.5"], frame.layers["several"][:, :, 5])
    assert np.array_equal(channels["direct_1.B"], frame.direct[:, :, 1, 2])
    assert np.array_equal(channels["depth.Z"], frame.gbuffer.depth)
    assert np.array_equal(channels["normal_world.Y"], frame.gbuffer.normal_world[:, :, 1])
    assert np.array_equal(channels["object_id.id"], frame.gbuffer.object_id)
    assert np.array_equal(channels["traced_shadows.Y"], frame.masks["shadows"])


@pytest.mark.parametrize("lights", [1, 2, 3, 4])
def test_components_by_light_are_named_by_light_however_many_there_are(tmp_path: Path, lights: int) -> None:
    frame = lit_ball(lights)
    write_layers(tmp_path, frame)
    write_light_exr(tmp_path / "picture.exr", frame)
    for name in ("layers.exr", "picture.exr"):
        channels = exr_channels(tmp_path / name)
        found = {channel for channel in channels if channel.startswith("visibility.")}
        assert found == {f"visibility.light{number}" for number in range(lights)}
        for number in range(lights):
            assert np.array_equal(channels[f"visibility.light{number}"], frame.layers["visibility"][:, :, number])
        assert np.array_equal(channels["R"], frame.image[:, :, 0])


def test_a_scene_without_lights_has_no_such_component(tmp_path: Path) -> None:
    frame = lit_ball(0)
    write_layers(tmp_path, frame)
    write_light_exr(tmp_path / "picture.exr", frame)
    for name in ("layers.exr", "picture.exr"):
        assert not [channel for channel in exr_channels(tmp_path / name) if channel.startswith("visibility")]


def test_the_raster_picture_is_the_frame_that_traces_nothing() -> None:
    traced, plain = lit_ball(), lit_ball(heuristic="raster_only", effects=PLAIN_FALLBACKS)
    np.testing.assert_allclose(raster_picture(traced), plain.image, rtol=1e-6)
    assert np.abs(traced.image - plain.image).max() > 0.01, "the lights cast shadows"


def test_previews_of_light_are_exposed_as_the_picture_is(tmp_path: Path) -> None:
    frame = lit_ball(heuristic="raster_only", effects=PLAIN_FALLBACKS)
    assert frame.exposure == 0.25
    frame.layers["reflection"][:] = 0.8
    write_layers(tmp_path, frame, tone_map="srgb")
    raster, composite = (read(tmp_path / f"figure1_{name}.png").astype(int) for name in ("a_raster", "d_composite"))
    assert np.abs(raster - composite).max() <= 1
    expected = to_8bit(np.full((HEIGHT, WIDTH, 3), 0.2, np.float32), "srgb")
    assert np.array_equal(read(tmp_path / "layer_reflection.png"), expected)


def test_a_frame_without_effects_still_gives_its_composite(tmp_path: Path, frame: FrameResult) -> None:
    bare = replace(frame, layers={"visibility": np.zeros((HEIGHT, WIDTH, 0), np.float32)}, masks={})
    files = {path.name for path in write_layers(tmp_path, bare)}
    assert {"figure1_d_composite.png", "layers.exr"} <= files


def test_depth_preview_orders_near_before_far_and_background_black() -> None:
    shades = depth_preview(np.array([[1.0, 2.0, 10.0, np.inf]], np.float32))[0]
    assert shades[0] > shades[1] > shades[2] > shades[3] == 0


def test_normal_preview_maps_axes_to_colours() -> None:
    assert normal_preview(np.array([[[0, 1, 0], [-1, 0, 0], [0, 0, 0]]], np.float32)).tolist() == [
        [[128, 255, 128], [0, 128, 128], [0, 0, 0]]
    ]


def test_id_colours_are_distinct_for_hundreds_of_objects() -> None:
    ids = np.arange(300, dtype=np.uint32)[None, :]
    colors = id_preview(ids)[0].astype(int)
    assert colors[0].tolist() == [0, 0, 0]
    assert id_preview(np.array([[0xFFFFFFFF]], np.uint32)).max() == 0
    assert len({tuple(color) for color in colors}) > 280
    neighbours = np.abs(np.diff(colors[1:], axis=0)).sum(axis=1)
    assert neighbours.min() > 60


def test_scalar_and_wide_layers_are_grey() -> None:
    layer = np.full((2, 2, 5), 0.5, np.float32)
    assert (layer_preview("anything", layer, "neutral") == 188).all()
    assert layer_preview("anything", layer[:, :, 0], "neutral").shape == (2, 2)


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path, frame: FrameResult) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OptionError, match="cannot make the folder"):
        write_layers(tmp_path / "file" / "layers", frame)
