"""Modes, rest states and responses in the form of JSON that studies and verbs share."""

from typing import Any

import numpy as np

from middeck.structure.modes.motions.strained_parts import leading_parts, strained_parts
from middeck.structure.modes.solve import Modes
from middeck.structure.rest.equilibrium import Equilibrium, node_rotations
from middeck.systems.plants.response import FrequencyResponse

# Share of a mode's energy below which its strain prints as 0.0 %: what holds it is the suspension.
LEAST_STRAIN = 5e-4


def mode_numbers(modes: Modes, count: int) -> dict[str, Any]:
    """The lowest ``count`` modes with their residuals and warnings."""
    return {
        "frequency_hz": modes.frequency_hz[:count],
        "kind": modes.kind[:count],
        "name": modes.name[:count],
        "strain_share": modes.strain_share[:count],
        "rigid_residual": modes.rigid_residual,
        "residual": float(modes.residual[:count].max()),
        "warnings": modes.warnings,
    }


def most_strained(modes: Modes, count: int) -> list[dict[str, Any] | None]:
    """The part with most of the strain energy of each of the lowest modes; None where nothing is strained."""
    parts, shares = strained_parts(modes.equilibrium, modes.shapes[:, :count])
    named = [leading_parts(parts, share) for share in shares]
    return [
        None if kind == "rigid" or strain < LEAST_STRAIN or not part else {"part": part, "share": share}
        for kind, strain, (part, share) in zip(modes.kind, modes.strain_share, named, strict=False)
    ]


def rest_numbers(equilibrium: Equilibrium) -> dict[str, Any]:
    """The rest state: reactions, holding torques and node rotations, each by name."""
    suspension, joints = equilibrium.suspension, equilibrium.model.structure.joints
    rotation = node_rotations(equilibrium)
    return {
        "reactions_n": dict(zip(suspension.name, suspension.reaction, strict=True)),
        "holding_torque_nm": {
            j.name: torque
            for j, torque in zip(joints, equilibrium.holding_torque, strict=True)
            if not j.slides
        },
        "node_rotation_deg": {name: np.degrees(v) for name, v in rotation.items()},
    }


def response_numbers(response: FrequencyResponse, *, output: int = 0, input: int = 0) -> dict[str, Any]:
    """One entry of a response on its own lines."""
    H = response.H[:, output, input]
    return {"frequency_hz": response.frequency_hz, "re": np.real(H), "im": np.imag(H)}


def fitted_numbers(
    measured: FrequencyResponse, fitted: FrequencyResponse, *, output: int = 0, input: int = 0
) -> dict[str, Any]:
    """One entry of a measured response beside the fit to it."""
    return {
        "input": measured.inputs[input].name,
        "output": measured.outputs[output].name,
        "data": response_numbers(measured, output=output, input=input),
        "fit": response_numbers(fitted, output=output, input=input),
    }
