"""Tracers of other packages in the table of bare rates."""

import io

import pytest
from rich.console import Console


@pytest.fixture
def small(module, monkeypatch):
    """The module, with 512 rays of a kind."""
    tracers = module("tracers")
    monkeypatch.setattr(tracers, "WIDTH", 32)
    monkeypatch.setattr(tracers, "HEIGHT", 16)
    monkeypatch.setattr(tracers, "usable_cores", lambda: 2)
    return tracers


def test_a_guest_is_measured_against_every_contender_where_all_cores_are_used(small):
    room = small.Geometry.from_meshes("room", [small.trimesh.creation.box(extents=(40.0, 40.0, 40.0))])
    alone, together = (small.measure(room, threads, 1, ["numpy"]) for threads in (1, 2))
    for row in alone:
        assert not row.guests
        assert "numpy" not in row.mega_rays
    for row in together:
        assert {"numpy / embree", "numpy / embreex run"} <= set(row.guests)
        assert min(row.guests.values()) > 0
        assert row.mega_rays["numpy"] > 0
    shown = io.StringIO()
    Console(file=shown, width=300).print(small.table([*alone, *together]))
    assert "numpy / embreex run" in shown.getvalue()
    assert f"{together[0].busy_rays['embree']:.1f})" in shown.getvalue()
