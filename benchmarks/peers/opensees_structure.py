"""Rest state and lowest modes of a suspended frame in OpenSees; needs openseespy and nothing of this package.

    python benchmarks/peers/opensees_structure.py IN.npz OUT.json [lumped | consistent [SYSTEM]]

IN: the arrays of `frame_of_boom` in `benchmarks/boom.py`, and ``modes``, their number. OUT: wall and CPU
seconds of building, rest state and modes, peak memory, frequencies, version.

Corotational beams (force-based where there is shear, for `elasticBeamColumn` has none and the Timoshenko
element knows no large rotations), springs as corotational trusses with an initial strain, bodies beside
their nodes on stiff corotational links (`rigidLink` leaves their m g h out). ARPACK solves with whatever
SYSTEM the statics use: Mumps was the fastest by far; of the others that ran, SparseSYM gave wrong modes.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib.metadata
import importlib.util
import json
import os
import resource
import sys
import time
from pathlib import Path

import numpy as np

# The wheel brings the reference BLAS, but not the path to it. OPENSEES_BLAS names libraries that are to stand
# before it, such as those of a distribution's OpenBLAS.
_FOLDER = Path(next(iter(importlib.util.find_spec("openseespylinux").submodule_search_locations)))
_FASTER = [name for name in os.environ.get("OPENSEES_BLAS", "").split(":") if name]
_OWN = [
    str(_FOLDER / "lib" / name)
    for name in ("libquadmath.so.0", "libgfortran.so.4", "libblas.so.3", "liblapack.so.3")
]
for _name in _FASTER + _OWN:
    ctypes.CDLL(_name, mode=ctypes.RTLD_GLOBAL)

import openseespy.opensees as ops  # noqa: E402

STIFF = 1e4  # of the links to bodies beside their node, times the section's


def main(source: str, target: str, mass: str = "consistent", system: str = "Mumps") -> None:
    with np.load(source, allow_pickle=False) as archive:
        frame = {k: archive[k] for k in archive.files}
    clock, cpu = [time.perf_counter()], [time.process_time()]

    def lap() -> None:
        clock.append(time.perf_counter())
        cpu.append(time.process_time())

    build(frame, mass == "consistent")
    lap()
    iterations = settle(system)
    lap()
    lam = np.array(ops.eigen("-genBandArpack", int(frame["modes"])))
    lap()
    stages = ("build", "equilibrium", "modes")
    result = {
        "version": importlib.metadata.version("openseespy"),
        "seconds": dict(zip(stages, np.diff(clock).tolist(), strict=True)),
        "cpu_seconds": dict(zip(stages, np.diff(cpu).tolist(), strict=True)),
        "iterations": iterations,
        "blas": "OpenBLAS" if any("openblas" in name for name in _FASTER) else "reference",
        "peak_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "dof": 6 * len(frame["x"]),
        "frequency_hz": (np.sign(lam) * np.sqrt(np.abs(lam)) / (2.0 * np.pi)).tolist(),
    }
    Path(target).write_text(json.dumps(result))


def build(frame: dict[str, np.ndarray], consistent: bool) -> None:
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 6)
    for tag, up in ((0, (0.0, 0.0, 1.0)), (1, (0.0, 1.0, 0.0))):
        ops.geomTransf("Corotational", tag, *up)
    _sections(frame)
    masses = _nodes(frame, consistent)
    density = ("-mass", float(frame["rho_A"]), "-cMass") if consistent else ()
    for i, (a, b) in enumerate(frame["ends"].tolist()):
        along_z = bool(np.all(frame["x"][a, :2] == frame["x"][b, :2]))
        _beam(frame, i, (a, b), int(along_z), density)
    masses.update(_bodies(frame))
    _springs(frame)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    for node, m in masses.items():
        ops.load(node, *(m * frame["gravity"]).tolist(), 0.0, 0.0, 0.0)


def _sections(frame: dict[str, np.ndarray]) -> None:
    """E = G = 1, so that EA, GJ, EI and kGA stand for themselves."""
    share = float(frame["GA"] / frame["EA"])
    for tag, stiff in ((1, 1.0), (2, STIFF)):
        EA, EI, GJ = (stiff * float(frame[k]) for k in ("EA", "EI", "GJ"))
        shear = (share, share) if np.isfinite(share) else ()
        ops.section("Elastic", tag, 1.0, EA, EI, EI, 1.0, GJ, *shear)
        ops.beamIntegration("Legendre", tag, tag, 2)


def _nodes(frame: dict[str, np.ndarray], consistent: bool) -> dict[int, float]:
    """Nodes with the bodies at them and halves of elements; returns the mass that is drawn down at each.

    A consistent mass matrix has no rotary inertia in bending, and force-based beams lump what they are given
    whatever is asked: these parts are at the nodes in either case.
    """
    x, ends = frame["x"], frame["ends"]
    span = x[ends[:, 1]] - x[ends[:, 0]]
    length = np.linalg.norm(span, axis=1)
    e2 = (span / length[:, None]) ** 2
    transverse, own = (1.0 - e2), 2.0 * e2
    torsion_too = consistent and not np.isfinite(frame["GA"])
    spin = float(frame["rho_I"]) * length[:, None] * (transverse if torsion_too else transverse + own)
    weight, inertia = np.zeros(len(x)), np.zeros((len(x), 3))
    for end in ends.T:
        np.add.at(weight, end, 0.5 * float(frame["rho_A"]) * length)
        np.add.at(inertia, end, 0.5 * spin)
    mass = np.zeros(len(x)) if consistent else weight.copy()
    central = ~np.any(frame["body_cg"], axis=1)
    for total in (mass, weight):
        np.add.at(total, frame["body_node"][central], frame["body_mass"][central])
    np.add.at(inertia, frame["body_node"][central], frame["body_inertia"][central])
    for i, (position, m, J) in enumerate(zip(x.tolist(), mass.tolist(), inertia.tolist(), strict=True)):
        ops.node(i, *position)
        ops.mass(i, m, m, m, *J)
    return dict(enumerate(weight.tolist()))


def _beam(frame: dict[str, np.ndarray], tag: int, ends: tuple, transformation: int, density: tuple) -> None:
    if np.isfinite(frame["GA"]):
        ops.element("forceBeamColumn", tag, *ends, transformation, 1, *density)
        return
    # A = 1, and J = 2 I, from which it takes the polar inertia of a consistent mass.
    EA, EI, GJ = (float(frame[k]) for k in ("EA", "EI", "GJ"))
    second = EI / EA
    section = (1.0, EA, GJ / (2.0 * second), 2.0 * second, second, second)
    ops.element("elasticBeamColumn", tag, *ends, *section, transformation, *density)


def _bodies(frame: dict[str, np.ndarray]) -> dict[int, float]:
    """Bodies beside their node, on a node of their own: here below it, so that z is across the link."""
    masses = {}
    for i in np.flatnonzero(np.any(frame["body_cg"], axis=1)).tolist():
        node, tag = int(frame["body_node"][i]), len(frame["x"]) + i
        m = float(frame["body_mass"][i])
        ops.node(tag, *(frame["x"][node] + frame["body_cg"][i]).tolist())
        ops.mass(tag, m, m, m, *frame["body_inertia"][i].tolist())
        ops.element("forceBeamColumn", len(frame["ends"]) + i, node, tag, 0, 2)
        masses[tag] = m
    return masses


def _springs(frame: dict[str, np.ndarray]) -> None:
    first_node = len(frame["x"]) + len(frame["body_node"])
    first_element = len(frame["ends"]) + len(frame["body_node"])
    for i, node in enumerate(frame["spring_node"].tolist()):
        anchor, free = frame["spring_anchor"][i], float(frame["spring_free_length"][i])
        drawn = float(np.linalg.norm(anchor - frame["x"][node]))
        ops.node(first_node + i, *anchor.tolist())
        ops.fix(first_node + i, 1, 1, 1, 1, 1, 1)
        ops.uniaxialMaterial("Elastic", 2 * i + 1, float(frame["spring_stiffness"][i]) * drawn)
        ops.uniaxialMaterial("InitStrainMaterial", 2 * i + 2, 2 * i + 1, (drawn - free) / drawn)
        ops.element("corotTruss", first_element + i, node, first_node + i, 1.0, 2 * i + 2)


def settle(system: str) -> int:
    """Newton's method in one load step; the number of iterations."""
    ops.constraints("Plain")
    ops.numberer("RCM")
    ops.system(system)
    ops.test("NormDispIncr", 1e-9, 30)
    ops.algorithm("Newton")
    ops.integrator("LoadControl", 1.0)
    ops.analysis("Static")
    if ops.analyze(1) != 0:
        raise RuntimeError("no rest state")
    return int(ops.testIter())


if __name__ == "__main__":
    with contextlib.redirect_stdout(sys.stderr):
        main(*sys.argv[1:])
