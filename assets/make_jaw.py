#!/usr/bin/env python3
"""Makes `assets/meshes/jaw.obj`: one of the two jaws of a grasping forceps, as a closed surface. The other one is its mirror image.

Promise: the same bytes each time, with nothing but Python. The dimensions are chosen after 5 to 7 Fr forceps that go through a hysteroscope's channel.

Frame: millimetres; the hinge is the y axis, the jaw lies along +z, the face that closes on the other jaw in the plane x = 0, the jaw itself on the side of +x.

    python3 assets/make_jaw.py
"""
import math
import pathlib

LENGTH = 9.0           # from the hinge to the tip
HALF_WIDTH = 1.6       # of the closing face, along y
THICKNESS = 1.1        # from the closing face to the back, along x
TIP = 1.8              # over this length the tip is rounded off
TEETH, DEPTH = 7, 0.25 # across the front two thirds of the closing face
RINGS, BACK, FACE = 37, 10, 6


def share_at(z):
    """Size of the section at z beside the largest one."""
    left = LENGTH - z
    return math.sqrt(max(0.0, 1.0 - ((TIP - left) / TIP) ** 2)) if left < TIP else 1.0


def tooth_at(z):
    """How far the closing face lies behind the plane at z."""
    along = (z / LENGTH - 1.0 / 3.0) / (2.0 / 3.0) * TEETH
    return 0.0 if along <= 0.0 else DEPTH * (1.0 - abs(2.0 * (along % 1.0) - 1.0))


def ring(z):
    """The section at z, counter-clockwise seen from the tip: over the back from -y to +y, and along the face."""
    share = share_at(z)
    width, thick = HALF_WIDTH * share, THICKNESS * share
    base = min(tooth_at(z), 0.5 * thick)
    back = [-math.pi / 2 + math.pi * step / BACK for step in range(BACK + 1)]
    points = [(base + (thick - base) * math.cos(angle), width * math.sin(angle), z) for angle in back]
    return points + [(base, width * (1.0 - 2.0 * step / FACE), z) for step in range(1, FACE)]


def main():
    heights = [LENGTH * step / (RINGS - 1) for step in range(RINGS - 1)] + [LENGTH - 0.02]
    rings = [ring(z) for z in heights]
    around = len(rings[0])
    vertices = [point for section in rings for point in section] + [(0.3, 0.0, 0.0), (0.0, 0.0, LENGTH)]
    hinge, tip = len(vertices) - 2, len(vertices) - 1
    triangles = []
    for row in range(RINGS - 1):
        for column in range(around):
            a, b = row * around + column, row * around + (column + 1) % around
            triangles += [(a, b, b + around), (a, b + around, a + around)]
    last = (RINGS - 1) * around
    for column in range(around):
        after = (column + 1) % around
        triangles += [(hinge, after, column), (tip, last + column, last + after)]
    path = pathlib.Path(__file__).parent / "meshes" / "jaw.obj"
    with open(path, "w", encoding="ascii") as out:
        out.write("# jaw, by assets/make_jaw.py; millimetres\no jaw\n")
        out.writelines(f"v {x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in vertices)
        out.writelines(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in triangles)
    print(f"{path}: {len(vertices)} vertices, {len(triangles)} triangles")


if __name__ == "__main__":
    main()
