"""Each hidden error of a rig's article acts where it should, by as much as it should, and there only."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from middeck.files.setups import load_structure
from middeck.files.studies.documents import load_study
from middeck.laboratory.article_rig import build_article_rig, rig_delay
from middeck.laboratory.hidden_errors import hide_in_structure
from middeck.laboratory.rig.linear_view import linearise_rig
from middeck.laboratory.tested_article import RigArticle, solve_rig_article
from middeck.systems.plants.response import statespace_response
from rig_checks import hidden

ROOT = Path(__file__).resolve().parents[2]
PORTS = {"inputs": ("pri_rel_z",), "outputs": ("pri_in_z", "pri_rel_z")}


def on_rig(structure, environment, **changes):
    return solve_rig_article(structure, environment, hidden(**changes), mesh_factor=1, shear=None)


def test_a_strut_bends_more_and_does_nothing_else(dm):
    name = dm.members[1].name
    soft = hide_in_structure(dm, hidden(strut=((name, 0.95),)))
    for before, after in zip(dm.members, soft.members, strict=True):
        factor = 0.95 if before.name == name else 1.0
        expected = dataclasses.replace(
            before.section, EI_y=factor * before.section.EI_y, EI_z=factor * before.section.EI_z
        )
        assert after == dataclasses.replace(before, section=expected)


def test_masses_and_principal_inertias_of_nodes_and_payloads(dm):
    turned = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    slanted = turned @ np.diag([0.1, 0.2, 0.4]) @ turned.T
    nodes = [
        dataclasses.replace(n, body=dataclasses.replace(n.body, inertia=slanted)) if n.name == "n3" else n
        for n in dm.nodes
    ]
    article = dataclasses.replace(dm, nodes=tuple(nodes))
    wrong = hide_in_structure(
        article,
        hidden(
            mass=(("n1", 1.05),), inertia=(("n3", (1.1, 0.9, 1.05)),),
            payload_inertia=(("pri_z", (0.9, 1.1, 1.0)),), payload_cg=(("pri_z", 1.1),),
        ),
    )  # fmt: skip
    old, new = ({x.name: x.body for x in (*s.nodes, *s.joints)} for s in (article, wrong))
    assert new["n1"].mass == pytest.approx(1.05 * old["n1"].mass, rel=1e-15)
    assert np.array_equal(new["n1"].inertia, old["n1"].inertia)
    np.testing.assert_allclose(
        new["n3"].inertia, turned @ np.diag([0.11, 0.18, 0.42]) @ turned.T, rtol=0.0, atol=1e-15
    )
    np.testing.assert_allclose(
        np.diag(new["pri_z"].inertia), [0.9, 1.1, 1.0] * np.diag(old["pri_z"].inertia), rtol=1e-15
    )
    np.testing.assert_allclose(new["pri_z"].cg, 1.1 * old["pri_z"].cg, rtol=1e-15)
    assert new["pri_z"].mass == old["pri_z"].mass
    assert wrong.mass == pytest.approx(article.mass + 0.05 * old["n1"].mass, rel=1e-15)
    touched = {"n1", "n3", "pri_z"}
    assert {name for name in old if old[name] != new[name]} == touched


def test_the_suspension_is_stiffer_and_longer(dm, lab):
    """Bounce goes with its factor; a pendulum of 4 m with the root of its length."""

    def hung(**changes):
        modes = on_rig(dm, lab, **changes).modes
        kind = dict(zip(modes.name, modes.frequency_hz, strict=True))
        return [next(hz for name, hz in kind.items() if word in name) for word in ("bounce", "pendulum")]

    plain, stiff, long = hung(), hung(bounce=1.1), hung(cable_length=1.05)
    # Bounce and tilt share their springs, the pendulum of the article that of the payload: not to rounding.
    assert stiff[0] / plain[0] == pytest.approx(1.1, rel=5e-3)
    assert stiff[1] / plain[1] == pytest.approx(1.0, rel=2e-2)
    assert long[1] / plain[1] == pytest.approx(1.05**-0.5, rel=2e-2)
    assert long[0] / plain[0] == pytest.approx(1.0, rel=5e-3)


def test_a_payload_further_out_is_heavier_to_hold(lab):
    simple = load_structure(ROOT / "articles" / "mace-simple.toml")
    at = [joint.name for joint in simple.joints].index("pri_x")
    hung = [on_rig(simple, lab, payload_cg=cg) for cg in ((), (("pri_z", 1.1),))]
    held = [article.equilibrium.holding_torque[at] for article in hung]
    # The article rolls a little further under it.
    assert held[1] / held[0] == pytest.approx(1.1, rel=0.02)


def test_delay_and_gains_turn_and_scale_the_response(dm, lab):
    settings = load_study(ROOT / "studies" / "mace-1993.toml").rig
    hz = np.array([0.5, 5.0, 30.0])
    article = on_rig(dm, lab)

    def response(**changes):
        wrong = RigArticle(article.equilibrium, article.modes, hidden(**changes))
        rig = build_article_rig(wrong, settings, **PORTS)
        return statespace_response(linearise_rig(rig).sampled, 2.0 * np.pi * hz)[:, :, 0]

    plain, delayed = response(), response(delay_s=8e-4)
    # A part of a tick, exactly; only what a held command folds from beyond 250 Hz is not of the response.
    np.testing.assert_allclose(
        delayed / plain, np.exp(-2j * np.pi * hz * 8e-4)[:, None] * [1.0, 1.0], atol=2e-3
    )
    drifted = RigArticle(article.equilibrium, article.modes, hidden(delay_s=8e-4))
    assert rig_delay(drifted, settings) == pytest.approx(settings.delay_s + 8e-4, rel=1e-12)
    gained = response(gain=(("pri_in_z", 1.02), ("pri_rel_z", 0.98)))
    np.testing.assert_allclose(gained / plain, np.tile([1.02, 0.98], (3, 1)), rtol=1e-9)
