"""A wild sample of an input that drives an article is a spike; the blow of a hammer is none."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import lfilter

from middeck.identification.faults.detect import detect_faults
from middeck.signals.ports import Port
from middeck.signals.record import Record


def a_record(u, seed, *, read=None):
    """Two outputs of two modes, noise of 1 %; the force as it is, or as it was ``read``."""
    rng = np.random.default_rng([71, seed])
    omega, zeta = 2.0 * np.pi * rng.uniform(0.02, 0.2, 2), rng.uniform(0.003, 0.03, 2)
    z = np.exp(omega * (1j * np.sqrt(1.0 - zeta**2) - zeta))
    c = rng.standard_normal((2, 2)) + 1j * rng.standard_normal((2, 2))
    y = 2.0 * np.real(c @ np.array([lfilter([0.0, 1.0], [1.0, -pole], u) for pole in z]))
    y += 1e-2 * y.std(axis=1, keepdims=True) * rng.standard_normal(y.shape)
    u = u if read is None else read
    ports = (Port("force", "N"),), (Port("a", "m"), Port("b", "m"))
    return Record(
        sample_hz=100.0,
        u=u[None, None, :, None],
        y=y.T[None, None],
        inputs=ports[0],
        outputs=ports[1],
        periodic=False,
    )


def a_drive(kind, rng, count):
    if kind == "noise":
        return rng.standard_normal(count)
    if kind == "sweep":
        return np.sin(2.0 * np.pi * np.cumsum(np.geomspace(0.01, 0.3, count)))
    lines = np.zeros(count // 2 + 1, dtype=complex)
    lines[2 : count // 4] = np.exp(2j * np.pi * rng.random(count // 4 - 2))
    u = np.fft.irfft(lines, count)
    return u / u.std()


@pytest.mark.parametrize("kind", ["noise", "sweep", "multisine"])
def test_a_wild_sample_of_an_input_is_a_spike_at_the_ends_too(kind, campaign):
    """It was taken for a hammer's blow, so that no channel of the record was searched."""
    seeds, named = campaign(60, 6), 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        u = a_drive(kind, rng, 1000)
        at = int(rng.choice([*range(13), 500, *range(986, 1000)]))
        read = u.copy()
        read[at] += rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(1.9, 3.0) * u.std()
        assert not [f for f in detect_faults(a_record(u, seed)) if f.kind == "spike"]
        found = detect_faults(a_record(u, seed, read=read))
        named += any(
            f.kind == "spike" and f.channel == "force" and f.samples == ((at, at + 1),) for f in found
        )
    assert named >= 0.8 * len(seeds)


@pytest.mark.parametrize("width", [1, 4])
def test_blows_of_a_hammer_are_none(width, campaign):
    """Noise of the force between them moves nothing, and the outputs follow the blows."""
    for seed in campaign(100):
        rng = np.random.default_rng(seed)
        u = np.zeros(2000)
        for start in rng.integers(0, 1990, int(rng.choice([1, 2, 10]))):
            u[start : start + width] += rng.uniform(0.5, 1.5)
        read = u + 10.0 ** rng.uniform(-5.0, -2.0) * rng.standard_normal(2000)
        assert not [f for f in detect_faults(a_record(u, seed, read=read)) if f.kind == "spike"]


def beside_a_shaker(force, read, seed):
    """The record of a force, as it was ``read``, while a shaker moves both outputs as much."""
    rng = np.random.default_rng([72, seed])
    shaker = rng.standard_normal(len(force))
    own, other = a_record(force, seed, read=read), a_record(shaker, seed + 1000)
    return dataclasses.replace(
        own,
        u=np.concatenate([own.u, other.u], axis=3),
        y=own.y / own.y.std() + other.y / other.y.std(),
        inputs=(*own.inputs, Port("shaker", "N")),
    )


def test_a_wild_sample_is_a_spike_where_another_input_drives_too(campaign):
    """What the other input did was taken for noise, and the spike for a blow: 11 of 60 passed in silence."""
    seeds, named = campaign(60, 10), 0
    for seed in seeds:
        rng = np.random.default_rng([73, seed])
        force, at = rng.standard_normal(1000), int(rng.integers(20, 980))
        read = force.copy()
        read[at] += rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(1.9, 3.0)
        found = detect_faults(beside_a_shaker(force, read, seed))
        named += any(f.kind == "spike" and f.channel == "force" for f in found)
    assert named >= 0.95 * len(seeds)


def test_blows_beside_a_shaker_are_none(campaign):
    for seed in campaign(60, 20):
        rng = np.random.default_rng([74, seed])
        force = np.zeros(1000)
        for start in rng.integers(0, 990, int(rng.choice([1, 2, 10]))):
            force[start : start + 2] += rng.uniform(0.5, 1.5)
        read = force + 10.0 ** rng.uniform(-5.0, -2.0) * rng.standard_normal(1000)
        assert not [f for f in detect_faults(beside_a_shaker(force, read, seed)) if f.kind == "spike"]


def test_a_wild_sample_is_a_spike_beside_the_command_of_its_input(campaign):
    """The command told as much of the outputs, and the spike was taken for a blow: all passed in silence."""
    for seed in campaign(40, 5):
        rng = np.random.default_rng([75, seed])
        force, at = rng.standard_normal(1000), int(rng.integers(20, 980))
        read = force.copy()
        read[at] += rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(1.9, 3.0)
        own, command = a_record(force, seed, read=read), a_record(2.0 * force, seed)
        both = dataclasses.replace(
            own, u=np.concatenate([own.u, command.u], axis=3), inputs=(*own.inputs, Port("command", "V"))
        )
        assert [f.channel for f in detect_faults(both) if f.kind == "spike"] == ["force"], seed


def test_blows_that_a_shaker_disturbs_are_none(campaign):
    """Crosstalk of the shaker predicts the outputs between the blows; these move them all the same."""
    for seed in campaign(60, 5):
        rng = np.random.default_rng([76, seed])
        force, shaker = np.zeros(1000), np.random.default_rng([72, seed]).standard_normal(1000)
        for start in rng.integers(0, 990, int(rng.choice([1, 2, 10]))):
            force[start : start + 2] += rng.uniform(0.5, 1.5)
        read = force + 1e-4 * rng.standard_normal(1000) + rng.choice([1e-3, 1e-2, 5e-2]) * shaker
        assert not [f for f in detect_faults(beside_a_shaker(force, read, seed)) if f.kind == "spike"]
