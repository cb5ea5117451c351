"""The figure of a static response shows what its table says."""

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from cli_runner import middeck
from middeck.systems.plants.response import FrequencyResponse

ROOT = Path(__file__).parents[2]
ASKED = (
    "response", ROOT / "articles/mace-dm.toml", "--environment", "lab", "--input", "pri_rel_z",
    "--output", "pri_in_z_rate", "--at", "5,20", "--count", "16", "--json",
)  # fmt: skip


@pytest.mark.parametrize("static", [(), ("--static",)])
def test_the_curve_passes_through_the_table(
    static: tuple[str, ...],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
):
    drawn: list[FrequencyResponse] = []

    def draw(lines: FrequencyResponse, asked: FrequencyResponse, _: str) -> Figure:
        drawn.extend((lines, asked))
        return Figure()

    monkeypatch.setattr("middeck.plot.response.response_figure", draw)
    ended = middeck(capfd, *ASKED, *static, "--figure", tmp_path / "a.svg")
    assert ended.code == 0, ended.err
    (table,) = json.loads(ended.out)["responses"]
    reported = np.abs(np.array(table["re"]) + 1j * np.array(table["im"]))
    lines, asked = (np.abs(r.H[:, 0, 0]) for r in drawn)
    np.testing.assert_allclose(asked, reported, rtol=1e-12)
    curve = np.interp([5.0, 20.0], drawn[0].frequency_hz, lines)
    np.testing.assert_allclose(curve, reported, rtol=0.02)
