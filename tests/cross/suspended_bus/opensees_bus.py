"""The suspended bus without payload in OpenSees: Timoshenko beams with the corotational transformation.

Bodies hang on corotational links that are stiff rather than on `rigidLink`, a linear constraint without
geometric stiffness, which leaves m g h out. Springs are corotational trusses; their free length of 1 m in a
truss drawn 5 m long is an initial strain. Mass is lumped at the nodes.

The payload is left out: OpenSees turns a joint's axes with nothing (`zeroLength` keeps its axes, `equalDOF`
is linear), so that a gimbal is right for small rotations only; and the bus with the payload hangs at 35
degrees.
"""

from __future__ import annotations

import ctypes
import importlib.util
from pathlib import Path

import numpy as np

from . import case

# The wheel brings a BLAS, but not the path to it.
_FOLDER = Path(next(iter(importlib.util.find_spec("openseespylinux").submodule_search_locations)))
for _name in ("libquadmath.so.0", "libgfortran.so.4", "libblas.so.3", "liblapack.so.3"):
    ctypes.CDLL(str(_FOLDER / "lib" / _name), mode=ctypes.RTLD_GLOBAL)

import openseespy.opensees as ops  # noqa: E402

# Of the links, times the tube's: the lever of 50 mm then bends by 1e-6 of what the tube does.
STIFF = 1e4


def solve(variant: dict, elements: int) -> dict:
    """Lowest frequencies [Hz] on one mesh, ``elements`` in each half of the tube."""
    assert not variant["payload"]
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 6)
    h = 0.5 * case.LENGTH / elements
    count = 2 * elements + 1
    ops.geomTransf("Corotational", 1, 0.0, 0.0, 1.0)
    ops.geomTransf("Corotational", 2, 0.0, 0.0, 1.0)
    _sections()
    for i in range(count):
        ops.node(i, -1.0 + i * h, 0.0, 0.0)
        part = 0.5 if i in (0, count - 1) else 1.0
        rho = case.RHO_I * h * part
        _weigh(i, case.MASS_PER_LENGTH * h * part, (2.0 * rho, rho, rho))
    for i in range(count - 1):
        _beam(i, i, i + 1, 1.0, 1)
    for i, x in enumerate(case.BODY_X):
        node, cg, anchor = i * elements, count + i, count + 3 + i
        ops.node(cg, x, case.BODY_CG[1], 0.0)
        _weigh(cg, case.BODY_MASS[i], case.BODY_INERTIA[i])
        _beam(count + i, node, cg, STIFF, 2)
        ops.node(anchor, x, case.ANCHOR_HEIGHT, 0.0)
        ops.fix(anchor, 1, 1, 1, 1, 1, 1)
        _spring(i, node, anchor, case.SPRING_STIFFNESS[i])
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    for i in range(count + 3):
        ops.load(i, 0.0, -case.GRAVITY * ops.nodeMass(i, 1), 0.0, 0.0, 0.0, 0.0)
    _settle()
    lam = np.array(ops.eigen("-genBandArpack", case.MODES))
    return {"hz": np.sqrt(lam) / (2.0 * np.pi)}


def _weigh(node: int, mass: float, inertia: tuple) -> None:
    ops.mass(node, mass, mass, mass, *inertia)


def _beam(tag: int, start: int, end: int, stiff: float, transformation: int) -> None:
    ops.element("forceBeamColumn", tag, start, end, transformation, 1 if stiff == 1.0 else 2)


def _sections() -> None:
    """OpenSees wants E, A, I, G, J and shear shares: E = G = 1, so that the products stand for themselves."""
    for tag, stiff in ((1, 1.0), (2, STIFF)):
        EA, GJ, EI = (stiff * k for k in (case.EA, case.GJ, case.EI))
        ops.section("Elastic", tag, 1.0, EA, EI, EI, 1.0, GJ, case.KGA / case.EA, case.KGA / case.EA)
        ops.beamIntegration("Legendre", tag, tag, 2)


def _spring(i: int, node: int, anchor: int, stiffness: float) -> None:
    drawn = case.ANCHOR_HEIGHT
    ops.uniaxialMaterial("Elastic", 10 + i, stiffness * drawn)
    ops.uniaxialMaterial("InitStrainMaterial", 20 + i, 10 + i, (drawn - case.SPRING_FREE_LENGTH) / drawn)
    ops.element("corotTruss", 10_000 + i, node, anchor, 1.0, 20 + i)


def _settle() -> None:
    ops.constraints("Plain")
    ops.numberer("RCM")
    ops.system("UmfPack")
    ops.test("NormDispIncr", 1e-10, 50)
    ops.algorithm("Newton")
    ops.integrator("LoadControl", 1.0)
    ops.analysis("Static")
    if ops.analyze(1) != 0:
        raise RuntimeError("no rest state")
