"""Shapes of wall elements: where the nearest point of a wall lies, seen from the centre of a sphere.

An element is a kind and up to twenty numbers. All are in the container's frame and stand still.
"""

from enum import IntEnum
from math import sqrt

from graindamp.dem.compile import compiled, inner


class WallKind(IntEnum):
    """Shape of a wall element, and its numbers."""

    PLANE = 0
    """Point (0-2), unit normal into the space of the particles (3-5)."""
    DISC = 1
    """A thin plate: centre (0-2), unit normal (3-5), radius (6)."""
    CYLINDER_INSIDE = 2
    """Point of the axis (0-2), unit axis (3-5), radius (6)."""
    SPHERE_INSIDE = 3
    """Centre (0-2), radius (6)."""
    BOX_SOLID = 4
    """Centre (0-2), half sizes (3-5), unit vectors of its first and second axis (6-8, 9-11)."""
    CYLINDER_SOLID = 5
    """Centre of one end (0-2), unit axis (3-5), radius (6), length (7)."""
    FACE = 6
    """Its plane (0-3) and those of its three borders (4-15), each a unit normal and an offset."""
    EDGE = 7
    """Planes into its two faces, at its start and at its end (0-15), a point of it (16-18)."""
    VERTEX = 8
    """Point (0-2), first and one past last of its planes in `Walls.edges` (3, 4)."""


FAR = 1e9
"""Distance of an element that does not see the sphere [m]."""

N_SHAPE = 20

FOAM_FIRST = 7
"""Numbers of a foam plane: coefficients of compression, its square and its cube [N/m, N/m^2, N/m^3] (7-9), loss
factor (10), speed over which the hysteresis turns [m/s] (11)."""


@compiled
def nearest(kind, shapes, e, edges, x, y, z, radius):
    """Distance of (x, y, z) from element e [m], negative behind it, and the unit normal towards the sphere.

    Elements of meshes answer FAR where another element of the mesh is nearer: faces beside their triangle, edges and
    vertices outside their own region (see :mod:`graindamp.dem.mesh_features`)."""
    shape = shapes[e]
    rx, ry, rz = x - shape[0], y - shape[1], z - shape[2]
    if kind == WallKind.PLANE:
        return rx * shape[3] + ry * shape[4] + rz * shape[5], shape[3], shape[4], shape[5]
    if kind == WallKind.CYLINDER_INSIDE:
        along = rx * shape[3] + ry * shape[4] + rz * shape[5]
        rx, ry, rz = rx - along * shape[3], ry - along * shape[4], rz - along * shape[5]
        square = rx * rx + ry * ry + rz * rz
        inner = shape[6] - radius
        if square < 0.25 * inner * inner:
            return FAR, 0.0, 0.0, 0.0
        off = sqrt(square)
        return shape[6] - off, -rx / off, -ry / off, -rz / off
    if kind == WallKind.DISC:
        height = rx * shape[3] + ry * shape[4] + rz * shape[5]
        rx, ry, rz = rx - height * shape[3], ry - height * shape[4], rz - height * shape[5]
        off = sqrt(rx * rx + ry * ry + rz * rz)
        if off <= shape[6]:
            way = 1.0 if height >= 0.0 else -1.0
            return way * height, way * shape[3], way * shape[4], way * shape[5]
        beyond = (off - shape[6]) / off
        return away(rx * beyond + height * shape[3], ry * beyond + height * shape[4], rz * beyond + height * shape[5])
    if kind == WallKind.SPHERE_INSIDE:
        off = sqrt(rx * rx + ry * ry + rz * rz)
        if off < 0.25 * shape[6]:
            return shape[6] - off, 0.0, 0.0, 1.0
        return shape[6] - off, -rx / off, -ry / off, -rz / off
    if kind == WallKind.BOX_SOLID:
        return nearest_on_box(shape, rx, ry, rz)
    if kind == WallKind.CYLINDER_SOLID:
        return nearest_on_cylinder(shape, rx, ry, rz)
    if kind == WallKind.FACE:
        height = side(shape, 0, x, y, z)
        if height <= 0.0 or side(shape, 4, x, y, z) < 0.0 or side(shape, 8, x, y, z) < 0.0:
            return FAR, 0.0, 0.0, 0.0
        if side(shape, 12, x, y, z) < 0.0:
            return FAR, 0.0, 0.0, 0.0
        return height, shape[0], shape[1], shape[2]
    if kind == WallKind.EDGE:
        if side(shape, 0, x, y, z) >= 0.0 or side(shape, 4, x, y, z) >= 0.0:
            return FAR, 0.0, 0.0, 0.0
        along = side(shape, 8, x, y, z)
        if along < 0.0 or side(shape, 12, x, y, z) > 0.0:
            return FAR, 0.0, 0.0, 0.0
        rx, ry, rz = x - shape[16], y - shape[17], z - shape[18]
        along = rx * shape[8] + ry * shape[9] + rz * shape[10]
        return away(rx - along * shape[8], ry - along * shape[9], rz - along * shape[10])
    for e in range(int(shape[3]), int(shape[4])):
        if x * edges[e, 0] + y * edges[e, 1] + z * edges[e, 2] - edges[e, 3] >= 0.0:
            return FAR, 0.0, 0.0, 0.0
    return away(rx, ry, rz)


@inner
def side(shape, first, x, y, z):
    """Distance of a point from the plane whose four numbers begin at `first` [m]."""
    return x * shape[first] + y * shape[first + 1] + z * shape[first + 2] - shape[first + 3]


@inner
def away(rx, ry, rz):
    """Length and direction of a vector; a zero vector points up."""
    length = sqrt(rx * rx + ry * ry + rz * rz)
    if length == 0.0:
        return 0.0, 0.0, 0.0, 1.0
    return length, rx / length, ry / length, rz / length


@inner
def nearest_on_box(shape, rx, ry, rz):
    """Distance and normal to a solid box from a point relative to its centre."""
    ux, uy, uz = shape[6], shape[7], shape[8]
    vx, vy, vz = shape[9], shape[10], shape[11]
    wx, wy, wz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    a = rx * ux + ry * uy + rz * uz
    b = rx * vx + ry * vy + rz * vz
    c = rx * wx + ry * wy + rz * wz
    da = a - min(max(a, -shape[3]), shape[3])
    db = b - min(max(b, -shape[4]), shape[4])
    dc = c - min(max(c, -shape[5]), shape[5])
    distance = sqrt(da * da + db * db + dc * dc)
    if distance > 0.0:
        da, db, dc = da / distance, db / distance, dc / distance
    else:  # the centre lies inside: out through the nearest face
        distance = abs(a) - shape[3]
        da, db, dc = 1.0 if a > 0.0 else -1.0, 0.0, 0.0
        if abs(b) - shape[4] > distance:
            distance = abs(b) - shape[4]
            da, db, dc = 0.0, 1.0 if b > 0.0 else -1.0, 0.0
        if abs(c) - shape[5] > distance:
            distance = abs(c) - shape[5]
            da, db, dc = 0.0, 0.0, 1.0 if c > 0.0 else -1.0
    return (
        distance,
        da * ux + db * vx + dc * wx,
        da * uy + db * vy + dc * wy,
        da * uz + db * vz + dc * wz,
    )


@inner
def nearest_on_cylinder(shape, rx, ry, rz):
    """Distance and normal to a solid cylinder from a point relative to the centre of its first end."""
    ax, ay, az = shape[3], shape[4], shape[5]
    along = rx * ax + ry * ay + rz * az
    rx, ry, rz = rx - along * ax, ry - along * ay, rz - along * az
    off = sqrt(rx * rx + ry * ry + rz * rz)
    if off > 0.0:
        rx, ry, rz = rx / off, ry / off, rz / off
    side = off - shape[6]
    end = max(-along, along - shape[7])
    sense = -1.0 if -along > along - shape[7] else 1.0
    if side <= 0.0 and end <= 0.0:
        if side > end and off > 0.0:
            return side, rx, ry, rz
        return end, sense * ax, sense * ay, sense * az
    if end <= 0.0:
        return side, rx, ry, rz
    if side <= 0.0:
        return end, sense * ax, sense * ay, sense * az
    distance = sqrt(side * side + end * end)
    p, q = side / distance, sense * end / distance
    return distance, p * rx + q * ax, p * ry + q * ay, p * rz + q * az
