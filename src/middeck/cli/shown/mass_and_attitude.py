"""Mass, size and attitude of an article, as numbers and as lines of text."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from middeck.structure.hanging.attitude import Attitude
from middeck.structure.summary.summary import Summary

# What is left where the terms of a sum cancel is printed as the zero that it stands for.
ROUNDING = 1e-12


def summary_numbers(summary: Summary) -> dict[str, Any]:
    """The summary as keys of a JSON document."""
    slim = summary.slenderness
    return {
        "mass_kg": summary.mass,
        "centre_of_mass_m": summary.centre,
        "inertia_kg_m2": summary.inertia,
        "size_m": summary.size,
        "degrees_of_freedom": summary.coordinates,
        "bending_scale_hz": summary.bending_hz,
        "element_slenderness": None if slim is None else list(slim),
        "rounding": summary.rounding,
    }


def summary_lines(numbers: dict[str, Any]) -> list[str]:
    """Mass, centre of mass, inertia and the rest of a summary in a document, as lines."""
    return [
        f"mass         {numbers['mass_kg']:.6g} kg",
        f"centre       {_row(numbers['centre_of_mass_m'])} m, mass centre, undeformed, x y z",
        *_inertia_lines(numbers["inertia_kg_m2"], " about the mass centre"),
    ]


def _inertia_lines(given: np.ndarray, about: str) -> list[str]:
    inertia = np.asarray(given)
    products = [inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    return [
        f"inertia      {_row(np.diag(inertia))} kg m^2{about}, xx yy zz",
        f"             {_row(products, np.abs(inertia).max())} kg m^2, minus products xy xz yz",
    ]


def about_point(summary: Summary, grid: int, at: np.ndarray) -> dict[str, Any]:
    """Mass and inertia about a grid of a deck (0: the origin), as keys of a JSON document."""
    arm = summary.centre - at
    shift = summary.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return {
        "grid": grid,
        "at_m": at,
        "centre_of_mass_from_it_m": arm,
        "inertia_about_it_kg_m2": summary.inertia + shift,
    }


def about_lines(numbers: dict[str, Any]) -> list[str]:
    """The lines of `about_point`."""
    where = f"grid {numbers['grid']}" if numbers["grid"] else "the origin"
    return [
        f"\nabout {where} (PARAM GRDPNT), in SI and basic axes, WTMASS included:",
        f"centre       {_row(numbers['centre_of_mass_from_it_m'])} m from it, x y z",
        *_inertia_lines(numbers["inertia_about_it_kg_m2"], ""),
    ]


def measure_lines(numbers: dict[str, Any]) -> list[str]:
    """Size, scale of frequency and mesh."""
    bending, slim = numbers["bending_scale_hz"], numbers["element_slenderness"]
    lines = [f"size         {_row(numbers['size_m'])} m, box of nodes and boundary grids of components"]
    if bending is not None:
        lines.append(f"bending      {bending:.2g} Hz as one free uniform beam: roughly, as a check of units")
    mesh = f"mesh         {numbers['degrees_of_freedom']} degrees of freedom"
    if slim is not None:
        mesh += f"; elements {slim[0]:.3g} to {slim[1]:.3g} radii of gyration long"
    return [*lines, mesh]


def _row(values: Sequence[float] | np.ndarray, size: float = 0.0) -> str:
    """Values beside which others may be as large as ``size``."""
    row = np.asarray(values)
    row = np.where(np.abs(row) > ROUNDING * max(np.abs(row).max(), size), row, 0.0)
    return "  ".join(f"{value:.6g}" for value in row)


def attitude_numbers(attitude: Attitude) -> dict[str, Any]:
    """The attitude as keys of a JSON document."""
    node_tilt = np.degrees(attitude.node_tilt) + 0.0
    return {
        "tilt_deg": np.degrees(attitude.tilt) + 0.0,
        "heading_deg": float(np.degrees(attitude.heading)) + 0.0,
        "node_tilt_deg": dict(zip(attitude.node, node_tilt, strict=True)),
        "hangs_from": attitude.hangs_from,
        "lies_off_m": attitude.lies_off + 0.0,
    }


def attitude_lines(numbers: dict[str, Any], label: str = "hangs") -> list[str]:
    """Lines: the tilt of the whole, that of the worst node, and the supports."""
    tilt = numbers["tilt_deg"]
    worst, most = max(
        ((name, float(np.linalg.norm(v))) for name, v in numbers["node_tilt_deg"].items()),
        key=lambda item: item[1],
    )
    off = "  ".join(f"{x:z.4f}" for x in numbers["lies_off_m"])
    return [
        f"{label:<12} tilted {np.linalg.norm(tilt):z.3f} deg: "
        f"{'  '.join(f'{x:z.3f}' for x in tilt)} about x y z; nodes up to {most:z.3f} ({worst})",
        f"             from a {numbers['hangs_from']}; its centre of mass lies {off} m off it",
    ]
