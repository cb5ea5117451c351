"""Numbers in another unit are doubted, numbers that somebody could have built are not."""

from __future__ import annotations

import copy
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from random_articles import draw_article, write_tables

from middeck.errors import ConfigError
from middeck.files.setups import load_setup, load_structure
from middeck.structure.model.article_checks import check_structure
from middeck.structure.model.environment import AnchoredSpring, Device
from middeck.structure.summary.environment_plausibility import warnings_on_environment
from middeck.structure.summary.summary import summarise
from structure_builders import TUBE, body, member, node, structure

MASSES = (("node", "mass_kg"), ("revolute", "mass_kg"), ("gimbal", "payload_mass_kg"))
INERTIAS = tuple((table, key.replace("mass_kg", "inertia_kg_m2")) for table, key in MASSES)
DIAMETERS = (("section", "outer_diameter_m"), ("section", "inner_diameter_m"))
# Where each slip is never missed; a rough number of others is as plausible as what was meant.
SLIPS = {
    "rho in g/cm3": ((("material", "rho_kg_m3"),), 1e-3),
    "E in GPa": ((("material", "E_pa"),), 1e-9),
    "E in MPa": ((("material", "E_pa"),), 1e-6),
    "diameters in mm": (DIAMETERS, 1e3),
    "positions in mm": ((("node", "x_m"), ("node", "y_m")), 1e3),
    "masses in g": (MASSES, 1e3),
    "masses in t": (MASSES, 1e-3),
    "masses and inertias in g": (MASSES + INERTIAS, 1e3),
    "inertias in kg mm2": (INERTIAS, 1e6),
    "inertias in kg cm2": (INERTIAS, 1e4),
}


def slipped(tables: dict[str, Any], places: tuple[tuple[str, str], ...], factor: float) -> dict[str, Any]:
    tables = copy.deepcopy(tables)
    for table, key in places:
        entries = tables.get(table, [])
        for entry in entries.values() if isinstance(entries, dict) else entries:
            if key in entry:
                entry[key] = (np.array(entry[key]) * factor).tolist()
    return tables


def doubts(tables: dict[str, Any], folder: Path) -> tuple[str, ...]:
    return summarise(load_structure(str(write_tables(tables, folder / "drawn.toml")))).warnings


@pytest.mark.parametrize("seed", range(6))
def test_what_could_be_built_is_not_doubted_and_every_slip_is(seed: int, tmp_path: Path):
    tables = draw_article(np.random.default_rng(seed))
    assert doubts(tables, tmp_path) == ()
    silent = [name for name, slip in SLIPS.items() if not doubts(slipped(tables, *slip), tmp_path)]
    assert silent == []


def test_a_heavy_node_is_doubted_whatever_its_inertia(tmp_path: Path):
    """6 t where 6 kg were meant: beside its inertia, with an inertia in the same unit, and as a point."""
    for seed in range(4):
        tables = draw_article(np.random.default_rng(seed))
        heavy = copy.deepcopy(tables)
        heavy["node"][0]["mass_kg"] *= 1e3
        both = copy.deepcopy(heavy)
        both["node"][0]["inertia_kg_m2"] = [1e3 * x for x in both["node"][0]["inertia_kg_m2"]]
        point = copy.deepcopy(heavy)
        del point["node"][0]["inertia_kg_m2"]
        for wrong in (heavy, both, point):
            name = repr(wrong["node"][0]["name"])
            assert any(name in text and "kg" in text for text in doubts(wrong, tmp_path))


def test_a_node_at_the_place_of_another_is_not_doubted(tmp_path: Path):
    """What a link ties together there may be a point with a mass."""
    tables = draw_article(np.random.default_rng(0))
    twin = tables["node"][0] | {"name": "twin", "mass_kg": 0.1}
    twin.pop("inertia_kg_m2", None)
    tables["node"].append(twin)
    tables["link"] = [{"from": tables["node"][0]["name"], "to": "twin", "about": ""}]
    assert doubts(tables, tmp_path) == ()
    twin["mass_kg"] = 1e4
    assert any("'twin'" in text for text in doubts(tables, tmp_path))


def test_environments_in_other_units_are_doubted():
    parts, lab = load_setup("articles/mace-simple.toml", "environments/lab.toml")
    assert warnings_on_environment(parts, lab) == ()
    assert lab.suspension is not None
    changed = [
        dataclasses.replace(lab, gravity=lab.gravity / 0.3048),
        dataclasses.replace(lab, gravity=lab.gravity * 1e3),
        dataclasses.replace(lab, suspension=dataclasses.replace(lab.suspension, cable_length=4000.0)),
        dataclasses.replace(
            lab, devices=(Device(name="d", attach="n1", force=1e6, stiffness=100.0, cable_length=4.0),)
        ),
        dataclasses.replace(
            lab,
            springs=(
                AnchoredSpring(
                    name="s", attach="n1", anchor=np.array([0, 4.0, 0]), stiffness=1e-4, free_length=3.0
                ),
            ),
        ),
    ]
    for environment in changed:
        warnings = warnings_on_environment(parts, environment)
        assert warnings
        assert all("?" in text for text in warnings)


def test_an_inertia_that_no_body_has_is_refused_unless_it_leaves_rotors_out():
    """Principal values count, products of inertia included; a plate meets the inequality with equality."""
    turn = np.linalg.qr(np.random.default_rng(5).standard_normal((3, 3)))[0]
    for moments, possible in (((1.0, 1.0, 2.0), True), ((1.0, 1.0, 2.1), False), ((0.3, 2.1, 2.0), True)):
        inertia = turn @ np.diag(moments) @ turn.T
        own = dataclasses.replace(body(3.0), inertia=0.5 * (inertia + inertia.T))
        parts = structure([node("hub", (0, 0, 0), own)])
        if possible:
            check_structure(parts)
        else:
            with pytest.raises(ConfigError, match=r"'hub' .* 1 \+ 1 < 2\.1 kg m\^2 .* rotors_excluded"):
                check_structure(parts)
        check_structure(structure([node("hub", (0, 0, 0), dataclasses.replace(own, rotors_excluded=True))]))


@pytest.mark.parametrize("ties", [0, 7, 8, 100])
def test_the_next_node_is_found_behind_all_that_stands_in_one_place(ties: int) -> None:
    """0.5 (m / 8000)^(1/3) m reaches past 0.2 m; nodes that are tied to it there are no neighbours."""
    heavy = node("heavy", (0.0, 0.0, 0.0), body(2000.0))
    others = [node(f"tie{i}", (0.0, 0.0, 0.0)) for i in range(ties)]
    near = [*others, heavy, node("next", (0.0, 0.2, 0.0))]
    far = node("far", (0.9, 0.0, 0.0))
    article = structure([*near, far], [member(n.name, "far", TUBE, 1, (0.0, 0.0, 1.0)) for n in near])
    (warning,) = [w for w in summarise(article).warnings if "steel" in w]
    assert "would reach past the next node, 0.2 m away" in warning
