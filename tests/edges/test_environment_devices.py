"""Devices in environment files: what they describe, and what they must not say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.files.setups import load_environment, load_setup
from middeck.joints.friction import Friction
from middeck.structure.model.environment import DeviceKind
from middeck.structure.rest.equilibrium import solve_equilibrium

ROOT = Path(__file__).parents[2]
DM, LAB = ROOT / "articles/mace-dm.toml", ROOT / "environments/lab.toml"
HEAD = """
schema = 1
name = "hall"
[constants]
gravity_m_s2 = 9.80665
"""
TUNED = """
[[device]]
name = "north"
attach = "n1"
held = "yz"
bounce_hz = 0.25
cable_length_m = 4.0
"""
GIVEN = """
[[device]]
name = "south"
attach = "n1"
kind = "spring"
force_n = 20
stiffness_n_per_m = 5.0
anchor_m = [0.0, 6.0, 0.0]
moving_mass_kg = 0.5
friction_n = 0.1
presliding_m = 1e-4
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "hall.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_devices_as_described(tmp_path: Path) -> None:
    north, south = load_environment(written(tmp_path, HEAD + TUNED + GIVEN)).devices
    assert (north.name, north.attach, north.held) == ("north", "n1", "yz")
    assert (north.kind, north.force) == (DeviceKind.CONSTANT_FORCE, None)
    assert (north.bounce_hz, north.cable_length, north.moving_mass) == (0.25, 4.0, 0.0)
    assert (north.stiffness, north.anchor, north.friction) == (None, None, None)
    assert (south.kind, south.force) == (DeviceKind.SPRING, 20.0)
    assert (south.stiffness, south.moving_mass, south.held) == (5.0, 0.5, "")
    assert south.anchor is not None
    assert south.anchor.tolist() == [0.0, 6.0, 0.0]
    assert south.friction == Friction(0.1, 0.1 / 1e-4)


def test_the_suspension_says_what_its_devices_are() -> None:
    changed = ["device=spring", "moving_mass=0.3", "friction_n=0.2", "presliding=1e-4"]
    environment = load_environment(LAB, [f"suspension.{c}" for c in changed])
    assert [d.name for d in environment.hung] == ["n1", "n3", "n5"]
    for device in environment.hung:
        assert (device.kind, device.moving_mass) == (DeviceKind.SPRING, 0.3)
        assert device.friction == Friction(0.2, 0.2 / 1e-4)
        assert device.cable_length == 4.0


def test_the_same_suspension_written_as_devices(tmp_path: Path) -> None:
    rows = [
        TUNED.replace("north", f"at_{n}").replace('"n1"', f'"{n}"').replace('"yz"', f'"{held}"')
        for n, held in (("n1", "yz"), ("n3", "xyz"), ("n5", "yz"))
    ]
    article, environment = load_setup(DM, written(tmp_path, HEAD + "".join(rows)))
    rest = solve_equilibrium(article, environment)
    plain = solve_equilibrium(*load_setup(DM, LAB))
    assert rest.devices == ("at_n1", "at_n3", "at_n5")
    np.testing.assert_array_equal(rest.tension, plain.tension)  # the same numbers in the same order
    np.testing.assert_array_equal(rest.config.x, plain.config.x)


UNNAMED = """
[[spring]]
attach = "n1"
anchor_m = [0.0, 3.0, 0.0]
stiffness_n_per_m = 9.0
free_length_m = 1.0
"""
BOTH, TWICE = TUNED + GIVEN, UNNAMED + UNNAMED
# Text, what is replaced in it, by what; the key at fault and what is said of it.
BROKEN = [
    (TUNED, "bounce_hz = 0.25", "", "device.0", "needs 'stiffness_n_per_m' or 'bounce_hz'"),
    (TUNED, "cable_length_m = 4.0", "", "device.0", "needs 'cable_length_m' or 'anchor_m'"),
    (TUNED, "held", "stiffness_n_per_m = 3.0\nheld", "device.0.bounce_hz", "instead of 'stiffness_n_per_m'"),
    (TUNED, "held", "anchor_m = [0.0, 1.0, 0.0]\nheld", "device.0.anchor_m", "instead of 'cable_length_m'"),
    (TUNED, 'held = "yz"', "", "device.0", "a tuned device needs 'held'"),
    (TUNED, "held", "force_n = 3.0\nheld", "device.0.held", "is for a tuned device"),
    (GIVEN, "= 20", '= "tuend"', "device.0.force_n", 'must be > 0 or "tuned"'),
    (GIVEN, "= 20", "= -20", "device.0.force_n", 'must be > 0 or "tuned"'),
    (GIVEN, "= 20", "= true", "device.0.force_n", "must be > 0"),
    (GIVEN, "= 20", "= inf", "device.0.force_n", "must be > 0"),
    (GIVEN, '"spring"', '"magnet"', "device.0.kind", '"constant_force" or "spring"'),
    (GIVEN, "presliding_m = 1e-4", "", "device.0.friction_n", "needs 'presliding_m'"),
    (GIVEN, "friction_n = 0.1", "", "device.0.presliding_m", "without 'friction_n'"),
    (GIVEN, "moving_mass_kg", "moving_mass_g", "device.0.moving_mass_g", "in kg"),
    (BOTH, "south", "north", "device.1.name", "names a second device"),
    (TWICE, "[[spring]]", "[[spring]]", "spring.1.attach", "names a second device or spring"),
]


@pytest.mark.parametrize(("text", "old", "new", "key", "reported"), BROKEN)
def test_bad_devices(tmp_path: Path, text: str, old: str, new: str, key: str, reported: str) -> None:
    assert old in text
    path = written(tmp_path, HEAD + text.replace(old, new))
    with pytest.raises(ConfigError) as error:
        load_environment(path)
    (fault,) = error.value.data["faults"]
    assert (fault.file, fault.key) == (str(path), key)
    assert fault.line > 0
    assert reported in fault.message


@pytest.mark.parametrize(
    ("changed", "key", "reported"),
    [
        ("device=string", "suspension.device", "constant_force"),
        ("friction_n=0.1", "suspension.friction_n", "needs 'presliding_m'"),
        ("presliding=0.1", "suspension.presliding_m", "without 'friction_n'"),
        ("moving_mass=-1", "suspension.moving_mass_kg", ">= 0"),
    ],
)
def test_bad_suspensions(changed: str, key: str, reported: str) -> None:
    with pytest.raises(ConfigError) as error:
        load_environment(LAB, [f"suspension.{changed}"])
    (fault,) = error.value.data["faults"]
    assert fault.key == key
    assert reported in fault.message


def test_a_spring_that_would_be_longer_than_its_cable() -> None:
    with pytest.raises(ConfigError, match=r"stretches by 3.974 m: no free length is left") as error:
        load_environment(LAB, ["suspension.device=spring", "suspension.cable_length=3.9"])
    (fault,) = error.value.data["faults"]
    assert fault.key == "suspension.cable_length_m"
    assert load_environment(LAB, ["suspension.cable_length=3.9"]).suspension is not None


def test_without_gravity_nothing_can_be_tuned(tmp_path: Path) -> None:
    weightless = HEAD.replace("9.80665", "0.0")
    with pytest.raises(ConfigError, match="means nothing without gravity"):
        load_environment(written(tmp_path, weightless + TUNED))
    assert len(load_environment(written(tmp_path, weightless + GIVEN)).devices) == 1


def test_a_device_at_no_attach_point(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="'dm' has no attach point 'n11'"):
        load_setup(DM, written(tmp_path, HEAD + TUNED.replace('"n1"', '"n11"')))


@pytest.mark.parametrize("text", ["device = 3\n", "device = [3, {}]\n", 'spring = [{attach = ["a"]}]\n'])
def test_junk_for_devices_ends_in_words(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError) as error:
        load_environment(written(tmp_path, text + HEAD))
    assert all(fault.message for fault in error.value.data["faults"])
