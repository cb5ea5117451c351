"""``middeck design`` on an article that nothing holds, at one torque and one angle about a slanted axis."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cli_runner import middeck

ROD = """\
schema = 1
name = "rod"
node = [
  {name = "a", x_m = 0.0, mass_kg = 2.0, inertia_kg_m2 = [0.1, 0.1, 0.1]},
  {name = "b", x_m = 1.0, mass_kg = 1.0},
]
strut = [{section = "tube", from = "a", to = "b", elements = 12}]
actuator = [{name = "wheel", frame = "a", axis = [0.0, 0.6, 0.8]}]
sensor = [{name = "star", frame = "a", axis = [0.0, 0.6, 0.8]}]
[section.tube]
EA_n = 1e6
GJ_nm2 = 80.0
EI_y_nm2 = 100.0
EI_z_nm2 = 100.0
rho_A_kg_per_m = 0.5
rho_I_y_kg_m = 1e-5
rho_I_z_kg_m = 1e-5
"""
ASKED = ("--environment", "orbit", "--count", "10", "--json")


def test_the_rms_says_that_its_band_leaves_the_rigid_mode_out(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Above it the compensator gains nothing; from 0.05 Hz on it takes away what the rotation adds."""
    article = tmp_path / "rod.toml"
    article.write_text(ROD)
    above, below = (
        json.loads(middeck(capfd, "design", article, *ASKED, *band).out)
        for band in ((), ("--band", "0.05,80"))
    )
    reported = [[w for w in found["warnings"] if "rigid mode" in w] for found in (above, below)]
    assert [len(texts) for texts in reported] == [1, 0]
    assert "begins at 4.48 Hz, above 1 rigid mode, whose rms" in reported[0][0]
    assert above["db"]["star"] == pytest.approx(0.0, abs=0.1)
    assert below["db"]["star"] < -10.0
    assert [name.split()[0] for name in above["inert"]] == ["translation"] * 3 + ["rotation", "a"]


def test_laws_on_a_free_article_are_compared_by_their_rms(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Its own rms is infinite, and every decibel would be minus infinity."""
    article, law = tmp_path / "rod.toml", tmp_path / "law.json"
    article.write_text(ROD)
    designed = json.loads(middeck(capfd, "design", article, *ASKED, "--band", "0.05,80", "-o", law).out)
    found = json.loads(middeck(capfd, "qualify", law, article, *ASKED).out)
    (row,) = found["rows"]
    assert (row["stable"], row["db"]) == (True, None)
    # All frequencies, of which the band of the design holds most.
    assert 1.0 < row["rms"] / designed["rms_closed"]["star"] < 1.1
    assert [text for text in found["warnings"] if "compare the rms itself" in text]
