"""The suspended bus beside MuJoCo, Exudyn and OpenSees, which ran in an environment of their own.

The programs in `suspended_bus` were written from the case alone and import nothing of ours; `case.py` holds
its numbers. Theirs are limits of three meshes, and so are ours.
"""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import structure_builders as build
from middeck.structure.model.article import AttachPoint, Body, Joint, JointState, Section, Structure
from middeck.structure.model.environment import AnchoredSpring, Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium

HERE = Path(__file__).parent / "suspended_bus"
THEIRS: dict[str, Any] = json.loads((HERE / "results.json").read_text())
MESHES = (4, 8, 16)
# The issue asks for 2e-5. The limits are better: in orbit our three meshes leave 5e-7, where shear turns h^4
# into h^2 between the first and the last; Exudyn's Newton leaves 5e-7 on the slowest modes.
AGREEMENT = 2e-6
# OpenSees alone: suspension modes to 7e-6, but the flexible ones of its corotational beams differ from all
# others by up to 3.5e-4, on every mesh; at a thousandth of gravity by 3e-5: it is their geometric stiffness.
OPENSEES = 4e-4


def _case() -> ModuleType:
    spec = importlib.util.spec_from_file_location("suspended_bus_case", HERE / "case.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


CASE = _case()


def bus(variant: dict[str, Any], elements: int) -> Structure:
    tube = Section(
        EA=CASE.EA,
        GJ=CASE.GJ,
        EI_y=CASE.EI,
        EI_z=CASE.EI,
        rho_A=CASE.MASS_PER_LENGTH,
        rho_I_y=CASE.RHO_I,
        rho_I_z=CASE.RHO_I,
        GA_y=CASE.KGA,
        GA_z=CASE.KGA,
    )
    nodes = [
        build.node(f"n{i}", (x, 0.0, 0.0), build.body(mass, CASE.BODY_CG, inertia))
        for i, (x, mass, inertia) in enumerate(
            zip(CASE.BODY_X, CASE.BODY_MASS, CASE.BODY_INERTIA, strict=True)
        )
    ]
    members = [build.member(f"n{i}", f"n{i + 1}", tube, elements) for i in range(2)]
    attach = [AttachPoint(f"a{i}", f"n{i}", np.zeros(3)) for i in range(3)]
    return build.structure(nodes, members, gimbal(variant) if variant["payload"] else (), attach=attach)


def gimbal(variant: dict[str, Any]) -> tuple[Joint, ...]:
    payload = build.body(CASE.PAYLOAD_MASS, CASE.PAYLOAD_CG, CASE.PAYLOAD_INERTIA)
    carrier = f"n{CASE.PAYLOAD_BODY}"
    motor: dict[str, Any] = (
        {"state": JointState.SPRUNG, "stiffness": CASE.MOTOR_STIFFNESS, "target": variant["angle"]}
        if variant["motor_springs"]
        else {}
    )

    def joint(name: str, parent: str, axis: int, body: Body) -> Joint:
        return build.joint(name, parent, np.eye(3)[axis], body, angle=variant["angle"], **motor)

    return joint("stage", carrier, 0, build.NONE), joint("payload", "stage", 2, payload)


def environment(variant: dict[str, Any]) -> Environment:
    if not variant["gravity"]:
        return Environment.orbit()
    springs = tuple(
        AnchoredSpring(
            name=f"s{i}",
            attach=f"a{i}",
            anchor=np.array([x, CASE.ANCHOR_HEIGHT, 0.0]),
            stiffness=k,
            free_length=CASE.SPRING_FREE_LENGTH,
        )
        for i, (x, k) in enumerate(zip(CASE.BODY_X, CASE.SPRING_STIFFNESS, strict=True))
    )
    return Environment(
        title="bus", gravity=np.array([0.0, -CASE.GRAVITY, 0.0]), suspension=None, springs=springs
    )


def frequencies(variant: dict[str, Any], elements: int) -> np.ndarray:
    modes = solve_modes(solve_equilibrium(bus(variant, elements), environment(variant)))
    rigid = modes.kind.count("rigid")
    assert rigid == (0 if variant["gravity"] else CASE.RIGID_MODES_0G)
    return modes.frequency_hz[rigid : rigid + CASE.MODES]


def extrapolate(hz: np.ndarray) -> np.ndarray:
    """Limit of three doubled meshes by Romberg's table: terms of h^2 and h^4."""
    once = hz[1:] + np.diff(hz, axis=0) / 3.0
    return once[1] + (once[1] - once[0]) / 15.0


@pytest.fixture(scope="module", params=list(CASE.VARIANTS))
def pair(request: pytest.FixtureRequest) -> tuple[np.ndarray, dict[str, Any]]:
    hz = np.array([frequencies(CASE.VARIANTS[request.param], n) for n in MESHES])
    return extrapolate(hz), THEIRS["variants"][request.param]


def test_fifteen_modes_agree(pair):
    ours, theirs = pair
    for program, found in theirs.items():
        rtol = OPENSEES if program == "openseespy" else AGREEMENT
        np.testing.assert_allclose(ours, found["hz"], rtol=rtol, err_msg=program)


def test_their_meshes_had_converged():
    for programs in THEIRS["variants"].values():
        for program in ("mujoco", "exudyn"):
            if program in programs:
                assert programs[program]["error"] < 0.5 * AGREEMENT
