"""The suspended bus in Exudyn: geometrically exact two-node beams on SE(3), nodes on the Lie group.

Static solution, mass matrix, stiffness and constraint Jacobian are Exudyn's; only the eigensolution in the
null space of the constraints is written here. What `ComputeLinearizedSystem` exports is not the linearised
system:

- It leaves the stiffness of loads out: gravity on a centre of mass beside its node gives no m g h. The
  Jacobian has it when asked with `computeLoadsJacobian`, but in the derivative of the nodes' rotation
  vectors, where all else is in that of body-fixed small rotations: the two differ once the bus has turned
  (35 degrees here, with the payload), and `_increments` is between them.
- It leaves the geometric stiffness of constraint reactions out. Reaction forces have none here, for all
  joints are at the origins of their nodes; reaction moments have. In `gimbal_0_1g` the torque that holds
  the payload is therefore put between bus and payload rather than through the joint of the stage: at zero
  angle both have the same generalised forces to first order, and no reaction moment is left. Its derivative
  is written by hand; that of Exudyn's torsional spring mixes the two kinds of rotation. At 45 degrees in
  gravity there is no such way out, and Exudyn is not asked.
"""

from __future__ import annotations

import itertools

import exudyn as exu
import numpy as np
import scipy.linalg as sla
from exudyn import itemInterface as item  # noqa: N813
from scipy.spatial.transform import Rotation

from . import case


def _section() -> exu.BeamSection:
    section = exu.BeamSection()
    section.massPerLength = case.MASS_PER_LENGTH
    section.inertia = np.diag([2.0 * case.RHO_I, case.RHO_I, case.RHO_I])
    section.stiffnessMatrix = np.diag([case.EA, case.KGA, case.KGA, case.GJ, case.EI, case.EI])
    return section


class Bus:
    """Exudyn's system of one variant; ``elements`` beams in each half of the tube."""

    def __init__(self, variant: dict, elements: int, held: bool) -> None:
        self.mbs = exu.SystemContainer().AddSystem()
        self.gravity = np.array([0.0, -case.GRAVITY if variant["gravity"] else 0.0, 0.0])
        self.ground = self.mbs.AddObject(item.ObjectGround())
        h = 0.5 * case.LENGTH / elements
        nodes = [self._node(x, np.zeros(3)) for x in np.linspace(-1.0, 1.0, 2 * elements + 1)]
        for a, b in itertools.pairwise(nodes):
            beam = item.ObjectBeamGeometricallyExact(nodeNumbers=[a, b], length=h, sectionData=_section())
            self._load(self.mbs.AddObject(beam))
        for i, x in enumerate(case.BODY_X):
            body = self._body(nodes[i * elements], case.BODY_MASS[i], case.BODY_CG, case.BODY_INERTIA[i])
            if variant["gravity"]:
                self._spring(body, x, case.SPRING_STIFFNESS[i])
            if i == case.PAYLOAD_BODY and variant["payload"]:
                self.gimbal_nodes = (nodes[i * elements], self._gimbal(body, x, variant, held))
        self.mbs.Assemble()

    def _node(self, x: float, rotation: np.ndarray) -> int:
        node = item.NodeRigidBodyRotVecLG(referenceCoordinates=[x, 0.0, 0.0, *rotation])
        return self.mbs.AddNode(node)

    def _body(self, node: int, mass: float, cg: tuple, inertia: tuple) -> int:
        c = np.array(cg)
        J = np.diag(inertia) + mass * (c @ c * np.eye(3) - np.outer(c, c))
        about_node = [J[0, 0], J[1, 1], J[2, 2], J[1, 2], J[0, 2], J[0, 1]]
        body = self.mbs.AddObject(
            item.ObjectRigidBody(mass=mass, inertia=about_node, centerOfMass=cg, nodeNumber=node)
        )
        self._load(body)
        return body

    def _load(self, body: int) -> None:
        if np.any(self.gravity):
            marker = self.mbs.AddMarker(item.MarkerBodyMass(bodyNumber=body))
            self.mbs.AddLoad(item.LoadMassProportional(markerNumber=marker, loadVector=self.gravity))

    def _spring(self, body: int, x: float, stiffness: float) -> None:
        anchor = item.MarkerBodyPosition(bodyNumber=self.ground, localPosition=[x, case.ANCHOR_HEIGHT, 0.0])
        ends = [self.mbs.AddMarker(m) for m in (anchor, item.MarkerBodyPosition(bodyNumber=body))]
        self.mbs.AddObject(
            item.ObjectConnectorSpringDamper(
                markerNumbers=ends, referenceLength=case.SPRING_FREE_LENGTH, stiffness=stiffness
            )
        )

    def _gimbal(self, carrier: int, x: float, variant: dict, held: bool) -> int:
        """A stage without mass behind the x axis, the payload behind its z axis: its node."""
        angle = variant["angle"]
        turns = [Rotation.from_rotvec([angle, 0.0, 0.0])]
        turns.append(turns[0] * Rotation.from_rotvec([0.0, 0.0, angle]))
        stage, payload = (self._node(x, turn.as_rotvec()) for turn in turns)
        bodies = [carrier, self.mbs.AddObject(item.ObjectRigidBody(nodeNumber=stage))]
        bodies.append(self._body(payload, case.PAYLOAD_MASS, case.PAYLOAD_CG, case.PAYLOAD_INERTIA))
        markers = [self.mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=b)) for b in bodies]
        for (a, b), axis in zip(itertools.pairwise(markers), (3, 5), strict=True):
            axes = [0 if not held and k == axis else 1 for k in range(6)]
            self.mbs.AddObject(item.ObjectJointGeneric(markerNumbers=[a, b], constrainedAxes=axes))
        return payload

    def settle(self) -> np.ndarray:
        """Static solution, which stays the initial state: coordinates of the nodes."""
        self.mbs.SolveStatic(_settings(), updateInitialValues=True)
        return self.mbs.systemData.GetODE2Coordinates()

    def place(self, q: np.ndarray) -> None:
        self.mbs.systemData.SetODE2Coordinates(q, exu.ConfigurationType.Initial)

    def payload_torque(self) -> float:
        """The torque about its z axis [N m] that holds the payload: less the moment of its weight."""
        payload = self.gimbal_nodes[1]
        R = self.mbs.GetNodeOutput(payload, exu.OutputVariableType.RotationMatrix).reshape(3, 3)
        moment = np.cross(R @ case.PAYLOAD_CG, case.PAYLOAD_MASS * self.gravity)
        return float(-moment @ R[:, 2])

    def matrices(self, torque: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Stiffness and mass in the null space of the constraints, at the initial state.

        ``torque`` acts on the payload about the z axis of the bus, and against it on the bus, at zero angle.
        """
        solver = exu.MainSolverStatic()
        solver.InitializeSolver(self.mbs, _settings())
        n = solver.GetODE2size()
        solver.ComputeMassMatrix(self.mbs)
        M = np.array(solver.GetSystemMassMatrix())[:n, :n]
        of_objects, with_loads = (self._jacobian(solver, loads) for loads in (0, 1))
        q = self.mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Initial)
        turns = q.reshape(-1, 6)[:, 3:]
        K = of_objects[:n, :n] + (with_loads - of_objects)[:n, :n] @ _increments(turns)
        if torque:
            # On the bus it is fixed to the body; on the payload it turns with the bus.
            on_bus, on_payload = (6 * node + 3 for node in self.gimbal_nodes)
            z_cross = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
            K[on_payload : on_payload + 3, on_payload : on_payload + 3] -= torque * z_cross
            K[on_payload : on_payload + 3, on_bus : on_bus + 3] += torque * z_cross
        C = of_objects[n:, :n]
        solver.FinalizeSolver(self.mbs, _settings())
        N = np.eye(n) if not len(C) else sla.null_space(C)
        K, M = N.T @ K @ N, N.T @ M @ N
        # Symmetric where every term of equilibrium is there:
        assert np.abs(K - K.T).max() < 1e-6  # of 1e8: rounding
        return 0.5 * (K + K.T), 0.5 * (M + M.T)

    def _jacobian(self, solver: exu.MainSolverStatic, loads: int) -> np.ndarray:
        factors = {"scalarFactor_ODE2_t": 0.0, "scalarFactor_ODE1": 0.0}
        solver.ComputeJacobianODE2RHS(self.mbs, scalarFactor_ODE2=-1.0, computeLoadsJacobian=loads, **factors)
        solver.ComputeJacobianAE(self.mbs, scalarFactor_ODE2=1.0, **factors)
        return np.array(solver.GetSystemJacobian())


def _increments(turns: np.ndarray) -> np.ndarray:
    """Derivative of the nodes' coordinates, rotation vectors, in body-fixed small rotations."""
    blocks = []
    for v in turns:
        angle = np.linalg.norm(v)
        S = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
        more = 1.0 / 12.0 if angle < 1e-3 else (1.0 - 0.5 * angle / np.tan(0.5 * angle)) / angle**2
        blocks += [np.eye(3), np.eye(3) + 0.5 * S + more * S @ S]
    return sla.block_diag(*blocks)


def _settings() -> exu.SimulationSettings:
    settings = exu.SimulationSettings()
    settings.staticSolver.verboseMode = 0
    settings.staticSolver.newton.absoluteTolerance = 1e-6  # N and N m; rounding of 1e6 N of stiffness is 1e-7
    settings.solution.file.write = False
    return settings


def solve(variant: dict, elements: int) -> dict:
    """Lowest frequencies [Hz] of one variant on one mesh."""
    held = Bus(variant, elements, held=True)
    free = Bus(variant, elements, held=False)
    torque = 0.0
    if variant["gravity"]:
        free.place(held.settle())
        torque = held.payload_torque() if variant["payload"] else 0.0
    K, M = free.matrices(torque)
    floating = 0 if variant["gravity"] else case.RIGID_MODES_0G
    shift = 0.0 if variant["gravity"] else 1.0
    mu = sla.eigh(M, K + shift * M, eigvals_only=True)[::-1][floating : floating + case.MODES]
    return {"hz": np.sqrt(1.0 / mu - shift) / (2.0 * np.pi)}
