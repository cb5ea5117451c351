"""The simple MACE article with its bus reduced, its gimbals and cables as they are, beside the whole one."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import middeck as md
from coarse_articles import coarse
from middeck.structure.modes.motions.left_out_stiffness import left_out

KEPT = ("n1", "n3", "n5")  # those of gimbals and cables


@pytest.fixture(scope="module")
def articles() -> tuple[md.Structure, md.Structure, md.Environment]:
    """The article whole and reduced, and the laboratory."""
    whole, lab = md.load_setup(coarse("mace-simple"), "environments/lab.toml")
    bus = dataclasses.replace(whole, joints=(), actuators=(), sensors=(), attach_points=())
    part = md.reduce_structure(bus, list(KEPT), count=30, name="bus").component
    bare = [dataclasses.replace(n, body=dataclasses.replace(n.body, mass=0.0, inertia=np.zeros((3, 3))))
            for n in whole.nodes if n.name in KEPT]  # fmt: skip
    return whole, dataclasses.replace(whole, nodes=tuple(bare), members=(), components=(part,)), lab


def modes_of(articles: tuple[md.Structure, md.Structure], where: md.Environment) -> list[md.Modes]:
    return [md.solve_modes(md.solve_equilibrium(a, where), 26) for a in articles]


def test_in_orbit_modes_of_the_reduced_bus_are_those_of_the_whole(
    articles: tuple[md.Structure, md.Structure, md.Environment],
) -> None:
    whole, reduced = modes_of(articles[:2], md.Environment.orbit())
    assert reduced.warnings == ()
    assert whole.kind == reduced.kind
    assert whole.kind[:10] == ("rigid",) * 10  # of the whole and of four gimbal axes
    ratio = reduced.frequency_hz[10:] / whole.frequency_hz[10:]
    assert -1e-9 < ratio.min() - 1.0 < ratio.max() - 1.0 < 2e-5  # from above, as Rayleigh and Ritz have it


def test_on_its_cables_it_is_off_by_no_more_than_is_reported(
    articles: tuple[md.Structure, md.Structure, md.Environment],
) -> None:
    """The component has no geometric stiffness: the estimate of each mode covers it, and is told."""
    whole, reduced = modes_of(articles[:2], articles[2])
    error = np.abs(reduced.frequency_hz / whole.frequency_hz - 1.0)
    cost = left_out(reduced.equilibrium, reduced.omega**2, reduced.shapes)[0]
    assert np.all(error < cost)
    assert error.max() > 1e-3
    (warning,) = reduced.warnings
    worst = int(cost.argmax())
    assert warning.startswith("component 'bus' has no geometric stiffness")
    assert warning.endswith(
        f"mode {worst} ({reduced.frequency_hz[worst]:.4g} Hz) by up to {100.0 * cost[worst]:.2g} %"
    )
