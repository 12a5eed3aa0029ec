"""What becomes of photons where they hit: mirrored, bent, absorbed, or landed on a diffuse surface."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phrt.kernels.bounce import MIRROR_RAY_ROUGHNESS, faces_front, glossy_normal, refracted
from phrt.kernels.jit import device, kernel
from phrt.kernels.random import hash_u32, unit_float
from phrt.kernels.shade import reflectance
from phrt.kernels.shadow import bias_at

f32 = np.float32
HALF_METAL = f32(0.5)
"""From this share of metal on a smooth surface counts as a mirror."""
LEAST_DIFFUSE = f32(0.01)
"""With less than this share of its body left, a surface is no place to land on."""
PASSED, MIRRORED, BENT = 1, 2, 3


class Photons(NamedTuple):
    """n photons on their way.

    origin, direction, flux (n, 3) float32: metres, unit, lumens by colour; unit (n,) float32: the largest of the flux at the start;
    path (n,) float32: metres travelled; medium (n,) int32: material row they are in, 0 for air; trail (n,) uint32: hash of what
    they met, 0 for those that met no glass or mirror yet; number (n,) int32; caster (n,) int32: the object they met first, 0 for
    none.
    """

    origin: np.ndarray
    direction: np.ndarray
    flux: np.ndarray
    unit: np.ndarray
    path: np.ndarray
    medium: np.ndarray
    trail: np.ndarray
    number: np.ndarray
    caster: np.ndarray


class Landed(NamedTuple):
    """n photons that ended on a diffuse surface.

    position, normal, flux (n, 3) float32: the normal is the triangle's, on the side that is lit; trail, number, caster as in
    `Photons`.
    """

    position: np.ndarray
    normal: np.ndarray
    flux: np.ndarray
    trail: np.ndarray
    number: np.ndarray
    caster: np.ndarray


def empty_photons(count: int) -> Photons:
    """Uninitialised room for `count`."""
    f, i = np.float32, np.int32
    return Photons(
        np.empty((count, 3), f), np.empty((count, 3), f), np.empty((count, 3), f), np.empty(count, f), np.empty(count, f),
        np.empty(count, i), np.empty(count, np.uint32), np.empty(count, i), np.empty(count, i),
    )  # fmt: skip


def empty_landed(count: int) -> Landed:
    """Uninitialised room for `count`."""
    return Landed(
        np.empty((count, 3), np.float32), np.empty((count, 3), np.float32), np.empty((count, 3), np.float32),
        np.empty(count, np.uint32), np.empty(count, np.int32), np.empty(count, np.int32),
    )  # fmt: skip


@device
def luck(number, trail, salt):
    """0 <= x < 1, of a photon and what it met."""
    return unit_float(hash_u32(number, trail, salt))


@device
def go_on(out, k, x, y, z, dx, dy, dz, r, g, b, unit, path, medium, trail, number, caster):
    """One more photon on its way, in row k."""
    out.origin[k, 0], out.origin[k, 1], out.origin[k, 2] = x, y, z
    out.direction[k, 0], out.direction[k, 1], out.direction[k, 2] = dx, dy, dz
    out.flux[k, 0], out.flux[k, 1], out.flux[k, 2] = r, g, b
    out.unit[k], out.path[k], out.medium[k] = unit, path, medium
    out.trail[k], out.number[k], out.caster[k] = trail, number, caster


@device
def survival(r, g, b, unit, threshold, number, trail):
    """What to multiply a photon's flux with: 1; or, for one weaker than `threshold` of what it began with, 0 or so much that it is
    as strong as that, with the chance that keeps the mean (Arvo and Kirk 1990)."""
    share = max(r, max(g, b)) / unit
    if share >= threshold:
        return f32(1.0)
    if share > threshold * luck(number, trail, 3):
        return threshold / share
    return f32(0.0)


@kernel
def bounce(
    count, photons, distance, surfaces, geometry, materials, casts, cutoff, inverse_range, threshold, last, out, landed
):
    """What becomes of the first `count` photons, which hit rows 0..count of `surfaces` at distance (count,).

    casts (N + 1,) bool: objects that cast no shadow are not there for photons: direct light goes through them already, and would
    be counted twice. cutoff: rougher glass and metal ends a photon's way. inverse_range: 1 / metres, of the light, 0 for none
    (KHR_lights_punctual's window, over the whole path). last: nothing goes on. Only what met glass or a mirror before lands.
    out, landed: room for 2 count and count. Returns how many go on, and how many landed.
    """
    # Out of the loop: a tuple's array costs a reference count every time it is taken out.
    at_object_id, at_material_id, at_primitive_id = surfaces.object_id, surfaces.material_id, surfaces.primitive_id
    at_position, at_normal, at_geometric_normal = surfaces.position, surfaces.normal, surfaces.geometric_normal
    at_base_color, at_metallic, at_roughness = surfaces.base_color, surfaces.metallic, surfaces.roughness
    at_transmission, at_alpha = surfaces.transmission, surfaces.alpha
    p_direction, p_flux, p_unit, p_path = photons.direction, photons.flux, photons.unit, photons.path
    p_medium, p_trail, p_number, p_caster = photons.medium, photons.trail, photons.number, photons.caster
    going, ended = 0, 0
    for i in range(count):
        object_id = at_object_id[i]
        if object_id == 0:
            continue
        r, g, b = p_flux[i, 0], p_flux[i, 1], p_flux[i, 2]
        dx, dy, dz = p_direction[i, 0], p_direction[i, 1], p_direction[i, 2]
        medium, trail, number, unit = p_medium[i], p_trail[i], p_number[i], p_unit[i]
        path = p_path[i] + distance[i]
        if medium > 0:
            # Beer-Lambert on the way through the medium.
            inside = materials[medium]
            r *= math.exp(-inside.absorb_r * distance[i])
            g *= math.exp(-inside.absorb_g * distance[i])
            b *= math.exp(-inside.absorb_b * distance[i])
        px, py, pz = at_position[i, 0], at_position[i, 1], at_position[i, 2]
        gx, gy, gz = at_geometric_normal[i, 0], at_geometric_normal[i, 1], at_geometric_normal[i, 2]
        bias = bias_at(px, py, pz)
        if not casts[object_id] or (at_alpha[i] < f32(1.0) and luck(number, trail, 0) >= at_alpha[i]):
            if not last:
                through = hash_u32(trail, object_id, PASSED) if trail != 0 else trail
                go_on(out, going, px - gx * bias, py - gy * bias, pz - gz * bias, dx, dy, dz, r, g, b, unit, path, medium, through,
                      number, p_caster[i])  # fmt: skip
                going += 1
            continue
        row = at_material_id[i]
        material = materials[row]
        if material.unlit:
            continue
        metallic, roughness, passes = at_metallic[i], at_roughness[i], at_transmission[i]
        if trail != 0 and (f32(1.0) - metallic) * (f32(1.0) - passes) > LEAST_DIFFUSE:
            ratio = path * path * inverse_range * inverse_range
            window = max(f32(1.0) - ratio * ratio, f32(0.0))
            landed.position[ended, 0], landed.position[ended, 1], landed.position[ended, 2] = px, py, pz
            landed.normal[ended, 0], landed.normal[ended, 1], landed.normal[ended, 2] = gx, gy, gz
            landed.flux[ended, 0], landed.flux[ended, 1], landed.flux[ended, 2] = r * window, g * window, b * window
            landed.trail[ended], landed.number[ended], landed.caster[ended] = trail, number, p_caster[i]
            ended += 1
        if last or roughness > cutoff or not (passes > f32(0.0) or metallic >= HALF_METAL):
            continue

        # A mirror or glass: what is thrown back, and what goes in or comes out.
        nx, ny, nz = at_normal[i, 0], at_normal[i, 1], at_normal[i, 2]
        if dx * nx + dy * ny + dz * nz >= f32(0.0):
            nx, ny, nz = gx, gy, gz  # an interpolated normal may look away at the rim
        if roughness >= MIRROR_RAY_ROUGHNESS:
            nx, ny, nz = glossy_normal(
                nx, ny, nz, -dx, -dy, -dz, roughness, luck(number, trail, 1), luck(number, trail, 2)
            )
        d_n = dx * nx + dy * ny + dz * nz
        n_v = min(max(abs(d_n), f32(1e-3)), f32(1.0))
        thick = passes > f32(0.0) and material.thin == 0
        entering = True
        eta = material.ior
        if thick:
            entering = faces_front(geometry, at_primitive_id[i], dx, dy, dz)
            if not entering:
                eta = f32(1.0) / material.ior
        red, green, blue = at_base_color[i, 0], at_base_color[i, 1], at_base_color[i, 2]
        fr, fg, fb, plain = reflectance(material, metallic, roughness, passes, red, green, blue, n_v, eta)
        caster = p_caster[i] if p_caster[i] > 0 else np.int32(object_id)
        mirrored = hash_u32(trail, object_id, MIRRORED)
        kept = survival(r * fr, g * fg, b * fb, unit, threshold, number, mirrored)
        if kept > f32(0.0):
            x, y, z = dx - f32(2.0) * d_n * nx, dy - f32(2.0) * d_n * ny, dz - f32(2.0) * d_n * nz
            below = x * gx + y * gy + z * gz
            if below < f32(0.0):
                # Interpolated normals can send a photon under the triangle: turn it up again.
                x, y, z = x - f32(2.0) * below * gx, y - f32(2.0) * below * gy, z - f32(2.0) * below * gz
            scale = f32(1.0) / math.sqrt(x * x + y * y + z * z)
            go_on(out, going, px + gx * bias, py + gy * bias, pz + gz * bias, x * scale, y * scale, z * scale, r * fr * kept,
                  g * fg * kept, b * fb * kept, unit, path, medium, mirrored, number, caster)  # fmt: skip
            going += 1
        body = (f32(1.0) - plain) * passes * (f32(1.0) - metallic)
        r, g, b = r * body * red, g * body * green, b * body * blue
        bent = hash_u32(trail, object_id, BENT)
        kept = survival(r, g, b, unit, threshold, number, bent)
        if kept > f32(0.0):
            x, y, z, total = dx, dy, dz, False
            if thick:
                x, y, z, total = refracted(dx, dy, dz, nx, ny, nz, f32(1.0) / eta)
                medium = row if entering else 0
            if not total:
                go_on(out, going, px - gx * bias, py - gy * bias, pz - gz * bias, x, y, z, r * kept, g * kept, b * kept, unit, path,
                      np.int32(medium), bent, number, caster)  # fmt: skip
                going += 1
    return going, ended


@kernel
def spans(order, landed, unit_span, smallest, largest, smoothing, span):
    """span (n,) float32, in metres: the radius of every photon's splat.

    order (n,) int64: the photons by trail and number. Photons of one trail and near numbers started next to each other and met
    the same things: where they landed says how wide one of them has become (a photon's differential, Schjoth et al. 2007, here by
    differences). The distance that a third of those next to it in `order` are within, times smoothing, no less than smallest and no
    more than largest (n,) metres.
    """
    position, normal, trail, number = landed.position, landed.normal, landed.trail, landed.number
    near = np.empty(2 * unit_span, np.float32)
    for j in range(len(order)):
        i = order[j]
        found = 0
        for other in range(max(j - unit_span, 0), min(j + unit_span + 1, len(order))):
            k = order[other]
            if k == i or trail[k] != trail[i] or abs(number[k] - number[i]) > 8 * unit_span:
                continue
            facing = normal[i, 0] * normal[k, 0] + normal[i, 1] * normal[k, 1] + normal[i, 2] * normal[k, 2]
            if facing < f32(0.5):
                continue
            x, y, z = (
                position[k, 0] - position[i, 0],
                position[k, 1] - position[i, 1],
                position[k, 2] - position[i, 2],
            )
            # Insertion, so that they stay sorted.
            here = math.sqrt(x * x + y * y + z * z)
            place = found
            while place > 0 and near[place - 1] > here:
                near[place] = near[place - 1]
                place -= 1
            near[place] = here
            found += 1
        wide = near[found // 3] * smoothing if found > 2 else largest[i]
        span[i] = min(max(wide, smallest[i]), largest[i])
