"""Figures 6 and 7: modal plants, PD loops, LQG by SciPy, band-limited rms by adaptive quadrature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as sla
from scipy.integrate import quad_vec

from .article import Sheet, Solved, rigid_basis

SUB_MODELS = ("all", "rigid", "flexible")
UNSTABLE = 1e-8  # real part [rad/s], the sheet's
SEARCH_LAST, SEARCH_STEP, SEARCH_RESOLUTION = 7.0, 0.25, 0.005
FIGURE_6_HZ = (0.2, 0.5, 1.0, 1.5, 3.0, 8.0, 15.0, 25.0)


@dataclass(frozen=True)
class Plant:
    """The PD-controlled modal model, states (q, q'): w to z through D and Z, u to y through B and C."""

    omega: np.ndarray
    A: np.ndarray
    B: np.ndarray
    D: np.ndarray
    C: np.ndarray
    Z: np.ndarray


def modal_plants(solved: Solved, sheet: Sheet) -> dict[tuple[str, str], Plant]:
    """Whole, rigid (lab: suspension) and flexible model in orbit and in the lab.

    In orbit the three translations are left out: no torque moves them and no angle sees them.
    """
    kept, damping, rigid = sheet["control"]["modes_kept"], sheet["damping"], solved.rigid
    _, turning = rigid_basis(solved)
    flexible = np.full(kept - rigid, damping["flexible"])
    sides = {
        "orbit": (
            solved.orbit,
            np.hstack([turning, solved.orbit.shapes[:, rigid:kept]]),
            np.r_[np.zeros(rigid - 3), 2 * np.pi * solved.orbit.hz[rigid:kept]],
            np.r_[np.zeros(rigid - 3), flexible],
            rigid - 3,
        ),
        "lab": (
            solved.lab,
            solved.lab.shapes,
            2 * np.pi * solved.lab.hz,
            np.r_[np.full(rigid, damping["suspension"]), flexible],
            rigid,
        ),
    }
    plants: dict[tuple[str, str], Plant] = {}
    for name, (side, shapes, omega, zeta, first_flexible) in sides.items():
        parts = {
            "all": slice(None),
            "rigid": slice(0, first_flexible),
            "flexible": slice(first_flexible, None),
        }
        for which, part in parts.items():
            plants[which, name] = _plant(
                side.rows, shapes[:, part], omega[part], zeta[part], sheet["control"]
            )
    return plants


def _plant(
    rows: dict[str, np.ndarray], shapes: np.ndarray, omega: np.ndarray, zeta: np.ndarray, control: Sheet
) -> Plant:
    n = len(omega)
    none = np.zeros((n, n))

    def modal(names: list[str]) -> np.ndarray:
        return np.array([rows[name] for name in names]) @ shapes

    loops = modal(control["pd_loops"]).T
    stiffness = loops @ np.diag(control["pd_kp"]) @ loops.T
    damping = loops @ np.diag(control["pd_kd"]) @ loops.T
    A = np.block([[none, np.eye(n)], [-np.diag(omega**2), -np.diag(2 * zeta * omega)]])
    A = A + np.block([[np.zeros((n, 2 * n))], [-stiffness, -damping]])
    angles, metric = modal(control["angles"]), modal(control["metric"])
    u, w = modal(control["inputs"]).T, modal(control["disturbances"]).T
    return Plant(
        omega,
        A,
        np.vstack([np.zeros_like(u), u]),
        np.vstack([np.zeros_like(w), w]),
        np.block([[angles, 0 * angles], [0 * angles, angles]]),
        np.hstack([np.diag(control["metric_weights"]) @ metric, 0 * metric]),
    )


def riccati_gain(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
    """R^-1 B' X by SciPy's generalised Schur method and two steps of Kleinman (1968)."""
    L = np.linalg.cholesky(R)
    unit = np.linalg.solve(L, B.T).T
    X = sla.solve_continuous_are(A, unit, Q, np.eye(B.shape[1]), balanced=True)
    for _ in range(2):
        K = unit.T @ X
        X = sla.solve_continuous_lyapunov((A - unit @ K).T, -(Q + K.T @ K))
        X = (X + X.T) / 2
    K = unit.T @ X
    assert np.linalg.eigvals(A - unit @ K).real.max() < 0
    return np.linalg.solve(L.T, K)


def design(plant: Plant, psd: float, log10_authority: float, control: Sheet) -> tuple[np.ndarray, np.ndarray]:
    """Regulator and filter gain of the orbit model at one authority, solved in evened-out states."""
    n, inputs = len(plant.omega), control["input_weight"]
    even = np.r_[np.maximum(plant.omega, 1.0), np.ones(n)]
    T, back = np.diag(even), np.diag(1 / even)
    A, B, D, C, Z = T @ plant.A @ back, T @ plant.B, T @ plant.D, plant.C @ back, plant.Z @ back
    K = riccati_gain(A, B, Z.T @ Z, 10.0**-log10_authority * np.diag(inputs))
    process = D @ D.T + control["actuator_noise_ratio"] * B @ B.T
    ny = len(C) // 2
    sensor = np.diag(np.r_[np.full(ny, control["angle_noise"] ** 2), np.full(ny, control["rate_noise"] ** 2)])
    L = riccati_gain(A.T, C.T, process, sensor / psd).T
    return K @ T, back @ L


def close(model: Plant, plant: Plant, K: np.ndarray, L: np.ndarray) -> tuple[np.ndarray, ...]:
    """A, B, C from w to z of ``plant`` under the compensator of ``model``, and the compensator's own A."""
    law = model.A - model.B @ K - L @ model.C
    A = np.block([[plant.A, -plant.B @ K], [L @ plant.C, law]])
    n = 2 * len(model.omega)
    D = np.vstack([plant.D, np.zeros((n, plant.D.shape[1]))])
    return A, D, np.hstack([plant.Z, np.zeros((len(plant.Z), n))]), law


def grows(A: np.ndarray) -> bool:
    """Whether an eigenvalue is unstable."""
    return bool(np.linalg.eigvals(A).real.max() > UNSTABLE)


def mean_square(A: np.ndarray, B: np.ndarray, C: np.ndarray, psd: float, band_hz: list[float]) -> float:
    """2 S int |G|^2 df summed over the outputs: quadrature in log f, split around each resonance."""
    H, Z = sla.hessenberg(A, calc_q=True)
    b, c, one = (Z.T @ B).astype(complex), C @ Z, np.eye(len(A))
    splits = []
    for pole in np.linalg.eigvals(A):
        if pole.imag > 0 and abs(pole.real) < 0.3 * abs(pole):
            centre, half = pole.imag / 2 / np.pi, abs(pole.real) / 2 / np.pi
            splits += [centre - 4 * half, centre - half, centre, centre + half, centre + 4 * half]
    splits = sorted({np.log(f) for f in splits if band_hz[0] < f < band_hz[1]})

    def integrand(log_f: float) -> np.ndarray:
        f = np.exp(log_f)
        G = c @ np.linalg.solve(2j * np.pi * f * one - H, b)
        return (np.abs(G) ** 2).sum(1) * f

    value, _ = quad_vec(
        integrand, *np.log(band_hz), epsrel=1e-7, epsabs=0, points=splits, norm="max", limit=4000
    )
    return float((2 * psd * value).sum())


def figure_7(solved: Solved, sheet: Sheet) -> dict[str, Any]:
    """Disturbance intensity, then decibels over authority and the first instability of each sub-model."""
    control = sheet["control"]
    plants, band = modal_plants(solved, sheet), control["band_hz"]

    def under_pd(plant: Plant, psd: float) -> float:
        return mean_square(plant.A, plant.D, plant.Z, psd, band)

    psd = (np.deg2rad(control["three_sigma_deg"]) / 3) ** 2 / under_pd(plants["all", "orbit"], 1.0)
    levels = np.linspace(control["log10_authority_first"], control["log10_authority_last"], control["levels"])
    found: dict[str, Any] = {
        "disturbance_psd": psd,
        "metric_3sigma_deg_pd": {
            side: float(np.rad2deg(3 * np.sqrt(under_pd(plants["all", side], psd))))
            for side in ("orbit", "lab")
        },
    }
    for which in SUB_MODELS:
        model, lab = plants[which, "orbit"], plants[which, "lab"]
        reference = under_pd(model, psd)
        row: dict[str, Any] = {"orbit_db": [], "lab_db": [], "compensator_stable": []}
        for level in levels:
            K, L = design(model, psd, level, control)
            for side in ("orbit", "lab"):
                A, D, Z, law = close(model, plants[which, side], K, L)
                loop = None if grows(A) else mean_square(A, D, Z, psd, band)
                row[f"{side}_db"].append(None if loop is None else float(10 * np.log10(loop / reference)))
            row["compensator_stable"].append(not grows(law))
        row["reference_db_lab_pd"] = float(10 * np.log10(under_pd(lab, psd) / reference))
        row["first_instability"] = first_instability(model, lab, psd, control)
        found[which] = row
    return found


def first_instability(model: Plant, lab: Plant, psd: float, control: Sheet) -> dict[str, float] | None:
    """The lowest unstable authority, searched upward in steps and bisected, and which mode leads it."""

    def loop(level: float) -> np.ndarray:
        return close(model, lab, *design(model, psd, level, control))[0]

    level, stable = control["log10_authority_first"], None
    while level <= SEARCH_LAST + 1e-9:
        if grows(loop(level)):
            low, high = stable, level
            while low is not None and high - low > SEARCH_RESOLUTION:
                middle = (low + high) / 2
                low, high = (low, middle) if grows(loop(middle)) else (middle, high)
            return _leader(loop(high), lab.omega, high)
        stable, level = level, level + SEARCH_STEP
    return None


def _leader(A: np.ndarray, omega: np.ndarray, level: float) -> dict[str, float]:
    """Participation |left right| of the growing pole, position and rate of each lab mode together."""
    poles, left, right = sla.eig(A, left=True, right=True)
    k = int(np.argmax(poles.real))
    share = np.abs(left[:, k].conj() * right[:, k])
    n = len(omega)
    modes, law = share[:n] + share[n : 2 * n], share[2 * n :].sum()
    lead = int(modes.argmax())
    return {
        "log10_authority": float(level),
        "frequency_hz": float(abs(poles[k].imag) / 2 / np.pi),
        "mode_frequency_hz": float(omega[lead] / 2 / np.pi),
        "participation": float(modes[lead] / modes.sum()),
        "compensator_share": float(law / (modes.sum() + law)),
    }


def figure_6(solved: Solved, sheet: Sheet) -> dict[str, Any]:
    """Primary gimbal z torque to payload and bus rate, without any loop, at a few frequencies."""
    damping, rigid = sheet["damping"], solved.rigid
    flexible = np.full(len(solved.lab.hz) - rigid, damping["flexible"])
    free = np.hstack([*rigid_basis(solved), solved.orbit.shapes[:, rigid:]])
    sides = {
        "orbit": (solved.orbit, free, np.r_[np.zeros(rigid), flexible]),
        "lab": (solved.lab, solved.lab.shapes, np.r_[np.full(rigid, damping["suspension"]), flexible]),
    }
    found: dict[str, Any] = {"frequency_hz": FIGURE_6_HZ}
    for name, (side, shapes, zeta) in sides.items():
        omega, torque = 2 * np.pi * side.hz, side.rows["pri_rel_z"] @ shapes
        found[name] = {}
        for output in ("pri_in_z", "bus_z"):
            gain = side.rows[output] @ shapes * torque
            lines = 2j * np.pi * np.array(FIGURE_6_HZ)[:, None]
            H = (gain * lines / (lines**2 + 2 * zeta * omega * lines + omega**2)).sum(axis=1)
            found[name][f"{output}_rate"] = [[h.real, h.imag] for h in H]
    return found
