"""Hidden errors of a rig's article, drawn from a seed as in the frozen case "Updating and promise"."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.model.article import Body, Damping, Joint, Member, Node, Structure
from middeck.structure.model.environment import Environment
from middeck.structure.model.section import Section
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damping import ratios_by_cause
from middeck.values import record

MODES = 400  # whose damping is drawn
DAMPING_SPREAD = 0.3  # standard deviation of the logarithm of each mode's ratio

Factors = tuple[tuple[str, float], ...]
ThreeFactors = tuple[tuple[str, tuple[float, float, float]], ...]


@record(kw_only=True)
class HiddenErrors:
    """Factors by which a rig's article differs from the sheet; all one for none.

    Attributes:
        modulus, strut: Factor on E of all members, and another on each bending stiffness.
        mass, inertia: Factors on each node's mass and principal inertias, by node; nodes that are not named
            keep theirs.
        payload_inertia, payload_cg: Factors on each principal inertia, and on the distance of the centre of
            mass, by payload joint.
        bounce, cable_length: Factors on bounce frequency and cable length of the suspension.
        damping: Standard normal numbers, one a mode from the lowest: its ratio is multiplied with exp(0.3 d).
        delay_s: Added to the rig's total delay.
        gain: Gain of each sensor, by name.
    """

    modulus: float
    strut: Factors
    mass: Factors
    inertia: ThreeFactors
    payload_inertia: ThreeFactors
    payload_cg: Factors
    bounce: float
    cable_length: float
    damping: Float[np.ndarray, " mode"]
    delay_s: float
    gain: Factors


def draw_hidden_errors(structure: Structure, seed: int) -> HiddenErrors:
    """Hidden errors of ``structure`` from a seed, uniform as the frozen case has them.

    E +-15 %, each strut's EI a further -5 to 0 %, masses +-5 % and inertias +-10 % of the heavy nodes (those
    of 1 kg and more), payload inertias and centres of mass +-10 %, bounce +-10 %, cable length +-5 %, damping
    lognormal (0.3), delay +-1 ms, sensor gains +-2 %.
    """
    rng = np.random.default_rng(seed)

    def around(spread: float) -> float:
        return float(1.0 + rng.uniform(-spread, spread))

    def three(spread: float) -> tuple[float, float, float]:
        return around(spread), around(spread), around(spread)

    heavy = [n.name for n in structure.nodes if n.body.mass >= 1.0]
    payloads = [j.name for j in structure.joints if np.any(j.body.cg)]
    return HiddenErrors(
        modulus=around(0.15),
        strut=tuple((m.name, float(rng.uniform(0.95, 1.0))) for m in structure.members),
        mass=tuple((n, around(0.05)) for n in heavy),
        inertia=tuple((n, three(0.1)) for n in heavy),
        payload_inertia=tuple((j, three(0.1)) for j in payloads),
        payload_cg=tuple((j, around(0.1)) for j in payloads),
        bounce=around(0.1),
        cable_length=around(0.05),
        damping=rng.standard_normal(MODES),
        delay_s=float(rng.uniform(-1e-3, 1e-3)),
        gain=tuple((s.name, around(0.02)) for s in structure.sensors),
    )


def hide_in_structure(structure: Structure, hidden: HiddenErrors) -> Structure:
    """The article with its hidden errors."""
    return dataclasses.replace(
        structure,
        nodes=tuple(_node(n, hidden) for n in structure.nodes),
        members=tuple(_member(m, hidden) for m in structure.members),
        joints=tuple(_joint(j, hidden) for j in structure.joints),
    )


def _member(member: Member, hidden: HiddenErrors) -> Member:
    E, bending = hidden.modulus, dict(hidden.strut).get(member.name, 1.0)
    # In halves on rows and columns, so that couplings stay possible.
    half = np.array([1.0, 1.0, 1.0, 1.0, bending, bending]) ** 0.5

    def altered(s: Section) -> Section:
        return dataclasses.replace(
            s, EA=E * s.EA, GJ=E * s.GJ, EI_y=E * bending * s.EI_y, EI_z=E * bending * s.EI_z,
            GA_y=E * s.GA_y, GA_z=E * s.GA_z, coupling=E * np.outer(half, half) * s.coupling,
        )  # fmt: skip

    stations = tuple((at, altered(s)) for at, s in member.stations)
    return dataclasses.replace(member, section=altered(member.section), stations=stations)


def _node(node: Node, hidden: HiddenErrors) -> Node:
    mass = dict(hidden.mass).get(node.name, 1.0) * node.body.mass
    body = _scaled_body(node.body, dict(hidden.inertia).get(node.name))
    return dataclasses.replace(node, body=dataclasses.replace(body, mass=mass))


def _joint(joint: Joint, hidden: HiddenErrors) -> Joint:
    cg = dict(hidden.payload_cg).get(joint.name, 1.0) * joint.body.cg
    body = _scaled_body(joint.body, dict(hidden.payload_inertia).get(joint.name))
    return dataclasses.replace(joint, body=dataclasses.replace(body, cg=cg))


def _scaled_body(body: Body, factors: tuple[float, float, float] | None) -> Body:
    """Errors of a model's inertias are each their own: what they make of them need be no body's."""
    if factors is None:
        return body
    return dataclasses.replace(body, inertia=_scaled(body.inertia, factors), rotors_excluded=True)


def _scaled(inertia: np.ndarray, factors: tuple[float, float, float]) -> np.ndarray:
    """Principal inertias times factors, along the same principal axes."""
    if not np.any(inertia - np.diag(np.diag(inertia))):
        return np.diag(np.diag(inertia) * factors)
    values, axes = np.linalg.eigh(inertia)
    return (axes * (values * factors)) @ axes.T


def hide_in_suspension(environment: Environment, hidden: HiddenErrors) -> Environment:
    """The laboratory with the hidden errors of its suspension; orbit has none."""
    if environment.suspension is None:
        return environment
    s = environment.suspension
    hung = dataclasses.replace(
        s, bounce_hz=hidden.bounce * s.bounce_hz, cable_length=hidden.cable_length * s.cable_length
    )
    return dataclasses.replace(environment, suspension=hung)


def spread_damping(damping: Damping, modes: Modes, drawn: np.ndarray, count: int) -> Damping:
    """Each mode's own ratio times its factor; numbered, since names may repeat."""
    if count > len(drawn):
        raise ConfigError(
            f"damping drawn for {len(drawn)} modes of {count}",
            where="HiddenErrors",
            hint="a plant of fewer modes",
        )
    if damping.table is not None or damping.dampers or damping.loss_factor or damping.by_mode:
        raise ConfigError(
            "hidden damping is for ratios by kind of mode", where="damping", hint="leave the others out"
        )
    zeta = ratios_by_cause(modes, damping, count=count).zeta * np.exp(DAMPING_SPREAD * drawn[:count])
    each = tuple((i, float(ratio)) for i, ratio in enumerate(zeta))
    return dataclasses.replace(damping, by_mode=each)
