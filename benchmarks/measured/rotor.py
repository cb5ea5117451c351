"""An overhung disc on a massless shaft: its whirl at several speeds, computed and in closed form."""

from __future__ import annotations

import json
import subprocess
from typing import Any

import numpy as np

from measured.rows import PEERS, row

LENGTH, EI, MASS, ACROSS, POLAR = 0.5, 800.0, 4.0, 0.03, 0.05
SPEEDS = (10.0, 100.0, 1000.0, 10000.0)  # rad/s
ELEMENTS = 8


def rows(python: str | None) -> list[dict[str, Any]]:
    """Forward and backward whirl against the closed form."""
    note = "10 to 10,000 rad/s"
    found = row("Rotor with an overhung disc", "largest error of 16 whirl speeds, to the closed form", "",
                largest_error([whirl(speed) for speed in SPEEDS]), 1e-9, note=note)  # fmt: skip
    peer = by_ross(python) if python else None
    if peer is None:
        return [found]
    error = largest_error([np.array(line) for line in peer["whirl"]])
    note += "; ROSS's matrices, clamped by striking out"
    return [{**found, "peers": {"ROSS": {"value": error, "version": peer["version"]}}, "note": note}]


def closed_form(speed: float) -> np.ndarray:
    """Whirl [rad/s], backward negative: (k11 - m w^2)(k22 + P W w - D w^2) = k12^2 (Genta 2005, 2.6)."""
    k11, k12, k22 = EI * np.array([12.0 / LENGTH**3, 6.0 / LENGTH**2, 4.0 / LENGTH])
    P = np.polynomial.Polynomial
    quartic = P([k11, 0.0, -MASS]) * P([k22, POLAR * speed, -ACROSS]) - k12**2
    root = np.real(quartic.roots())
    for _ in range(3):  # Newton's method: an eigenvalue of a companion matrix rounds to the largest root
        root = root - quartic(root) / quartic.deriv()(root)
    return np.sort(root)


def whirl(speed: float) -> np.ndarray:
    """The same from a mesh of beams with a wheel."""
    from middeck.structure.model.article import Body, Damping, Member, Node, Section, Structure, Wheel
    from middeck.structure.model.clamps import Clamp
    from middeck.structure.model.environment import Environment
    from middeck.structure.modes.solve import solve_modes
    from middeck.structure.plants.whirl_modes import solve_gyroscopic_modes
    from middeck.structure.rest.equilibrium import solve_equilibrium

    nothing = Body(0.0, np.zeros(3), np.zeros((3, 3)))
    disc = Body(MASS, np.zeros(3), np.diag([POLAR, ACROSS, ACROSS]))
    shaft = Section(EA=1e8, GJ=500.0, EI_y=EI, EI_z=EI, rho_A=0.0, rho_I_y=0.0, rho_I_z=0.0)
    parts = Structure(
        title="rotor",
        nodes=(
            Node("wall", np.zeros(3), 0.0, nothing),
            Node("disc", np.array([LENGTH, 0.0, 0.0]), 0.0, disc),
        ),
        members=(
            Member(
                name="shaft",
                start="wall",
                end="disc",
                section=shaft,
                elements=ELEMENTS,
                up=np.array([0.0, 1.0, 0.0]),
            ),
        ),
        joints=(),
        springs=(),
        attach_points=(),
        actuators=(),
        sensors=(),
        damping=Damping(),
        wheels=(Wheel(name="rotor", frame="disc", axis=np.array([1.0, 0.0, 0.0]), inertia=POLAR),),
    )
    bench = Environment(
        title="bench", gravity=np.zeros(3), clamps=(Clamp(node="wall"),), wheel_speeds=(("rotor", speed),)
    )
    modes = solve_gyroscopic_modes(solve_modes(solve_equilibrium(parts, bench), standstill=True))
    sign = {"forward": 1.0, "backward": -1.0, "": 0.0}
    signed = modes.omega * [sign[way] for way in modes.sense]
    return np.sort(signed[signed != 0.0])


def largest_error(found: list[np.ndarray]) -> float:
    """Largest relative error of the whirl speeds at each of `SPEEDS`, signed or not."""
    exact = [closed_form(speed) for speed in SPEEDS]
    pairs = zip(found, exact, strict=True)
    return max(float(np.abs(np.sort(np.abs(a)) / np.sort(np.abs(b)) - 1.0).max()) for a, b in pairs)


def by_ross(python: str) -> dict | None:
    """The same by ROSS, if the interpreter ``python`` has it."""
    given = {"EI": EI, "length": LENGTH, "mass": MASS, "across": ACROSS, "polar": POLAR, "speeds": SPEEDS}
    script = PEERS / "ross_rotor.py"
    done = subprocess.run([python, str(script), json.dumps(given)], capture_output=True, text=True)
    return json.loads(done.stdout.splitlines()[-1]) if done.returncode == 0 else None
