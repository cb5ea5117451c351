"""`middeck identify --friction`: found, taken out, and said; refused where records cannot tell it."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from cli_runner import middeck, share_results
from middeck.files.measured.models import load_standing
from middeck.files.records import write_record
from middeck.joints.attachment import JointElements
from rubbing_joint import BEARING, HZ, records

ASKED = ("--band", "0.2,10", "--states", "6", "--friction", "joint=joint")


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rig") / "rubbing.npz"
    write_record(path, records([JointElements("joint", "joint", (BEARING,))]))
    return path


def test_friction_is_found_and_reported(
    taken: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    share_results(monkeypatch)  # fitted once, shown twice
    model = tmp_path / "model.json"
    ended = middeck(capfd, "identify", taken, *ASKED, "-o", model, "--json")
    assert ended.code == 0, ended.err
    found = json.loads(ended.out)
    assert found["friction"]["input"] == ["joint"]
    assert found["friction"]["slip_torque"][0] == pytest.approx(BEARING.slip_torque, rel=0.01)
    assert found["friction"]["variance_after"] < 1.3 < found["friction"]["variance_before"]
    np.testing.assert_allclose(sorted(found["frequency_hz"]), HZ, rtol=1e-4)
    assert set(load_standing(model)) == {"sound"}
    table = middeck(capfd, "identify", taken, *ASKED)
    assert "friction, taken out" in table.out
    assert "times the noise before" in table.out


def test_what_cannot_tell_it_is_refused(taken: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    whole = records([])
    few = tmp_path / "few.npz"
    write_record(few, dataclasses.replace(whole, u=whole.u[:2], y=whole.y[:2]))
    ended = middeck(capfd, "identify", few, *ASKED)
    assert ended.code == 4
    assert "2 experiments for 2 inputs" in ended.err
    ended = middeck(capfd, "identify", taken, *ASKED, "--method", "samples")
    assert ended.code == 2
    assert "open-loop records" in ended.err
    ended = middeck(capfd, "identify", taken, "--friction", "elbow")
    assert ended.code == 2
    assert "elbow" in ended.err
