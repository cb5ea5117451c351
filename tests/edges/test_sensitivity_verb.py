"""``middeck sensitivity`` prints what the room computes, and names what it cannot differentiate."""

from __future__ import annotations

import json

import numpy as np
import pytest

import middeck as md
from cli_runner import ROOT, middeck
from middeck.structure.sensitivity.frequencies import differentiate_frequencies
from middeck.structure.sensitivity.parameters import find_parameters
from middeck.structure.sensitivity.rest import differentiate_rest

DM = ROOT / "articles/mace-dm.toml"
LAB = ROOT / "environments/lab.toml"
NAMES = ["joint.pri_z.cg.x", "environment.bounce_hz"]


def test_json_is_the_library(capfd: pytest.CaptureFixture[str]) -> None:
    ended = middeck(capfd, "sensitivity", DM, "--parameter", ",".join(NAMES), "--count", 14, "--json")
    assert (ended.code, ended.err) == (0, "")
    found = json.loads(ended.out)
    article, lab = md.load_case(DM, LAB)
    modes = md.solve_modes(md.solve_equilibrium(article, lab))
    parameters = find_parameters(article, lab, NAMES)
    by_modes = differentiate_frequencies(modes, parameters, 14)
    by_rest = differentiate_rest(modes.equilibrium, parameters)
    assert found["schema"] == "middeck.sensitivity/1"
    assert [p["name"] for p in found["parameters"]] == NAMES
    assert found["frequency_hz"] == modes.frequency_hz[:14].tolist()
    for i, p in enumerate(found["parameters"]):
        # Exact: the same computation in the same process rounds alike.
        assert p["d_lambda"] == by_modes.d_lambda[i].tolist()
        assert p["d_hz"] == by_modes.d_hz[i].tolist()
        assert list(p["d_reactions_n"].values()) == by_rest.reaction[:, i].tolist()
        assert list(p["d_holding_torque_nm"].values()) == by_rest.holding_torque[:, i].tolist()


def test_a_frequency_of_zero_has_no_slope(capfd: pytest.CaptureFixture[str]) -> None:
    ask = ("sensitivity", DM, "--environment", "orbit", "--parameter", "node.n3.mass", "--count", 10)
    found = json.loads(middeck(capfd, *ask, "--json").out)
    by_mass = found["parameters"][0]
    assert by_mass["d_hz"][:8] == [None] * 8
    assert np.all(np.isfinite(np.array(by_mass["d_hz"][8:], dtype=float)))
    assert found["groups"][0] == list(range(8))
    table = middeck(capfd, *ask)
    assert (table.code, table.err) == (0, "")
    assert table.out.count("node.n3.mass") == 2


def test_what_cannot_be_differentiated(capfd: pytest.CaptureFixture[str]) -> None:
    unknown = middeck(capfd, "sensitivity", DM, "--parameter", "node.n1.mas")
    assert unknown.code == 2
    assert "node.n1.mass" in unknown.err
    drives = middeck(
        capfd, "sensitivity", DM, "--environment", "orbit", "--parameter", "environment.gravity.y"
    )
    assert drives.code == 5
    assert "nothing holds" in drives.err
