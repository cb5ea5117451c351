"""What the comparison of a study's numbers between machines lets pass, and what it does not."""

import copy
import importlib.util
import json

import pytest

from cli_runner import ROOT

SPEC = importlib.util.spec_from_file_location("compare_numbers", ROOT / ".ci/compare_numbers.py")
compare = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(compare)

FIGURES = {
    "figure_10a": {
        "natural_hz": [7.19, 128.4],
        "natural_hz_deviation": [0.0003, None],
        "delay_s": 0.00998,
        "delay_deviation_s": 6.4e-6,
        "fit": {"frequency_hz": [1.0, 2.0], "re": [5.0, 1e-6], "im": [0.0, 0.0]},
        "zeros": [{"name": "real zero at 6.535 Hz", "frequency_hz": 6.535, "frequency_deviation_hz": 0.86}],
        "claims": [{"claim": "stopped near 9 Hz", "holds": True, "number": 9.03}],
        "predicted_db": -20.123,
        "residual": 3e-13,
    }
}


def with_change(place, value):
    """A copy with one entry changed."""
    found = copy.deepcopy(FIGURES)
    inner = found["figure_10a"]
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    return found


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("natural_hz", 0), 7.19002),  # less than a tenth of its deviation
        (("natural_hz", 1), 42.1),  # not determined by the data
        (("delay_deviation_s",), 6.5e-6),  # two digits
        (("fit", "re", 1), 4e-4),  # nothing beside the largest
        (("zeros", 0, "name"), "real zero at 6.601 Hz"),
        (("zeros", 0, "frequency_hz"), 6.601),
        (("predicted_db",), -20.126),
        (("residual",), 1e-12),
    ],
)
def test_what_is_the_same_to_the_digits_stated(place, value):
    assert compare.differences(FIGURES, with_change(place, value)) == []


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("natural_hz", 0), 7.1912),
        (("natural_hz_deviation", 0), 8.9e-8),
        (("natural_hz_deviation", 1), 2.0e33),
        (("natural_hz",), [7.19]),
        (("fit", "re", 0), 5.002),
        (("zeros", 0, "name"), "pair of zeros at 6.535 Hz"),
        (("claims", 0, "holds"), False),
        (("predicted_db",), None),
        (("predicted_db",), -20.14),
        (("residual",), 1e-6),
        (("more",), 1.0),
    ],
)
def test_what_is_not(place, value, tmp_path, capsys):
    other = with_change(place, value)
    assert len(compare.differences(FIGURES, other)) == 1
    files = [tmp_path / name for name in ("one.json", "same.json", "other.json")]
    for file, figures in zip(files, (FIGURES, FIGURES, other), strict=True):
        file.write_text(json.dumps({"figures": figures}))
    assert compare.main([str(file) for file in files[:2]]) == 0
    assert compare.main([str(file) for file in files]) == 1
    assert f"figure_10a.{place[0]}" in capsys.readouterr().out
