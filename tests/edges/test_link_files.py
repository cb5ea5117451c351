"""Links, interpolations and equations in files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.files.setups import load_structure
from middeck.structure.model.links import Equation, Interpolation, Link

NODES = """\
schema = 1
name = "frame"
node = [{name = "a", x_m = 0.0}, {name = "b", x_m = 1.0}, {name = "c", x_m = 0.0, y_m = 1.0}]
[[revolute]]
name = "arm"
parent = "a"
axis = [0.0, 0.0, 1.0]
mass_kg = 0.1
inertia_kg_m2 = [0.1, 0.1, 0.1]
state = "hinged"
"""
LINK = """\
[[link]]
from = "arm"
to = "b"
along = "xz"
about = "x"
offset_m = [0.0, 0.1, 0.0]
x_axis = [0.0, 2.0, 0.0]
y_axis = [1.0, 1.0, 0.0]
"""
MEAN = """\
[[interpolation]]
frame = "c"
about = ""
[[interpolation.follows]]
frame = "a"
about = "xyz"
[[interpolation.follows]]
frame = "b"
weight = 2.0
along = "z"
x_axis = [0.0, 1.0, 0.0]
y_axis = [1.0, 0.0, 0.0]
"""
GEAR = """\
[[equation]]
name = "gear"
term = [{frame = "arm", direction = "angle", coefficient = 2.0},
    {frame = "b", direction = "rz", coefficient = -1.0}]
"""


def load(folder: Path, *parts: str):
    path = folder / "frame.toml"
    path.write_text(NODES + "".join(parts))
    return load_structure(path)


def test_links_are_read_as_they_are_written(tmp_path: Path) -> None:
    link, mean, gear = load(tmp_path, LINK, MEAN, GEAR).links
    assert isinstance(link, Link)
    assert (link.name, link.first, link.second, link.along, link.about) == ("arm-b", "arm", "b", "xz", "x")
    np.testing.assert_allclose(link.axes, [[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    np.testing.assert_array_equal(link.offset, [0.0, 0.1, 0.0])
    assert isinstance(mean, Interpolation)
    assert (mean.name, mean.frame, mean.about) == ("interpolation_c", "c", "")
    assert [(s.frame, s.weight, s.along, s.about) for s in mean.shares] == [
        ("a", 1.0, "xyz", "xyz"),
        ("b", 2.0, "z", ""),
    ]
    np.testing.assert_allclose(mean.shares[1].axes, [[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    assert isinstance(gear, Equation)
    terms = [(t.frame, t.direction, t.coefficient) for t in gear.terms]
    assert terms == [("arm", "angle", 2.0), ("b", "rz", -1.0)]


@pytest.mark.parametrize(
    ("old", "new", "message", "line"),
    [
        ('from = "arm"', 'from = "arn"', "no frame of this name", 12),
        ('along = "xz"', 'along = "xx"', "must be x, y, z", 14),
        ('about = "x"', 'about = "x"\nstiffness = 1.0', "stiffness", 16),
        ('to = "b"', 'to = "arm"', "names a frame twice", 11),
        ("y_axis = [1.0, 1.0, 0.0]", "y_axis = [0.0, 1.0, 0.0]", "make no plane", 11),
        ('frame = "a"', 'frame = "q"', "no frame of this name", 23),
        ("weight = 2.0", "weight = 0.0", "0.0: must be", 27),
        ('name = "gear"', 'name = "arm-b"', "a second link of this name", 32),
        ("coefficient = -1.0", 'coefficient = "one"', "coefficient", 34),
        ('{frame = "arm", direction = "angle"', '{frame = "a", direction = "angle"', "no joint", 31),
    ],
)
def test_a_fault_of_a_link_is_named_with_its_line(
    tmp_path: Path, old: str, new: str, message: str, line: int
) -> None:
    text = (LINK + MEAN + GEAR).replace(old, new, 1)
    with pytest.raises(ConfigError, match=message) as caught:
        load(tmp_path, text)
    assert f"frame.toml:{line}" in str(caught.value)


def test_nodes_that_nothing_ties_are_still_found(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no strut, spring or link joins it"):
        load(tmp_path, LINK)
