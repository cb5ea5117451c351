"""Rest state and lowest modes of a suspended frame in Exudyn; needs exudyn, scipy, nothing of this package.

    python benchmarks/peers/exudyn_structure.py IN.npz OUT.json

IN: the arrays of `frame_of_boom` in `benchmarks/boom.py`, and ``modes``, their number. OUT: wall and CPU
seconds of building, rest state and modes, peak memory, frequencies, version.

A frame along x: geometrically exact beams. Their section must lie in the axes of both nodes, so that a
lattice cannot share nodes between them: there every element is a six-component spring at its middle between
rigid bodies that carry half of the mass of each element, which is such a beam with lumped mass. (The
spring's intrinsic law has no torque stiffness on these nodes in version 1.13.6.) In both, shear carries the
residual bending flexibility h^2/(12 EI) (MacNeal 1978), which makes the stiffness of a sample that of a
cubic element.

Exudyn exports its matrices dense, which takes 88 GB each at 1e5 degrees of freedom: from ``DENSE_LIMIT``
on, the rest state alone is solved (five minutes of CPU were not enough for the boom of 1e5). Its own
`ComputeODE2Eigenvalues` does what is done here, less the stiffness of loads.
"""

from __future__ import annotations

import importlib.metadata
import json
import resource
import sys
import time
from pathlib import Path

import exudyn as exu
import numpy as np
from exudyn import itemInterface as item  # noqa: N813
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import eigsh

DENSE_LIMIT = 20_000  # 3.2 GB a matrix


def main(source: str, target: str) -> None:
    exu.config.suppressWarnings = True
    with np.load(source, allow_pickle=False) as archive:
        frame = {k: archive[k] for k in archive.files}
    clock, cpu = [time.perf_counter()], [time.process_time()]

    def lap() -> None:
        clock.append(time.perf_counter())
        cpu.append(time.process_time())

    mbs = build(frame)
    lap()
    mbs.SolveStatic(settings(), updateInitialValues=True)
    lap()
    offset = bool(np.any(frame["body_cg"]))
    hz = lowest(mbs, int(frame["modes"]), offset) if 6 * len(frame["x"]) <= DENSE_LIMIT else None
    lap()
    stages = ("build", "equilibrium", "modes")[: 3 if hz is not None else 2]
    result = {
        "version": importlib.metadata.version("exudyn"),
        "seconds": dict(zip(stages, np.diff(clock).tolist(), strict=False)),
        "cpu_seconds": dict(zip(stages, np.diff(cpu).tolist(), strict=False)),
        "peak_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "dof": 6 * len(frame["x"]),
        "frequency_hz": None if hz is None else hz.tolist(),
    }
    Path(target).write_text(json.dumps(result))


def settings() -> exu.SimulationSettings:
    made = exu.SimulationSettings()
    made.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    made.staticSolver.verboseMode = 0
    made.staticSolver.newton.absoluteTolerance = 1e-5  # N and N m; 1e9 N/m times rounding is 1e-7
    made.solution.file.write = False
    return made


def build(frame: dict[str, np.ndarray]) -> exu.MainSystem:
    mbs = exu.SystemContainer().AddSystem()
    ground = mbs.AddObject(item.ObjectGround())
    nodes = [
        mbs.AddNode(item.NodeRigidBodyRotVecLG(referenceCoordinates=[*x, 0.0, 0.0, 0.0]))
        for x in frame["x"].tolist()
    ]
    span = np.diff(frame["x"][frame["ends"]], axis=1)[:, 0]
    straight = not np.any(span[:, 1:])
    bodies = _bodies(mbs, frame, nodes, None if straight else span)
    (_beams if straight else _springs_of_struts)(mbs, frame, span, nodes if straight else bodies)
    for node, anchor, stiffness, free in zip(
        frame["spring_node"].tolist(),
        frame["spring_anchor"].tolist(),
        frame["spring_stiffness"].tolist(),
        frame["spring_free_length"].tolist(),
        strict=True,
    ):
        ends = [
            mbs.AddMarker(item.MarkerBodyPosition(bodyNumber=ground, localPosition=anchor)),
            mbs.AddMarker(item.MarkerNodePosition(nodeNumber=nodes[node])),
        ]
        mbs.AddObject(
            item.ObjectConnectorSpringDamper(markerNumbers=ends, referenceLength=free, stiffness=stiffness)
        )
    mbs.Assemble()
    return mbs


def _stiffness(frame: dict[str, np.ndarray], length: float) -> np.ndarray:
    """Of a beam sampled at its middle, times its length."""
    EA, GJ, EI, GA = (float(frame[k]) for k in ("EA", "GJ", "EI", "GA"))
    shear = 1.0 / (1.0 / GA + length**2 / (12.0 * EI))
    return np.diag([EA, shear, shear, GJ, EI, EI])


def _bodies(
    mbs: exu.MainSystem, frame: dict[str, np.ndarray], nodes: list[int], span: np.ndarray | None
) -> list[int]:
    """Rigid bodies; with ``span``, also one at every node with half of all elements that end there."""
    n = len(nodes)
    mass, J, cg = np.zeros(n), np.zeros((n, 3, 3)), np.zeros((n, 3))
    at = frame["body_node"]
    mass[at], cg[at] = frame["body_mass"], frame["body_cg"]
    arm = np.einsum("ij,ij->i", cg, cg)[:, None, None] * np.eye(3) - cg[:, :, None] * cg[:, None, :]
    J[at] = frame["body_inertia"][:, :, None] * np.eye(3)
    J += mass[:, None, None] * arm
    if span is not None:
        length = np.linalg.norm(span, axis=1)
        e = span / length[:, None]
        spin = float(frame["rho_I"]) * length[:, None, None] * (np.eye(3) + e[:, :, None] * e[:, None, :])
        for end in frame["ends"].T:
            np.add.at(mass, end, 0.5 * float(frame["rho_A"]) * length)
            np.add.at(J, end, 0.5 * spin)
    bodies = []
    for i in range(n):
        if mass[i] == 0.0:
            continue
        inertia = [J[i, 0, 0], J[i, 1, 1], J[i, 2, 2], J[i, 1, 2], J[i, 0, 2], J[i, 0, 1]]
        body = item.ObjectRigidBody(
            mass=mass[i], inertia=inertia, centerOfMass=cg[i].tolist(), nodeNumber=nodes[i]
        )
        bodies.append(mbs.AddObject(body))
        _weigh(mbs, bodies[-1], frame["gravity"])
    return bodies


def _weigh(mbs: exu.MainSystem, body: int, gravity: np.ndarray) -> None:
    marker = mbs.AddMarker(item.MarkerBodyMass(bodyNumber=body))
    mbs.AddLoad(item.LoadMassProportional(markerNumber=marker, loadVector=gravity.tolist()))


def _beams(mbs: exu.MainSystem, frame: dict[str, np.ndarray], span: np.ndarray, nodes: list[int]) -> None:
    for (a, b), length in zip(frame["ends"].tolist(), np.linalg.norm(span, axis=1).tolist(), strict=True):
        section = exu.BeamSection()
        section.massPerLength = float(frame["rho_A"])
        section.inertia = float(frame["rho_I"]) * np.diag([2.0, 1.0, 1.0])
        section.stiffnessMatrix = _stiffness(frame, length)
        beam = item.ObjectBeamGeometricallyExact(
            nodeNumbers=[nodes[a], nodes[b]], length=length, sectionData=section
        )
        _weigh(mbs, mbs.AddObject(beam), frame["gravity"])


def _springs_of_struts(
    mbs: exu.MainSystem, frame: dict[str, np.ndarray], span: np.ndarray, bodies: list[int]
) -> None:
    for (a, b), d in zip(frame["ends"].tolist(), span, strict=True):
        length = float(np.linalg.norm(d))
        ends = [_middle(mbs, bodies[a], d, 0.5), _middle(mbs, bodies[b], d, -0.5)]
        mbs.AddObject(
            item.ObjectConnectorRigidBodySpringDamper(
                markerNumbers=ends, stiffness=_stiffness(frame, length) / length
            )
        )


def _middle(mbs: exu.MainSystem, body: int, d: np.ndarray, part: float) -> int:
    """A marker at the middle of an element, x along it."""
    e = d / np.linalg.norm(d)
    y = np.cross(np.eye(3)[np.argmin(np.abs(e))], e)
    y /= np.linalg.norm(y)
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = np.stack([e, y, np.cross(e, y)], axis=1), part * d
    return mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=body, localHT=frame))


def lowest(mbs: exu.MainSystem, count: int, offset: bool) -> np.ndarray:
    """As `ComputeODE2Eigenvalues` with its sparse solver; loads have a stiffness where bodies are offset."""
    solver = exu.MainSolverStatic()
    solver.InitializeSolver(mbs, settings())
    solver.ComputeMassMatrix(mbs)
    M = csr_matrix(solver.GetSystemMassMatrix())
    solver.ComputeJacobianODE2RHS(
        mbs,
        scalarFactor_ODE2=-1.0,
        scalarFactor_ODE2_t=0.0,
        scalarFactor_ODE1=0.0,
        computeLoadsJacobian=int(offset),
    )
    K = csr_matrix(solver.GetSystemJacobian())
    solver.FinalizeSolver(mbs, settings())
    lam = np.sort(eigsh(0.5 * (K + K.T), count, M=M, sigma=0.0, which="LM", return_eigenvectors=False))
    return np.sign(lam) * np.sqrt(np.abs(lam)) / (2.0 * np.pi)


if __name__ == "__main__":
    main(*sys.argv[1:])
