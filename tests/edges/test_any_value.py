"""``md.write``: the kind of a value finds the writer, and what was written is read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import middeck as md
from middeck.errors import ConfigError

FORCE, WAY = md.Port("force", "N"), md.Port("way", "m")
LAG = md.systems.StateSpace([[-2.0]], [[1.0]], [[3.0]], [[0.0]])
LAW = md.Compensator(LAG, (WAY,), (FORCE,))
PLANT = md.Plant(dynamics=LAG, inputs=(FORCE,), outputs=(WAY,), state_names=("lag",))
SAMPLES = np.arange(4.0).reshape(1, 1, 4, 1)
RECORD = md.Record(u=SAMPLES, y=SAMPLES, sample_hz=8.0, inputs=(FORCE,), outputs=(WAY,), periodic=False)
TEST = md.MeasuredModes(
    frequency_hz=[1.0], damping=[0.01], node=("a", "b"), direction=("x", "x"), shape=[[1.0], [0.5]]
)


@pytest.mark.parametrize(
    ("name", "value", "read"),
    [
        ("record.npz", RECORD, lambda path: md.load_record(path)),
        ("plant.mat", PLANT, lambda path: md.files.load_mat(path)),
        ("test.json", TEST, lambda path: md.load_measured_modes(path)),
    ],
)
def test_what_is_written_is_read_back(tmp_path: Path, name, value, read):
    md.write(tmp_path / name, value)
    assert read(tmp_path / name) == value


@pytest.mark.parametrize("name", ["law.json", "law.mat"])
def test_a_compensator_is_written_by_its_ending(tmp_path: Path, name: str):
    md.write(tmp_path / name, LAW)
    found = (md.load_compensator if name == "law.json" else md.files.load_mat)(tmp_path / name)
    assert found.system == LAW.system
    assert (found.inputs, found.outputs) == (LAW.inputs, LAW.outputs)


def test_a_package_and_its_c(tmp_path: Path):
    package = md.package_law(md.emulate(LAW, 0.01), "lag", input_range=1.0, limit=1.0)
    for name in ("lag.mdk", "lag.c"):
        md.write(tmp_path / name, package)
    assert md.load_package(tmp_path / "lag.mdk") == package
    assert (tmp_path / "lag.h").exists()


def test_no_file_holds_everything(tmp_path: Path):
    with pytest.raises(ConfigError, match="no file holds a dict"):
        md.write(tmp_path / "x.json", {})
    with pytest.raises(ConfigError, match=r"no writer for a Plant in '\.json' files"):
        md.write(tmp_path / "plant.json", PLANT)
    assert not list(tmp_path.iterdir())
