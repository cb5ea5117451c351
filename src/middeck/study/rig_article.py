"""The test article that stands on the rig: not the model that anyone designs with.

Its mesh is finer, its struts shear, it has every mode to 200 Hz, and its numbers are off by what nobody
knows, drawn from a seed as in the frozen case "Updating and promise". Only records leave it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.structure.article import Body, Damping, Joint, Member, Node, Section, Structure
from middeck.structure.environment import AnchoredSpring, Environment
from middeck.structure.equilibrium import Equilibrium, solve_equilibrium
from middeck.structure.modes import Modes, solve_modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.systems.plant import Plant
from middeck.values import record

MESH_FACTOR = 3  # times the elements of the article
RIG_MODES_HZ = 200.0
TUBE_SHEAR = 0.62
"""Cowper's (1966) shear coefficient of a tube of the sheet's proportions, bore half of the diameter, nu 0.37:
6 (1 + nu) (1 + m^2)^2 / ((7 + 6 nu) (1 + m^2)^2 + (20 + 12 nu) m^2) with m = 0.512."""
DAMPING_SPREAD = 0.3  # of the logarithm of each mode's ratio
UMBILICAL_LENGTH = 1.0  # m, of the springs that stand for a cable in orbit

Factors = tuple[tuple[str, float], ...]
ThreeFactors = tuple[tuple[str, tuple[float, float, float]], ...]


@record
class HiddenErrors:
    """Factors by which a rig's article differs from the sheet; all one for none.

    Parameters
    ----------
    modulus, strut:
        Of E of all members, and beside it of each member's bending stiffness.
    mass, inertia:
        Of each node's mass and each principal inertia, by node; nodes that are not named keep theirs.
    payload_inertia, payload_cg:
        Of each principal inertia, and of the distance of the centre of mass, by payload joint.
    bounce, cable_length:
        Of the suspension.
    damping:
        Standard normal numbers, one a mode from the lowest: its ratio is multiplied with exp(0.3 d).
    delay_s:
        Added to the rig's total delay.
    gain:
        Of each sensor, by name.
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


@record
class RigArticle:
    """The truth behind a rig: its modes about its own rest state, and what is wrong with them.

    ``hidden`` is None for an article without hidden errors.
    """

    equilibrium: Equilibrium
    modes: Modes
    hidden: HiddenErrors | None


def draw_hidden_errors(structure: Structure, seed: int, *, modes: int = 400) -> HiddenErrors:
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
        damping=rng.standard_normal(modes),
        delay_s=float(rng.uniform(-1e-3, 1e-3)),
        gain=tuple((s.name, around(0.02)) for s in structure.sensors),
    )


def solve_rig_article(
    structure: Structure,
    environment: Environment,
    hidden: HiddenErrors | None = None,
    *,
    mesh_factor: int = MESH_FACTOR,
    shear: float | None = TUBE_SHEAR,
    umbilical_hz: float = 0.0,
) -> RigArticle:
    """The article on its rig in ``environment``, meshed ``mesh_factor`` times finer, its struts in shear.

    ``shear`` is the coefficient k in k G A of every member without a shear stiffness of its own, taken as
    round; None leaves it rigid in shear. In orbit ``umbilical_hz`` ties the middle attach point with springs
    that give the article that frequency in all directions. Raises `ConfigError` for a mesh that is no finer
    or an umbilical without an attach point.
    """
    if mesh_factor < 1:
        raise ConfigError(f"a mesh {mesh_factor} times as fine", where="rig article", hint="one or more")
    finer = _refine(structure, mesh_factor, shear)
    if hidden is not None:
        finer, environment = _hide(finer, hidden), _hide_suspension(environment, hidden)
    if umbilical_hz > 0.0 and not np.any(environment.gravity):
        environment = _tie(finer, environment, umbilical_hz)
    equilibrium = solve_equilibrium(finer, environment)
    return RigArticle(equilibrium, solve_modes(equilibrium), hidden)


def rig_article_plant(
    article: RigArticle,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    to_hz: float = RIG_MODES_HZ,
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
) -> Plant:
    """All modes of the rig's article up to ``to_hz``, each with its own damping."""
    modes = article.modes
    count = int(np.searchsorted(modes.frequency_hz, to_hz))
    damping = modes.equilibrium.model.structure.damping
    if article.hidden is not None:
        damping = _spread_damping(damping, modes, article.hidden.damping, count)
    return build_plant(
        modes, inputs=inputs, outputs=outputs, count=count, damping=damping, w=w, u=u, z=z, y=y
    )


def holding_torque(article: RigArticle, joint: str) -> float:
    """What the motor of ``joint`` holds against gravity [N m]."""
    names = [j.name for j in article.equilibrium.model.structure.joints]
    if joint not in names:
        raise ConfigError(f"no joint {joint!r}", hint=f"one of {', '.join(names)}")
    return float(article.equilibrium.holding_torque[names.index(joint)])


def _refine(structure: Structure, factor: int, shear: float | None) -> Structure:
    def finer(member: Member) -> Member:
        section = member.section if shear is None else _in_shear(member.section, shear)
        return dataclasses.replace(member, elements=factor * member.elements, section=section)

    return dataclasses.replace(structure, members=tuple(finer(m) for m in structure.members))


def _in_shear(section: Section, coefficient: float) -> Section:
    """k G A of a round section from its other stiffnesses: GJ = 2 G I, so that G A = GJ EA / (2 EI)."""
    stiff = coefficient * section.GJ * section.EA / (section.EI_y + section.EI_z)
    GA_y = section.GA_y if np.isfinite(section.GA_y) else stiff
    GA_z = section.GA_z if np.isfinite(section.GA_z) else stiff
    return dataclasses.replace(section, GA_y=GA_y, GA_z=GA_z)


def _hide(structure: Structure, hidden: HiddenErrors) -> Structure:
    return dataclasses.replace(
        structure,
        nodes=tuple(_node(n, hidden) for n in structure.nodes),
        members=tuple(_member(m, hidden) for m in structure.members),
        joints=tuple(_joint(j, hidden) for j in structure.joints),
    )


def _member(member: Member, hidden: HiddenErrors) -> Member:
    E, bending, s = hidden.modulus, dict(hidden.strut).get(member.name, 1.0), member.section
    section = dataclasses.replace(
        s, EA=E * s.EA, GJ=E * s.GJ, EI_y=E * bending * s.EI_y, EI_z=E * bending * s.EI_z,
        GA_y=E * s.GA_y, GA_z=E * s.GA_z,
    )  # fmt: skip
    return dataclasses.replace(member, section=section)


def _node(node: Node, hidden: HiddenErrors) -> Node:
    mass = dict(hidden.mass).get(node.name, 1.0) * node.body.mass
    inertia = _scaled(node.body.inertia, dict(hidden.inertia).get(node.name, (1.0, 1.0, 1.0)))
    return dataclasses.replace(node, body=Body(mass, node.body.cg, inertia))


def _joint(joint: Joint, hidden: HiddenErrors) -> Joint:
    cg = dict(hidden.payload_cg).get(joint.name, 1.0) * joint.body.cg
    inertia = _scaled(joint.body.inertia, dict(hidden.payload_inertia).get(joint.name, (1.0, 1.0, 1.0)))
    return dataclasses.replace(joint, body=Body(joint.body.mass, cg, inertia))


def _scaled(inertia: np.ndarray, factors: tuple[float, float, float]) -> np.ndarray:
    """Principal inertias times factors, along the same principal axes."""
    if not np.any(inertia - np.diag(np.diag(inertia))):
        return np.diag(np.diag(inertia) * factors)
    values, axes = np.linalg.eigh(inertia)
    return (axes * (values * factors)) @ axes.T


def _hide_suspension(environment: Environment, hidden: HiddenErrors) -> Environment:
    if environment.suspension is None:
        return environment
    s = environment.suspension
    hung = dataclasses.replace(
        s, bounce_hz=hidden.bounce * s.bounce_hz, cable_length=hidden.cable_length * s.cable_length
    )
    return dataclasses.replace(environment, suspension=hung)


def _tie(structure: Structure, environment: Environment, frequency_hz: float) -> Environment:
    """Three unstrained springs at the middle attach point, along the axes: a weak cable that no model has."""
    if not structure.attach_points:
        raise ConfigError("an umbilical needs an attach point", where=f"structure {structure.title!r}")
    point = structure.attach_points[len(structure.attach_points) // 2]
    frame = next(n for n in structure.nodes if n.name == point.frame)
    at = frame.position + point.offset
    stiffness = structure.mass * (2.0 * np.pi * frequency_hz) ** 2
    springs = tuple(
        AnchoredSpring(
            f"umbilical {letter}", point.name, at + UMBILICAL_LENGTH * axis, stiffness, UMBILICAL_LENGTH
        )
        for letter, axis in zip("xyz", np.eye(3), strict=True)
    )
    return dataclasses.replace(environment, springs=(*environment.springs, *springs))


def _spread_damping(damping: Damping, modes: Modes, drawn: np.ndarray, count: int) -> Damping:
    """Each mode's own ratio, by kind, times its factor; numbered, since names may repeat."""
    if count > len(drawn):
        raise ConfigError(f"damping drawn for {len(drawn)} modes of {count}", where="HiddenErrors")
    if damping.table is not None or damping.dampers or damping.loss_factor or damping.by_mode:
        raise ConfigError(
            "hidden damping is for ratios by kind of mode", where="damping", hint="leave the others out"
        )
    ratio = {"rigid": damping.rigid, "suspension": damping.suspension, "flexible": damping.flexible}
    each = tuple((i, float(ratio[modes.kind[i]] * np.exp(DAMPING_SPREAD * drawn[i]))) for i in range(count))
    return dataclasses.replace(damping, by_mode=each)
