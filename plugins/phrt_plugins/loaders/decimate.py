"""One mesh with fewer triangles, through fast-simplification (quadric edge collapse, Garland and Heckbert 1997).

The library knows places and triangles only: no texture coordinates, no hard edges, no materials. So it only proposes. It is given
the mesh with its seams closed, and says which places it would merge. What is merged in the end, and into which of the places that
were there before, is decided here:

1. Places are merged only with places where the same charts (surfaces of one piece, seams cut) and the same materials meet. A seam
   keeps its line on both sides, and nothing is stretched over one. The rim of an open mesh stays, so that neighbours still fit.
2. Every corner keeps a vertex that the mesh had: normals, UVs and colours are read, never made up.
3. A merge is taken back where a triangle would turn over or vanish, where a texture would be stretched or a normal bent, and where
   a place would end up farther than TOLERANCE from the new surface.

So no mesh is torn, but not every mesh comes down to the share that was asked for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from phrt.model import Mesh
from phrt.splitting import extract, weld

Array = np.ndarray

TOLERANCE = 0.005
"""How far a place of the mesh may be from the simplified one, of the diagonal of its bounds."""

FEWEST = 32
"""Meshes of fewer triangles are left as they are: every one of them is seen."""

LARGEST_TURN = 0.5
"""Cosine of the angle by which a triangle, or the normal at a corner, may turn: 60 degrees."""

LARGEST_STRETCH = 3.0
"""By which factor a texture may be stretched more than at the vertex before."""

GOALS = (1.0, 1.6, 0.6)
"""What the library is asked for, of the share that is wanted: some of what it merges is taken back, more of bold proposals."""

AGGRESSIVENESS = 5.0
"""Of the library, 0 to 10; its own default is 7. Measured on the atrium: less is taken back, so more triangles go."""


def decimated(mesh: Mesh, share: float) -> Mesh:
    """`mesh` with about `share` (0 to 1) of its triangles, or as near to that as does no harm; itself when nothing can go."""
    if len(mesh.triangles) < FEWEST:
        return mesh
    topology = topology_of(mesh)
    wanted = share * len(mesh.triangles)
    best = mesh
    for goal in GOALS:
        place = unharmed(mesh, topology, proposed(topology, max(4, round(wanted * goal))))
        found = rebuilt(mesh, topology, place)
        if abs(len(found.triangles) - wanted) < abs(len(best.triangles) - wanted):
            best = found
        if len(found.triangles) <= wanted:
            break
    return best


@dataclass(frozen=True)
class Topology:
    """A mesh with its seams closed. P places, V vertices, T triangles.

    place_of (V,): every vertex's place. points (P, 3) float64. corners (T, 3): places. chart (V,): the piece of surface that a
    vertex belongs to. kind (P,): equal for places that may be merged. diagonal: of the bounds.
    """

    place_of: Array
    points: Array
    corners: Array
    chart: Array
    kind: Array
    diagonal: float


def topology_of(mesh: Mesh) -> Topology:
    """The `Topology` of `mesh`."""
    place_of = weld(mesh.positions)
    points = np.zeros((int(place_of.max()) + 1, 3))
    points[place_of] = mesh.positions
    corners = place_of[mesh.triangles]
    chart = charts(len(mesh.positions), mesh.triangles)
    used = mesh.positions[mesh.triangles.reshape(-1)]
    diagonal = float(np.linalg.norm(np.ptp(used, axis=0)))
    return Topology(place_of, points, corners, chart, kinds(mesh, corners, place_of, chart, len(points)), diagonal)


def charts(vertices: int, triangles: Array) -> Array:
    """(vertices,) int64: equal for vertices that triangles connect without crossing a seam."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    start = triangles.reshape(-1)
    end = np.roll(triangles, -1, axis=1).reshape(-1)
    edges = coo_matrix((np.ones(len(start), np.int8), (start, end)), shape=(vertices, vertices))
    return np.asarray(connected_components(edges, directed=False)[1], np.int64)


def kinds(mesh: Mesh, corners: Array, place_of: Array, chart: Array, places: int) -> Array:
    """(places,) int64: equal where the same charts and materials meet; a kind of its own on every open rim."""
    used = np.unique(mesh.triangles)
    by_chart = multiset(place_of[used], chart[used], places)
    pairs = np.unique(
        np.column_stack([corners.reshape(-1), np.repeat(mesh.triangle_material.astype(np.int64), 3)]), axis=0
    )
    by_material = multiset(pairs[:, 0], pairs[:, 1], places)
    kind = np.unique(np.column_stack([by_chart, by_material]), axis=0, return_inverse=True)[1].reshape(-1)
    rim = rims(corners)
    kind[rim] = kind.max(initial=0) + 1 + np.arange(len(rim))
    return kind


def multiset(owner: Array, value: Array, owners: int) -> Array:
    """(owners, 2) int64: equal rows for owners of the same values, each as often, and (almost surely) for no others."""
    # Random words by value: their sums tell sets apart, whatever the order.
    random = np.random.default_rng(12345)
    distinct, index = np.unique(value, return_inverse=True)
    words = random.integers(0, 1 << 40, size=(len(distinct), 2))[index.reshape(-1)]
    result = np.zeros((owners, 2), np.int64)
    np.add.at(result, owner, words)
    return result


def rims(corners: Array) -> Array:
    """(n,) places on edges that do not have exactly two triangles: open rims, and where three surfaces meet."""
    edges = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
    distinct, count = np.unique(edges, axis=0, return_counts=True)
    return np.unique(distinct[count != 2])


def proposed(topology: Topology, triangles: int) -> Array:
    """(P,) place that every place would be merged into by the library, if `triangles` were to remain; kinds kept apart."""
    import fast_simplification

    corners = topology.corners
    whole = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    solid = np.ascontiguousarray(corners[whole].astype(np.int32))
    if len(solid) <= triangles:
        return np.arange(len(topology.points))
    points = np.ascontiguousarray(topology.points)
    collapses = fast_simplification.simplify(
        points, solid, target_count=triangles, agg=AGGRESSIVENESS, return_collapses=True, preserve_border=True
    )[2]
    moved, _, cluster = fast_simplification.replay_simplification(points, solid, collapses)
    wanted = np.where((cluster >= 0)[:, None], moved[cluster] if len(moved) else points, points)
    return nearest_of_kind(topology, cluster, wanted)


def nearest_of_kind(topology: Topology, cluster: Array, wanted: Array) -> Array:
    """(P,) for every place the one of its cluster and kind that is nearest to where the library put the cluster."""
    group = np.unique(np.column_stack([cluster, topology.kind]), axis=0, return_inverse=True)[1].reshape(-1)
    far = np.linalg.norm(topology.points - wanted, axis=1)
    order = np.lexsort([far, group])
    first = np.concatenate([[True], group[order][1:] != group[order][:-1]])
    nearest = order[first][group]
    alone = cluster < 0
    nearest[alone] = np.flatnonzero(alone)
    return nearest


def unharmed(mesh: Mesh, topology: Topology, place: Array) -> Array:
    """`place` with merges taken back until none does harm. Each round takes back at least one, so it ends."""
    here = np.arange(len(place))
    # Where a vertex goes does not depend on other merges: one look is enough.
    place = np.where(stretched(mesh, topology, place), here, place)
    before = topology.points[topology.corners]
    shape = area_normal(before), thin(before)
    while True:
        bad = turned(topology, place, *shape) & (place != here)
        if not bad.any():
            bad = strayed(topology, place)
        if not bad.any():
            return place
        place[bad] = here[bad]


def turned(topology: Topology, place: Array, normal_before: Array, thin_before: Array) -> Array:
    """(P,) bool: corners of triangles that turn over, or become thin, and were not as thin before."""
    corners = topology.corners
    after = place[corners]
    changed = np.flatnonzero((after != corners).any(axis=1) & remaining(after) & ~thin_before)
    shape = topology.points[after[changed]]
    before_normal, after_normal = normal_before[changed], area_normal(shape)
    lengths = np.linalg.norm(before_normal, axis=1) * np.linalg.norm(after_normal, axis=1)
    cosine = np.einsum("ij,ij->i", before_normal, after_normal)
    return marked(corners[changed[(cosine < LARGEST_TURN * lengths) | thin(shape)]], len(place))


def thin(points: Array) -> Array:
    """(n,) bool: triangles (n, 3, 3) whose height is less than a thousandth of their length."""
    return np.linalg.norm(area_normal(points), axis=1) < 1e-3 * np.ptp(points, axis=1).max(axis=1) ** 2


def area_normal(points: Array) -> Array:
    """(n, 3) of triangles (n, 3, 3): square to them, twice their area long."""
    return np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])


def remaining(after: Array) -> Array:
    """(T,) bool: triangles whose three corners are still three."""
    return (after != np.roll(after, 1, axis=1)).all(axis=1)


def marked(places: Array, count: int) -> Array:
    """(count,) bool, true at `places`."""
    result = np.zeros(count, bool)
    result[places.reshape(-1)] = True
    return result


def strayed(topology: Topology, place: Array) -> Array:
    """(P,) bool: merged places that are farther than TOLERANCE from every triangle around the place they went to."""
    after = place[topology.corners]
    kept = after[remaining(after)]
    at = kept.reshape(-1)
    order = np.argsort(at, kind="stable")
    start = np.searchsorted(at[order], np.arange(len(place) + 1))
    merged = np.flatnonzero(place != np.arange(len(place)))
    goal = place[merged]
    count = start[goal + 1] - start[goal]
    row = np.repeat(np.arange(len(merged)), count)
    triangle = order[expanded(start[goal], count)] // 3
    distance = point_triangle_distance(topology.points[merged[row]], topology.points[kept[triangle]])
    nearest = np.full(len(merged), np.inf)
    np.minimum.at(nearest, row, distance)
    return marked(merged[nearest > TOLERANCE * topology.diagonal], len(place))


def expanded(start: Array, count: Array) -> Array:
    """start[0], start[0] + 1, ... count[0] of them, then those of the next: one list of indices."""
    offset = np.cumsum(count) - count
    return np.arange(int(count.sum())) - np.repeat(offset, count) + np.repeat(start, count)


def point_triangle_distance(point: Array, triangle: Array) -> Array:
    """(n,) distances of `point` (n, 3) from `triangle` (n, 3, 3): from its plane above it, else from the nearest edge."""
    a, b, c = triangle[:, 0], triangle[:, 1], triangle[:, 2]
    normal = area_normal(triangle)
    square = np.maximum(np.einsum("ij,ij->i", normal, normal), 1e-300)
    inside = np.ones(len(point), bool)
    nearest = np.full(len(point), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge, to_point = end - start, point - start
        inside &= np.einsum("ij,ij->i", np.cross(edge, to_point), normal) >= 0
        along = np.einsum("ij,ij->i", to_point, edge) / np.maximum(np.einsum("ij,ij->i", edge, edge), 1e-300)
        offset = to_point - np.clip(along, 0.0, 1.0)[:, None] * edge
        nearest = np.minimum(nearest, np.linalg.norm(offset, axis=1))
    above = np.abs(np.einsum("ij,ij->i", point - a, normal)) / np.sqrt(square)
    return np.where(inside, np.minimum(above, nearest), nearest)


def stretched(mesh: Mesh, topology: Topology, place: Array) -> Array:
    """(P,) bool: places where a vertex would take a UV farther away than its surroundings explain, or a normal bent too far."""
    vertices = np.unique(mesh.triangles)
    goal = goals(mesh, topology, place)
    vertices = vertices[goal[vertices] != vertices]
    target = goal[vertices]
    wrong = np.zeros(len(vertices), bool)
    if mesh.normals is not None:
        wrong |= np.einsum("ij,ij->i", mesh.normals[vertices], mesh.normals[target]) < LARGEST_TURN
    way = np.linalg.norm(mesh.positions[vertices] - mesh.positions[target], axis=1)
    for uv in (mesh.uv0, mesh.uv1):
        if uv is not None:
            moved = np.linalg.norm(uv[vertices] - uv[target], axis=1)
            wrong |= moved > LARGEST_STRETCH * uv_density(mesh, uv)[vertices] * way + 1e-5
    return marked(topology.place_of[vertices[wrong]], len(place))


def uv_density(mesh: Mesh, uv: Array) -> Array:
    """(V,) the largest change of `uv` per metre along the edges at every vertex."""
    start = mesh.triangles.reshape(-1)
    end = np.roll(mesh.triangles, -1, axis=1).reshape(-1)
    length = np.linalg.norm(mesh.positions[start] - mesh.positions[end], axis=1)
    rate = np.linalg.norm(uv[start] - uv[end], axis=1) / np.maximum(length, 1e-30)
    result = np.zeros(len(mesh.positions))
    np.maximum.at(result, start, rate)
    np.maximum.at(result, end, rate)
    return result


def goals(mesh: Mesh, topology: Topology, place: Array) -> Array:
    """(V,) the vertex that takes every vertex's corners: itself, or of those of its chart at the new place the most like it."""
    result = np.arange(len(mesh.positions))
    used = np.unique(mesh.triangles)
    moved = used[place[topology.place_of[used]] != topology.place_of[used]]
    # Vertices by place and chart, so that those to choose from are a run of this list.
    span = int(topology.chart.max()) + 1
    key = topology.place_of[used] * span + topology.chart[used]
    order = np.argsort(key, kind="stable")
    wanted = place[topology.place_of[moved]] * span + topology.chart[moved]
    start = np.searchsorted(key[order], wanted, "left")
    count = np.searchsorted(key[order], wanted, "right") - start
    row = np.repeat(np.arange(len(moved)), count)
    choice = used[order[expanded(start, count)]]
    far = unlikeness(mesh, moved[row], choice)
    best = np.lexsort([far, row])
    first = np.concatenate([[True], row[best][1:] != row[best][:-1]])[: len(best)]
    result[moved[row[best[first]]]] = choice[best[first]]
    return result


def unlikeness(mesh: Mesh, a: Array, b: Array) -> Array:
    """(n,) how much the attributes of vertices `a` and `b` differ; 0 where they are equal."""
    total = np.zeros(len(a))
    for values in (mesh.normals, mesh.uv0, mesh.uv1, mesh.colors):
        if values is not None:
            scale = max(float(np.ptp(values)), 1e-30)
            total += np.linalg.norm(values[a] - values[b], axis=1) / scale
    return total


def rebuilt(mesh: Mesh, topology: Topology, place: Array) -> Mesh:
    """`mesh` with its places merged as `place` says: triangles that have three corners left, and the vertices they use."""
    kept = np.flatnonzero(remaining(place[topology.corners]))
    if len(kept) == len(mesh.triangles):
        return mesh
    corners = goals(mesh, topology, place)[mesh.triangles]
    return extract(replace(mesh, triangles=corners), kept, mesh.name)
