"""Band-limited rms of a free body with flexible modes, poles at the origin: against extended precision."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from measured.rows import row
from middeck.systems.norms.band_rms import band_rms
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import StateSpace

CASE = "band_rms"
BAND_HZ, REPEATS = (0.1, 60.0), 5


def rows(options: Any) -> list[dict]:
    del options
    modal = _free_body()
    true = _in_extended_precision(modal)
    plain = modal.as_statespace()
    made = []
    for name, system in (("modal states", plain), ("states turned", _turned(plain))):
        times = []
        for _ in range(REPEATS):
            start = time.process_time()
            found = band_rms(system, np.eye(modal.psi.shape[1]), BAND_HZ)
            times.append(time.process_time() - start)
        error = float(np.abs(found / true - 1.0).max())
        made.append(row(CASE, f"error, {name}", "relative", error, 1e-10, states=len(system.A)))
        made.append(row(CASE, f"time, {name}", "CPU s", float(np.median(times))))
    return made


def _free_body() -> ModalSystem:
    """Three rigid modes and twenty of 1 % from 0.3 to 50 Hz, two inputs, three outputs."""
    rng = np.random.default_rng(12)
    omega = np.concatenate([np.zeros(3), 2.0 * np.pi * np.geomspace(0.3, 50.0, 20)])
    psi, phi = rng.standard_normal((23, 2)), rng.standard_normal((3, 23))
    zeta = np.where(omega > 0.0, 0.01, 0.0)
    return ModalSystem(
        omega=omega,
        zeta=zeta,
        psi=psi,
        phi=phi,
        phi_rate=np.zeros_like(phi),
        names=tuple(f"mode {k}" for k in range(23)),
    )


def _turned(system: StateSpace) -> StateSpace:
    T, _ = np.linalg.qr(np.random.default_rng(3).standard_normal(system.A.shape))
    return StateSpace(T @ system.A @ T.T, T @ system.B, system.C @ T.T, system.D)


def _in_extended_precision(modal: ModalSystem) -> np.ndarray:
    """The sum over modes squared, by a Gauss rule of 20 points on panels that shrink towards resonances."""
    low, high = 2.0 * np.pi * np.array(BAND_HZ)
    flexible = modal.omega[modal.omega > 0.0]
    # Panels that grow away from each resonance like the distance from it.
    away = np.concatenate([-np.geomspace(1e-3, 1e3, 121)[::-1], [0.0], np.geomspace(1e-3, 1e3, 121)])
    edges = np.concatenate([(flexible[:, None] * (1.0 + away)).ravel(), np.geomspace(low, high, 400)])
    edges = np.unique(np.concatenate([edges[(edges > low) & (edges < high)], [low, high]]))
    nodes, weights = (np.asarray(a, dtype=np.longdouble) for a in np.polynomial.legendre.leggauss(20))
    total = np.zeros(len(modal.phi), dtype=np.longdouble)
    w0, zeta = modal.omega.astype(np.longdouble), modal.zeta.astype(np.longdouble)
    phi, psi = modal.phi.astype(np.longdouble), modal.psi.astype(np.longdouble)
    for a, b in zip(edges[:-1].astype(np.longdouble), edges[1:].astype(np.longdouble), strict=True):
        s = 1j * (a + (nodes + 1.0) / 2.0 * (b - a))[:, None]
        q = 1.0 / (s**2 + 2.0 * zeta * w0 * s + w0**2)
        H = np.einsum("om,lm,mi->loi", phi, q, psi)
        total += (b - a) / 2.0 * np.einsum("l,loi->o", weights, np.abs(H) ** 2)
    return np.sqrt(total / np.pi).astype(float)
