#!/usr/bin/env python3
"""Makes the meshes of `assets/meshes` from published dimensions: a uterus with a distended cavity, a polyp, a myoma
and a septum in it.

Promise: the same versions of gmsh and numpy write the same bytes. Every count is a parameter (see `--help`), so that
finer organs for a benchmark cost one command. Where each dimension comes from stands in SOURCES.md.

Frame: millimetres, origin at the pivot in the cervix, +z along the canal towards the fundus, +y anterior, +x to the patient's right.

    python3 -m venv /tmp/meshing && /tmp/meshing/bin/pip install gmsh==4.15.2 numpy==2.4.*
    /tmp/meshing/bin/python assets/make_meshes.py                   # writes assets/meshes and prints what it made
    /tmp/meshing/bin/python assets/make_meshes.py uterus:20000      # a finer one: uterus-20000.msh
"""
import argparse
import pathlib
import sys

import gmsh
import numpy as np

# --- the uterus: outside (serosa) -------------------------------------------------------------------------------------------
EXTERNAL_OS_Z = -16.0   # lowest point of the cervix
WIDEST_Z = 39.0         # height at which the body is widest
FUNDUS_Z = 65.0         # highest point of the serosa: length 81 mm
#            z      half width (x)  half depth (y)
OUTSIDE = [(-13.0, 13.0, 12.5), (-4.0, 13.6, 13.0), (6.0, 13.2, 12.6), (20.0, 18.6, 16.2), (31.0, 22.8, 18.8), (39.0, 24.0, 19.5)]
# --- the uterus: inside (canal dilated to 7 mm, cavity held open by the medium) -----------------------------------------------
CANAL_RADIUS = 3.5      # at the pivot
CANAL_FLARE = 0.20      # growth of the radius per mm below the pivot: room for the shaft to tilt
SIDE_SLOPE = 0.27       # growth of the cavity's half width per mm above the pivot: the triangle seen from the front
DEPTH_SLOPE = 0.045     # growth of the cavity's half depth per mm above the pivot
CAP_Z, CAP_HEIGHT, CAP_POWER = 44.0, 8.0, 2.4   # where the cavity begins to close, and how: it ends at z = 52
# --- the polyp ----------------------------------------------------------------------------------------------------------------
POLYP_ROOT = (8.6, 0.3, 53.2)            # inside the fundal wall, on the patient's right
POLYP_AXIS = (-0.10, -0.03, -1.0)        # hangs towards the internal os
POLYP_STALK_RADIUS, POLYP_LENGTH = 1.9, 13.6
POLYP_HEAD_CENTRE, POLYP_HEAD_HALF_LENGTH = 8.9, 4.7
POLYP_HEAD_RADII = (3.9, 3.4)            # flattened as the cavity is
# --- the myoma: submucous, more than half of it in the cavity ----------------------------------------------------------------
MYOMA_CENTRE = (-6.0, 4.2, 38.0)         # in the anterior wall, on the patient's left
MYOMA_RADIUS = 6.0
# --- the septum: a wedge in the midline that hangs from the fundus and joins the anterior to the posterior wall -----------------
SEPTUM_TIP_Z, SEPTUM_ROOT_Z = 34.0, 55.5  # 18 mm into a cavity that ends at z = 52, and 3.5 mm in the wall of the fundus
SEPTUM_EDGE_HALF_WIDTH, SEPTUM_SPREAD = 1.0, 0.05  # of its free edge, and growth per mm towards the fundus
SEPTUM_IN_WALL = 1.3                     # so far it goes into the anterior and the posterior wall
SEPTUM_ROUND = 2.0                       # over this length its free edge, and its root, are rounded off
SEPTUM_SQUARENESS = 5.0                  # of its section across: 2 would be an ellipse

RIM_Z = -9.0            # below it the rim of the external os is meshed finely, so that its edge stays round
RING = 72               # points on each ring of the fine surface that gmsh meshes anew


def outside_at(z):
    """Half width and half depth of the serosa at height z, below the widest section: cubic, without overshoot."""
    table = np.array(OUTSIDE)
    slope = np.gradient(table[:, 1:], table[:, 0], axis=0)
    slope[-1] = 0.0
    i = int(np.clip(np.searchsorted(table[:, 0], z) - 1, 0, len(table) - 2))
    h = table[i + 1, 0] - table[i, 0]
    t = (z - table[i, 0]) / h
    basis = (2 * t**3 - 3 * t**2 + 1, (t**3 - 2 * t**2 + t) * h, 3 * t**2 - 2 * t**3, (t**3 - t**2) * h)
    return basis[0] * table[i, 1:] + basis[1] * slope[i] + basis[2] * table[i + 1, 1:] + basis[3] * slope[i + 1]


def inside_at(z):
    """Half width, half depth and roundness (2 = ellipse) of canal and cavity at height z, below the cap."""
    mean, turn = (SIDE_SLOPE - CANAL_FLARE) / 2, (SIDE_SLOPE + CANAL_FLARE) / 2
    half_width = CANAL_RADIUS + mean * z + turn * (np.hypot(z, 3.0) - 3.0)
    mean, turn = (DEPTH_SLOPE - CANAL_FLARE) / 2, (DEPTH_SLOPE + CANAL_FLARE) / 2
    half_depth = CANAL_RADIUS + mean * z + turn * (np.hypot(z, 3.0) - 3.0)
    return half_width, half_depth, 2.0 + 0.6 * np.clip((z - 5.0) / 20.0, 0.0, 1.0)


def uterus_rings(grow):
    """Rings (z, half width, half depth, roundness) from the pole of the fundus down the serosa, around the external os, up to the
    pole of the cavity. `grow` moves the serosa outwards, so that flat tets enclose the round surface that is bound to them."""
    rings = []
    for t in np.linspace(0.0, 0.5 * np.pi, 26)[:-1]:
        a, b = OUTSIDE[-1][1:]
        rings.append((WIDEST_Z + (FUNDUS_Z + grow - WIDEST_Z) * np.cos(t), (a + grow) * np.sin(t), (b + grow) * np.sin(t), 2.0))
    for z in np.linspace(WIDEST_Z, OUTSIDE[0][0], 40):
        a, b = outside_at(z)
        rings.append((z, a + grow, b + grow, 2.0))
    low = OUTSIDE[0][0]
    inner, outer = np.array(inside_at(low)[:2]), np.array(OUTSIDE[0][1:]) + grow
    for t in np.linspace(0.0, np.pi, 14)[1:-1]:
        a, b = (inner + outer) / 2 + (outer - inner) / 2 * np.cos(t)
        rings.append((low - (low - EXTERNAL_OS_Z) * np.sin(t), a, b, 2.0))
    rings += [(z, *inside_at(z)) for z in np.linspace(low, CAP_Z, 60)]
    a, b, p = inside_at(CAP_Z)
    for t in np.linspace(0.0, 0.5 * np.pi, 20)[1:]:
        close, rise = np.cos(t) ** (2 / CAP_POWER), np.sin(t) ** (2 / CAP_POWER)
        rings.append((CAP_Z + CAP_HEIGHT * rise, a * close, b * close, p))
    return rings


def polyp_rings(grow):
    """Rings along the polyp's axis, from the root in the wall to the tip of the head."""
    lengths = POLYP_LENGTH * 0.5 * (1 - np.cos(np.linspace(0.0, np.pi, 60)))
    rings = []
    for s in lengths:
        stalk = POLYP_STALK_RADIUS * np.sqrt(max(0.0, 1 - ((1.2 - s) / 1.2) ** 2)) if s < 1.2 else POLYP_STALK_RADIUS
        head = np.sqrt(max(0.0, 1 - ((s - POLYP_HEAD_CENTRE) / POLYP_HEAD_HALF_LENGTH) ** 2))
        stalk = stalk if s < POLYP_HEAD_CENTRE else 0.0
        a, b = (max((stalk**4 + (r * head) ** 4) ** 0.25, 0.0) for r in POLYP_HEAD_RADII)
        rings.append((s, a * grow, b * grow, 2.0))
    rings[0], rings[-1] = (-0.3 * (grow - 1), 0.0, 0.0, 2.0), (POLYP_LENGTH + 4 * (grow - 1), 0.0, 0.0, 2.0)
    return rings


def myoma_rings(grow):
    """Rings of a ball about the origin, from pole to pole."""
    radius = MYOMA_RADIUS * grow
    return [(-radius * np.cos(t), radius * np.sin(t), radius * np.sin(t), 2.0) for t in np.linspace(0.0, np.pi, 40)]


def septum_rings(grow):
    """Rings of the septum from its free edge to its root in the fundus."""
    middle, half = (SEPTUM_TIP_Z + SEPTUM_ROOT_Z) / 2, (SEPTUM_ROOT_Z - SEPTUM_TIP_Z) / 2 + grow
    rings = []
    for t in np.linspace(0.0, np.pi, 60):
        z = middle - half * np.cos(t)
        end = np.clip((half - abs(z - middle)) / (SEPTUM_ROUND + grow), 0.0, 1.0)
        close = np.sqrt(max(0.0, 1 - (1 - end) ** 2))
        within = np.clip(z, SEPTUM_TIP_Z, CAP_Z)
        a = SEPTUM_EDGE_HALF_WIDTH + SEPTUM_SPREAD * (z - SEPTUM_TIP_Z) + grow
        rings.append((z, a * close, (inside_at(within)[1] + SEPTUM_IN_WALL + grow) * close, SEPTUM_SQUARENESS))
    rings[0], rings[-1] = (rings[0][0], 0.0, 0.0, 2.0), (rings[-1][0], 0.0, 0.0, 2.0)
    return rings


def skin(rings):
    """Closed triangle surface through the rings; the first and the last are poles. Returns points [n, 3] and triangles [m, 3]."""
    angle = np.arange(RING) * 2 * np.pi / RING
    cos, sin = np.cos(angle), np.sin(angle)
    points, triangles = [np.array([[0.0, 0.0, rings[0][0]]])], []
    for z, a, b, p in rings[1:-1]:
        x, y = a * np.sign(cos) * np.abs(cos) ** (2 / p), b * np.sign(sin) * np.abs(sin) ** (2 / p)
        points.append(np.stack([x, y, np.full(RING, z)], axis=1))
    points.append(np.array([[0.0, 0.0, rings[-1][0]]]))
    count = len(rings) - 2
    node = lambda ring, i: 1 + ring * RING + i % RING
    for i in range(RING):
        triangles.append((0, node(0, i), node(0, i + 1)))
        for ring in range(count - 1):
            a, b, c, d = node(ring, i), node(ring, i + 1), node(ring + 1, i), node(ring + 1, i + 1)
            triangles += [(a, c, d), (a, d, b)]
        triangles.append((1 + count * RING, node(count - 1, i + 1), node(count - 1, i)))
    points, triangles = np.concatenate(points), np.array(triangles)
    corners = points[triangles]
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    return points, triangles if volume > 0 else triangles[:, ::-1]


def place_polyp(points):
    """From the polyp's own frame (axis +z, root at the origin) into the uterus."""
    axis = np.array(POLYP_AXIS) / np.linalg.norm(POLYP_AXIS)
    side = np.cross([0.0, 1.0, 0.0], axis)
    side /= np.linalg.norm(side)
    return np.array(POLYP_ROOT) + points @ np.stack([side, np.cross(axis, side), axis])


def uterus_size(fine, coarse):
    """Edge length wanted at a point: fine at the cavity's wall and the rim, coarse at the serosa."""
    def size(_dim, _tag, x, y, z, _lc):
        a, b, p = inside_at(min(z, CAP_Z))
        up = max(0.0, (z - CAP_Z) / CAP_HEIGHT)
        out = ((abs(x) / a) ** p + (abs(y) / b) ** p) ** (1 / p)
        out = (out**CAP_POWER + up**CAP_POWER) ** (1 / CAP_POWER)
        wall = max(0.0, out - 1.0) * (CAP_HEIGHT if up > out * 0.7 else b)
        wanted = fine + (coarse - fine) * min(1.0, wall / 13.0)
        return wanted if z > RIM_Z else min(wanted, 1.2 * fine)
    return size


def mesh(points, triangles, size, solid):
    """Meshes the closed surface anew with the wanted size; with `solid`, its volume too. Returns points and cells (0-based)."""
    gmsh.clear()
    for name, value in (("General.Terminal", 0), ("General.NumThreads", 1), ("Mesh.RandomSeed", 1), ("Mesh.Algorithm", 6),
                        ("Mesh.Algorithm3D", 1), ("Mesh.MeshSizeExtendFromBoundary", 0), ("Mesh.MeshSizeFromPoints", 0),
                        ("Mesh.MeshSizeFromCurvature", 0), ("Mesh.Optimize", 1), ("Mesh.OptimizeNetgen", 1)):
        gmsh.option.setNumber(name, value)
    gmsh.model.add("organ")
    surface = gmsh.model.addDiscreteEntity(2)
    gmsh.model.mesh.addNodes(2, surface, np.arange(1, len(points) + 1), points.ravel())
    gmsh.model.mesh.addElementsByType(surface, 2, [], (triangles + 1).ravel())
    gmsh.model.mesh.classifySurfaces(np.pi, True, True, np.pi)
    gmsh.model.mesh.createGeometry()
    loop = gmsh.model.geo.addSurfaceLoop([tag for _, tag in gmsh.model.getEntities(2)])
    gmsh.model.geo.addVolume([loop])
    gmsh.model.geo.synchronize()
    gmsh.model.mesh.setSizeCallback(size)
    gmsh.model.mesh.generate(3 if solid else 2)
    if solid:
        gmsh.model.mesh.optimize("Relocate3D", niter=5)
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    kind, corners = (4, 4) if solid else (2, 3)
    _, cells = gmsh.model.mesh.getElementsByType(kind)
    index = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    index[tags] = np.arange(len(tags))
    return renumber(coordinates.reshape(-1, 3), index[cells.reshape(-1, corners)])


def renumber(points, cells):
    """Drops unused nodes, rounds to 0.1 µm, turns every tet to positive volume and every closed surface outwards."""
    used, cells = np.unique(cells, return_inverse=True)
    points, cells = np.round(points[used], 4), cells.reshape(-1, cells.shape[1] if cells.ndim > 1 else 1)
    if cells.shape[1] == 4:
        flip = volumes(points, cells) < 0
        cells[flip] = cells[flip][:, [0, 2, 1, 3]]
    else:
        corners = points[cells]
        if np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) < 0:
            cells = cells[:, ::-1]
    return points, cells


def volumes(points, tets):
    a, b, c, d = (points[tets[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6


def qualities(points, tets):
    """Mean-ratio quality of each tet: 1 for a regular one, 0 for a flat one."""
    edges = sum(((points[tets[:, i]] - points[tets[:, j]]) ** 2).sum(1) for i in range(4) for j in range(i))
    return 12 * np.cbrt(3 * np.abs(volumes(points, tets))) ** 2 / edges


def closest(make, count, start, tolerance):
    """Searches the size factor whose mesh has the wanted count: bisection, then the best of a fixed ladder around the end."""
    low, high, best = start * 0.4, start * 2.5, None
    trial = []
    for _ in range(9):
        middle = np.sqrt(low * high)
        found = make(middle)
        trial.append((abs(len(found[1]) - count), middle, found))
        low, high = (middle, high) if len(found[1]) > count else (low, middle)
    centre = min(trial, key=lambda t: t[:2])[1]
    for step in range(1, 13):
        if min(t[0] for t in trial) <= tolerance:
            break
        for factor in (centre * (1 + 0.0015 * step), centre * (1 - 0.0015 * step)):
            found = make(factor)
            trial.append((abs(len(found[1]) - count), factor, found))
    best = min(trial, key=lambda t: t[:2])
    return best[2], best[1]


def write_msh(path, points, tets, name):
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", "1", f'3 1 "{name}"', "$EndPhysicalNames", "$Nodes",
             str(len(points))]
    lines += [f"{i} {x:.4f} {y:.4f} {z:.4f}" for i, (x, y, z) in enumerate(points, 1)]
    lines += ["$EndNodes", "$Elements", str(len(tets))]
    lines += [f"{i} 4 2 1 1 {a} {b} {c} {d}" for i, (a, b, c, d) in enumerate(tets + 1, 1)] + ["$EndElements", ""]
    path.write_text("\n".join(lines))


def write_obj(path, points, triangles, name):
    lines = [f"# {name}, millimetres, made by make_meshes.py", f"o {name}"]
    lines += [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in points] + [f"f {a} {b} {c}" for a, b, c in triangles + 1] + [""]
    path.write_text("\n".join(lines))


# Each gives the closed surface to mesh, for tets or for the eye, the size function of a factor, and the factor at which the search starts.
def uterus(solid, count):
    start = 3.4 * (3198 / count) ** (1 / 3) if solid else 2.4 * (1646 / count) ** 0.5
    return skin(uterus_rings(0.35 if solid else 0.0)), lambda f: uterus_size(f, 2.9 * f), start


def polyp(solid, count):
    points, triangles = skin(polyp_rings(1.1 if solid else 1.0))
    start = 3.0 * (206 / count) ** (1 / 3) if solid else 0.7 * (1336 / count) ** 0.5
    return (place_polyp(points), triangles), lambda f: lambda *_: f, start


def myoma(solid, count):
    points, triangles = skin(myoma_rings(1.06 if solid else 1.0))
    start = 3.0 * (391 / count) ** (1 / 3) if solid else 0.95 * (1100 / count) ** 0.5
    return (points + np.array(MYOMA_CENTRE), triangles), lambda f: lambda *_: f, start


def septum(solid, count):
    start = 2.0 * (800 / count) ** (1 / 3) if solid else 1.1 * (1400 / count) ** 0.5
    return skin(septum_rings(0.12 if solid else 0.0)), lambda f: lambda *_: f, start


# File, shape, tets, triangles (None: the surface of the same shape serves).
SETS = {
    "uterus": (uterus, 3198, 1646),
    "polyp": (polyp, 206, 1336),
    "myoma": (myoma, 391, 1100),
    "septum": (septum, 800, 1400),
    "uterus-medium": (uterus, 5392, None),
    "uterus-fine": (uterus, 9780, None),
}


def wanted(text):
    """A set by its name, or SHAPE:TETS[:TRIANGLES] for other counts."""
    if text in SETS:
        return text, *SETS[text]
    shape, *counts = text.split(":")
    numbers = [int(count) for count in counts if count.isdecimal()]
    if shape not in ("uterus", "polyp", "myoma", "septum") or len(numbers) != len(counts) or len(numbers) not in (1, 2) or 0 in numbers:
        raise argparse.ArgumentTypeError(f"{text} is neither one of {', '.join(SETS)} nor SHAPE:TETS[:TRIANGLES]")
    return f"{shape}-{numbers[0]}", SETS[shape][0], numbers[0], numbers[1] if len(numbers) == 2 else None


def made(build, solid, count):
    """The mesh whose count is within 1 of the wanted one, of a large one within a hundredth, or as near as the search comes."""
    shape, size, start = build(solid, count)
    return closest(lambda f: mesh(*shape, size(f), solid), count, start, count // 100 if count > 4000 else 1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="*", type=wanted, metavar="SET", help="a name, or SHAPE:TETS[:TRIANGLES]; default: " + ", ".join(SETS))
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path(__file__).parent / "meshes")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    gmsh.initialize()
    for name, build, tet_count, triangle_count in arguments.sets or map(wanted, SETS):
        (points, tets), size = made(build, True, tet_count)
        write_msh(arguments.out / f"{name}.msh", points, tets, name)
        quality = qualities(points, tets)
        print(f"{name}: {len(points)} nodes, {len(tets)} tets, volume {volumes(points, tets).sum() / 1000:.2f} ml, quality min "
              f"{quality.min():.3f} mean {quality.mean():.3f}, size {size:.3f} mm", flush=True)
        if triangle_count:
            (vertices, triangles), size = made(build, False, triangle_count)
            write_obj(arguments.out / f"{name}-surface.obj", vertices, triangles, name)
            print(f"{name}: surface of {len(vertices)} vertices, {len(triangles)} triangles, size {size:.3f} mm", flush=True)
    gmsh.finalize()
    return 0


if __name__ == "__main__":
    sys.exit(main())
