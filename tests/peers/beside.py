"""What others take for the same work, on the same machine and in the same minutes, beside what this station's engines take.

    python3 -m pip install --target target/peers mujoco==4.0.0 pypbd==2.2.2 taichi==1.7.4 numpy
    PYTHONPATH=target/peers python3 tests/peers/beside.py [deformation|flow] [--rounds 3]

`deformation`: blocks of 3 mm cells of six tets, 30 kPa and a Poisson's ratio of 0.45, held at one face, of 3 456 and 10 368 tets, with a ball or the tip
of the instrument pressed 1 mm into the opposite face; milliseconds of one core for each simulated millisecond. Ours is the block of `tissue bench tissue`, of which the
deformation counts, with as few substeps as bring it within 5 % of the converged solution, in force and displacement; beside it is said what it takes with those of
the station, which are more. PyPBD takes as few as bring it within 5 % of what it does with 80: how far the block goes under a pull along its held face. `flow`: a box of 1 mm cells, semi-Lagrangian advection and 40 Jacobi sweeps written in Taichi's language as its examples do, beside the
solver of `fluid bench flow`; millions of cells a second on one core, and the divergence that is left: the largest of a cell, in parts of the largest speed
over the edge of a cell (of Taichi's flow the inflow's, whose cells are left out).

Each round runs ours, then each peer, every one in a process of its own on one core; what is said is the median of the rounds. A peer that is not installed is
named as absent. Exit code 1 if a target (`TARGETS`, `LESS_DIVERGENCE`) is missed.
"""

import argparse
import json
import multiprocessing
import os
import statistics
import subprocess
import sys
import tempfile
import time

EDGE_M = 3e-3
YOUNGS_PA, POISSON, DENSITY = 30e3, 0.45, 1050.0
BLOCKS = {3456: (12, 12, 4), 10368: (12, 12, 12)}
GRIDS = [(32, 32, 18), (64, 64, 28)]
BALL_M, DEEP_M = 4e-3, 1e-3
# How many times as long a peer is to take at the least. Of the flow: how many times as many cells a second ours is to have.
TARGETS = {"PyPBD": 10.0, "MuJoCo": 40.0, "Taichi": 5.0}
# How many times as much divergence a peer is to leave at the least.
LESS_DIVERGENCE = 1000.0


def block(cells):
    """Nodes and tets of a block, the face z = 0 held."""
    nx, ny, nz = (count + 1 for count in cells)
    nodes = [(x * EDGE_M, y * EDGE_M, z * EDGE_M) for z in range(nz) for y in range(ny) for x in range(nx)]
    number = lambda at: (at[2] * ny + at[1]) * nx + at[0]
    tets = []
    for z in range(cells[2]):
        for y in range(cells[1]):
            for x in range(cells[0]):
                for order, is_odd in [((0, 1, 2), 0), ((1, 2, 0), 0), ((2, 0, 1), 0), ((1, 0, 2), 1), ((0, 2, 1), 1), ((2, 1, 0), 1)]:
                    at, tet = [x, y, z], [number((x, y, z))]
                    for axis in order:
                        at[axis] += 1
                        tet.append(number(at))
                    if is_odd:
                        tet[2], tet[3] = tet[3], tet[2]
                    tets.append(tet)
    return nodes, tets


def clocked(step, steps):
    """Milliseconds of this process's processor time for each call, the median of ten stretches."""
    stretches = []
    for _ in range(10):
        begun = time.process_time()
        for _ in range(max(1, steps // 10)):
            step()
        stretches.append((time.process_time() - begun) * 1e3 / max(1, steps // 10))
    return statistics.median(stretches)


def in_a_process_of_its_own(work, *arguments):
    """What a function gives there: PyPBD has one simulation in each process."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(work, arguments)


def mujoco_block(tets):
    """MuJoCo's flex, implicit, steps of 1 ms."""
    import mujoco

    cells = BLOCKS[tets]
    nodes, elements = block(cells)
    held = " ".join(str(node) for node, at in enumerate(nodes) if at[2] == 0.0)
    size = [count * EDGE_M for count in cells]
    mass = DENSITY * size[0] * size[1] * size[2]
    ball = (size[0] / 2, size[1] / 2, size[2] + BALL_M - DEEP_M)
    model = mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <option timestep="0.001" gravity="0 0 0" integrator="discrete" solver="CG" tolerance="1e-6"/>
  <size memory="500M"/>
  <worldbody>
    <body name="ball" pos="{ball[0]} {ball[1]} {ball[2]}"><geom type="sphere" size="{BALL_M}"/></body>
    <flexcomp name="block" type="direct" dim="3" mass="{mass}" radius="0.0002"
        point="{' '.join(f'{x} {y} {z}' for x, y, z in nodes)}" element="{' '.join(str(node) for tet in elements for node in tet)}">
      <elasticity young="{YOUNGS_PA}" poisson="{POISSON}" damping="0.002"/>
      <contact selfcollide="none"/>
      <edge equality="false"/>
      <pin id="{held}"/>
    </flexcomp>
  </worldbody>
</mujoco>""")
    data = mujoco.MjData(model)
    for _ in range(20):
        mujoco.mj_step(model, data)
    milliseconds = clocked(lambda: mujoco.mj_step(model, data), 50)
    return {"ms": milliseconds, "is_finite": bool((abs(data.flexvert_xpos) < 1.0).all()), "contacts": int(data.ncon)}


# Substeps of a step of 1 ms that are tried of PyPBD, in turn, what counts as its converged solution, and how near to that is near enough.
SUBSTEPS, CONVERGED, NEAR = (1, 2, 3, 4, 5, 6, 8, 10, 15, 20), 80, 0.05
# The pull under which its blocks give way while that is asked, m/s², the steps until they rest, and those over which is averaged.
PULL_M_S2, SETTLING, AVERAGED = 30.0, 150, 150


def pypbd_model(tets, is_pressed):
    """PyPBD's block in millimetres, for it leaves out each tet of which the edges' determinant is less than 1e-6, and so all of ours in metres. The nodes
    that are pressed are held where the ball presses them. Its gravity, which no setting changes, is a thousandth of ours there."""
    import numpy
    import pypbd

    cells = BLOCKS[tets]
    nodes, elements = block(cells)
    pypbd.Logger.addConsoleSink(pypbd.LogLevel.ERR) if hasattr(pypbd, "Logger") else None
    simulation = pypbd.Simulation.getCurrent()
    simulation.initDefault()
    model = simulation.getModel()
    model.addTetModel([numpy.array(node) * 1e3 for node in nodes], [node for tet in elements for node in tet], testMesh=False)
    particles = model.getParticles()
    mass = DENSITY * cells[0] * cells[1] * cells[2] * EDGE_M**3 / len(nodes)
    for node, (x, y, z) in enumerate(nodes):
        particles.setMass(node, 0.0 if z == 0.0 or is_pressed(x, y, z) else mass)
        if is_pressed(x, y, z):
            particles.setPosition(node, numpy.array([x, y, z - DEEP_M]) * 1e3)
    model.addSolidConstraints(model.getTetModels()[0], 3, YOUNGS_PA * 1e-3, POISSON, 1.0, False, False)
    if len(model.getConstraints()) != tets:
        sys.exit(f"{len(model.getConstraints())} constraints for {tets} tets")
    pypbd.TimeManager.getCurrent().setTimeStepSize(1e-3)
    return nodes, simulation, model


def pypbd_gives_way(tets, substeps):
    """How far the face opposite to the held one goes under the pull in the mean, mm, with so many substeps."""
    import numpy
    import pypbd

    nodes, simulation, model = pypbd_model(tets, lambda x, y, z: False)
    stepper, particles = simulation.getTimeStep(), model.getParticles()
    pull, free = numpy.array([PULL_M_S2, 0.0, 0.0]), [node for node, at in enumerate(nodes) if at[2] > 0.0]  # m/s² times 1 ms, in mm/s
    stepper.setValueUInt(pypbd.TimeStepController.NUM_SUB_STEPS, substeps)
    stepper.setValueUInt(pypbd.TimeStepController.MAX_ITERATIONS, 1)
    top = [node for node, at in enumerate(nodes) if at[2] == nodes[-1][2]]
    ways = []
    for step in range(SETTLING + AVERAGED):
        for node in free:
            particles.setVelocity(node, particles.getVelocity(node) + pull)
        stepper.step(model)
        if step >= SETTLING:
            ways.append(statistics.mean(particles.getPosition(node)[0] - nodes[node][0] * 1e3 for node in top))
    return statistics.mean(ways)


def pypbd_block(tets):
    """PyPBD: XPBD with one iteration in each substep, and so few substeps as bring it within 5 % of what it does with 80."""
    import pypbd

    way = lambda count: in_a_process_of_its_own(pypbd_gives_way, tets, count)
    converged = way(CONVERGED)
    ways = ((count, way(count) / converged - 1.0) for count in SUBSTEPS)
    near = next(((count, off) for count, off in ways if abs(off) <= NEAR), None)
    if near is None:
        sys.exit(f"none of {SUBSTEPS} substeps comes near {CONVERGED}")
    substeps, off = near
    cells = BLOCKS[tets]
    top, middle = cells[2] * EDGE_M, cells[0] * EDGE_M / 2
    is_pressed = lambda x, y, z: z == top and (x - middle) ** 2 + (y - middle) ** 2 < (0.7 * BALL_M) ** 2
    nodes, simulation, model = pypbd_model(tets, is_pressed)
    stepper, particles = simulation.getTimeStep(), model.getParticles()
    stepper.setValueUInt(pypbd.TimeStepController.NUM_SUB_STEPS, substeps)
    stepper.setValueUInt(pypbd.TimeStepController.MAX_ITERATIONS, 1)
    for _ in range(20):
        stepper.step(model)
    milliseconds = clocked(lambda: stepper.step(model), 200)
    places = [particles.getPosition(node) for node in range(len(nodes))]
    is_finite = all(abs(value) < 1e3 for place in places for value in place)
    return {"ms": milliseconds, "substeps": substeps, "off_percent": round(100 * off, 2), "is_finite": is_finite}


def taichi_flow(grid):
    """Stam's solver on cell centres in Taichi: advection by tracing back, 40 Jacobi sweeps from the last pressure."""
    import taichi as ti

    ti.init(arch=ti.cpu, cpu_max_num_threads=1, log_level=ti.ERROR, offline_cache=False)
    nx, ny, nz = grid
    dt, edge, sweeps = 1.0 / 30.0, 1e-3, 40
    u, v = (ti.Vector.field(3, ti.f32, grid) for _ in range(2))
    p, q, div = (ti.field(ti.f32, grid) for _ in range(3))

    @ti.func
    def at(field: ti.template(), i, j, k):
        return field[ti.min(ti.max(i, 0), nx - 1), ti.min(ti.max(j, 0), ny - 1), ti.min(ti.max(k, 0), nz - 1)]

    @ti.func
    def between(field: ti.template(), place):
        place = ti.min(ti.max(place, 0.0), ti.Vector([nx - 1.001, ny - 1.001, nz - 1.001]))
        low = ti.cast(place, ti.i32)
        f = place - low
        value = ti.Vector([0.0, 0.0, 0.0])
        for a, b, c in ti.static(ti.ndrange(2, 2, 2)):
            w = (f.x if a else 1 - f.x) * (f.y if b else 1 - f.y) * (f.z if c else 1 - f.z)
            value += w * field[low.x + a, low.y + b, low.z + c]
        return value

    @ti.kernel
    def advect():
        for i, j, k in u:
            v[i, j, k] = between(u, ti.Vector([i, j, k]) - dt / edge * u[i, j, k])

    @ti.kernel
    def diverge():
        for i, j, k in div:
            div[i, j, k] = 0.5 * (at(v, i + 1, j, k).x - at(v, i - 1, j, k).x + at(v, i, j + 1, k).y - at(v, i, j - 1, k).y
                                  + at(v, i, j, k + 1).z - at(v, i, j, k - 1).z)

    @ti.kernel
    def sweep(a: ti.template(), b: ti.template()):
        for i, j, k in a:
            b[i, j, k] = (at(a, i + 1, j, k) + at(a, i - 1, j, k) + at(a, i, j + 1, k) + at(a, i, j - 1, k)
                          + at(a, i, j, k + 1) + at(a, i, j, k - 1) - div[i, j, k]) / 6.0

    @ti.kernel
    def project():
        for i, j, k in u:
            slope = ti.Vector([at(p, i + 1, j, k) - at(p, i - 1, j, k), at(p, i, j + 1, k) - at(p, i, j - 1, k), at(p, i, j, k + 1) - at(p, i, j, k - 1)])
            u[i, j, k] = v[i, j, k] - 0.5 * slope
            if i < 2 and ti.abs(j - ny // 2) < 3 and ti.abs(k - nz // 2) < 3:
                u[i, j, k] = ti.Vector([0.1, 0.0, 0.0])

    @ti.kernel
    def worst() -> ti.f32:
        most = 0.0
        for i, j, k in div:
            if i > 2:
                d = 0.5 * (at(u, i + 1, j, k).x - at(u, i - 1, j, k).x + at(u, i, j + 1, k).y - at(u, i, j - 1, k).y
                           + at(u, i, j, k + 1).z - at(u, i, j, k - 1).z)
                ti.atomic_max(most, ti.abs(d))
        return most

    def step():
        advect()
        diverge()
        for _ in range(sweeps // 2):
            sweep(p, q)
            sweep(q, p)
        project()

    for _ in range(10):
        step()
    milliseconds = clocked(step, 60)
    return {"ms": milliseconds, "mcells_per_s": nx * ny * nz / milliseconds / 1e3, "divergence": worst() / 0.1}


PEERS = {
    "deformation": {"MuJoCo": mujoco_block, "PyPBD": pypbd_block},
    "flow": {"Taichi": taichi_flow},
}


def ours(what, programs):
    """Of each case what the engine's own benchmark says on one core: milliseconds or millions of cells a second, and of the flow the divergence."""
    program = {"deformation": ["tissue", "bench", "tissue"], "flow": ["fluid", "bench", "flow"]}[what]
    run = subprocess.run([os.path.join(programs, program[0]), *program[1:], "--json"], capture_output=True, text=True, timeout=600)
    rows = json.loads(run.stdout)
    rows = rows if isinstance(rows, list) else rows["rows"]
    if what == "deformation":
        ms = lambda row: row["step_us"]["p50"] * row["share"]["deformation"] * 1e-3
        of = lambda method: {row["tets"]: row for row in rows if row.get("method") == method and row["tets"] in BLOCKS}
        of_station, equal = of("a block"), of("a block, at equal accuracy")
        off_percent = lambda row: round(100 * max(row["force_apart"], row.get("told_apart", 0.0), row["displacement_apart"]), 2)
        return {
            tets: {"ms": ms(row), "substeps": row["substeps"], "off_percent": off_percent(row),
                   "station's substeps": of_station[tets]["substeps"], "station's ms": round(ms(of_station[tets]), 3)}
            for tets, row in equal.items()
        }
    boxes = {row["grid"]: row for row in rows if row.get("is_box")}
    of = {grid: boxes["x".join(map(str, grid))] for grid in GRIDS if "x".join(map(str, grid)) in boxes}
    return {grid: {"mcells_per_s": row["cells_per_s"] * 1e-6, "divergence": row["divergence_left"]} for grid, row in of.items()}


def peer(what, name, case):
    """One peer in a process of its own; None if it is not installed."""
    paths = [os.path.abspath(path) for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    run = subprocess.run(
        [sys.executable, os.path.abspath(__file__), what, "--peer", name, "--case", json.dumps(case)],
        capture_output=True, text=True, timeout=600, env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(paths)},
        cwd=tempfile.gettempdir(),  # where MuJoCo writes its warnings
    )
    if run.returncode == 4:
        return None
    if run.returncode != 0:
        sys.exit(f"{name}: {run.stderr.strip().splitlines()[-1:]}")
    return json.loads(run.stdout.strip().splitlines()[-1])


def alone(what, name, case):
    """What the process of one peer does: its figures as a line of JSON."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    try:
        print(json.dumps(PEERS[what][name](tuple(case) if isinstance(case, list) else case)))
    except ImportError:
        sys.exit(4)


def compare(what, rounds, programs):
    """All rounds; True if every target holds."""
    mine, theirs = {}, {}
    for _ in range(rounds):
        for case, value in ours(what, programs).items():
            mine.setdefault(case, []).append(value)
        for name in PEERS[what]:
            for case in mine:
                found = peer(what, name, case)
                if found is not None:
                    theirs.setdefault((name, case), []).append(found)
    holds = True
    key = "ms" if what == "deformation" else "mcells_per_s"
    unit = "ms for each simulated ms" if what == "deformation" else "million cells a second"
    for case in mine:
        own = statistics.median(one[key] for one in mine[case])
        label = f"{case} tets" if what == "deformation" else "x".join(map(str, case))
        own_rest = {name: value for name, value in mine[case][-1].items() if name != key}
        print(f"{label}: ours {own:.3g} {unit} {own_rest or ''}")
        for name in PEERS[what]:
            found = theirs.get((name, case))
            if not found:
                print(f"  {name}: not installed")
                continue
            value = statistics.median(one[key] for one in found)
            ratio = value / own if what == "deformation" else own / value
            is_held = ratio >= TARGETS[name]
            holds &= is_held
            rest = {name: value for name, value in found[-1].items() if name != key}
            print(f"  {name}: {value:.3g}, ratio {ratio:.1f} ({TARGETS[name]:.0f} wanted{'' if is_held else ', MISSED'}) {rest or ''}")
            if what == "flow":
                less = statistics.median(one["divergence"] for one in found) / statistics.median(one["divergence"] for one in mine[case])
                is_held = less >= LESS_DIVERGENCE
                holds &= is_held
                print(f"  {name}: {less:.0f} times as much divergence ({LESS_DIVERGENCE:.0f} wanted{'' if is_held else ', MISSED'})")
    return holds


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("what", nargs="?", choices=[*PEERS], help="one of the two; both without it")
    arguments.add_argument("--rounds", type=int, default=3)
    arguments.add_argument("--programs", default=os.path.join(os.environ.get("CARGO_TARGET_DIR", "target"), "release"))
    arguments.add_argument("--peer", help=argparse.SUPPRESS)
    arguments.add_argument("--case", type=json.loads, help=argparse.SUPPRESS)
    given = arguments.parse_args()
    if given.peer:
        return alone(given.what, given.peer, given.case)
    held = [compare(what, given.rounds, given.programs) for what in ([given.what] if given.what else PEERS)]
    sys.exit(0 if all(held) else 1)


if __name__ == "__main__":
    main()
