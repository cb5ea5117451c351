"""Packages between their limits as a linear sampled law, each at a fade."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
import scipy.linalg as sla

from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.rounding_errors import unfold_law
from middeck.signals.ports import Port
from middeck.systems.state_space.statespace import SampledStateSpace


def linear_law(package: ControllerPackage, fade: float = 1.0) -> Compensator:
    """u = p + ``fade`` c of ``package``: compensator, filters and inner loop, limits left out.

    Where the compensator estimates from the applied command it sees the faded one: at a fade of zero it is
    the open observer, which follows the plant without moving it. Raises `ConfigError` for a fade outside 0
    to 1.

    >>> from middeck.realtime.package.package_law import package_law
    >>> from middeck.signals.ports import Port
    >>> lag = SampledStateSpace([[0.5]], [[1.0]], [[1.0]], [[-2.0]], period_s=0.1)
    >>> half = linear_law(package_law(Compensator(lag, (Port("y", "m"),), (Port("u", "N"),)), "lag"), 0.5)
    >>> half.sampled.D.tolist()
    [[-1.0]]
    """
    if not 0.0 <= fade <= 1.0:
        raise ConfigError(f"a fade of {fade}", hint="0 to 1")
    return faded_laws([package])([fade])


def limited_law(
    package: ControllerPackage,
) -> Callable[..., Compensator]:
    """u = g (p + f c) of f and g: f is what the law's own limits let through, g what of outputs is applied.

    The compensator learns of both. At g = 0 an output stands still at its limit, at f = 0 the law is off.
    With h for its slew an output moves by h of what is left, u = u_before + h (g (p + f c) - u_before).
    """
    whole, law, m = linear_law(package), unfold_law(package, single=False), len(package.inputs)
    own, loop, E = list(law.law), list(law.loop), law.G[:, m : m + len(package.outputs)]
    C, D, P, Q = law.H[own], law.J[own, :m], law.H[loop], law.J[loop, :m]

    def limited(commands: np.ndarray, drives: np.ndarray, slews: np.ndarray | float = 1.0) -> Compensator:
        f, g, h = commands[:, None], (drives * slews)[:, None], np.broadcast_to(slews, len(drives))
        before = np.diag(1.0 - h)[:, h < 1.0]
        u_x, u_y = np.hstack([g * (P + f * C), before]), g * (Q + f * D)
        F = np.hstack([law.F - E @ (P + C), np.zeros((len(law.F), before.shape[1]))]) + E @ u_x
        A, B = np.vstack([F, u_x[h < 1.0]]), np.vstack([law.G[:, :m] + E @ (u_y - Q - D), u_y[h < 1.0]])
        made = SampledStateSpace(A, B, u_x, u_y, period_s=package.period_s)
        return dataclasses.replace(whole, dynamics=made)

    return limited


def faded_laws(packages: Sequence[ControllerPackage]) -> Callable[[Sequence[float]], Compensator]:
    """u = sum of p + f c of ``packages`` that run at once, on the ports of all, of their fades f.

    A fade may be one times a gain. Each compensator learns what all of them apply at its outputs, as in the
    engine. Raises `ConfigError` for one name with two units.
    """
    laws = [unfold_law(package, single=False) for package in packages]
    reads, inputs = _places([package.inputs for package in packages])
    seen, outputs = _places([package.outputs for package in packages])
    drives = seen.T
    m = [len(package.inputs) for package in packages]
    F = _along([law.F for law in laws])
    by_y = _along([law.G[:, :k] for law, k in zip(laws, m, strict=True)]) @ reads
    by_e = _along([law.G[:, k : k + len(law.law)] for law, k in zip(laws, m, strict=True)])
    C = _along([law.H[list(law.law)] for law in laws])
    D = _along([law.J[list(law.law), :k] for law, k in zip(laws, m, strict=True)]) @ reads
    held_C = drives @ _along([law.H[list(law.loop)] for law in laws])
    held_D = drives @ _along([law.J[list(law.loop), :k] for law, k in zip(laws, m, strict=True)]) @ reads
    method = f"package {' and '.join(package.name for package in packages)}"

    def at(fades: Sequence[float]) -> Compensator:
        faded = drives * np.repeat(fades, [len(package.outputs) for package in packages])
        missing = by_e @ (seen @ faded - np.eye(len(seen)))
        A, B = F + missing @ C, by_y + missing @ D
        made = SampledStateSpace(A, B, held_C + faded @ C, held_D + faded @ D, period_s=packages[0].period_s)
        return Compensator(made, inputs, outputs, method=method)

    return at


def _along(blocks: Sequence[np.ndarray]) -> np.ndarray:
    return np.asarray(sla.block_diag(*blocks))


def _places(sides: Sequence[tuple[Port, ...]]) -> tuple[np.ndarray, tuple[Port, ...]]:
    """Ones where a port of all packages, side by side, is one of the union; and the union."""
    union = tuple(dict.fromkeys(port for ports in sides for port in ports))
    units = {port.name: port.unit for port in reversed(union)}
    for port in union:
        if port.unit != units[port.name]:
            raise ConfigError(
                f"{port.name} in {units[port.name]} of one package, in {port.unit} of another",
                hint="packages of one article",
            )
    return np.array([[float(one == port) for one in union] for ports in sides for port in ports]), union
