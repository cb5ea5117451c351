"""Verdicts on the law of a package in mixed states: right, or said to be open."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as sla
from test_verdicts_in_mixed_states import _mixed

from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError
from middeck.realtime.package.package_law import package_law
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from plant_builders import FORCE, WAY
from repeats import repeats

pytestmark = pytest.mark.kernels


def _packed(law: Compensator) -> tuple[bool, str]:
    """Whether the law is packed undeclared, else why not."""
    try:
        return bool(package_law(law, "mixed")), ""
    except ConfigError as error:
        return False, str(error)


@pytest.mark.parametrize("seed", repeats(range(40), 6))
def test_no_law_that_rounding_may_make_unstable_is_packed_undeclared(seed: int) -> None:
    """At 1e8 four laws of forty with a pole outside the circle were taken for stable."""
    rng = np.random.default_rng([81, seed])
    slow = 1.0 + rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-6.0, -2.0)
    poles = np.append(rng.uniform(-0.9, 0.99, 5), slow)
    own = StateSpace(
        np.diag(poles), rng.standard_normal((6, 1)), rng.standard_normal((1, 6)), np.zeros((1, 1))
    )
    for condition in (1.0, 1e2, 1e4, 1e6, 1e8, 1e10, 1e12):
        s = _mixed(own, condition, rng)
        law = Compensator(SampledStateSpace(s.A, s.B, s.C, s.D, period_s=0.05), (WAY,), (FORCE,))
        found, said = _packed(law)
        assert found or slow > 1.0 or "may be" in said
        if not found:
            assert slow > 1.0 or condition > 1e4
            continue
        assert slow < 1.0, condition
        declared = package_law(law, "mixed", unstable=True)
        assert not declared.unstable


@pytest.mark.parametrize("seed", repeats(range(20), 3))
def test_a_law_whose_sections_repeat_a_slow_pole_is_packed(seed: int) -> None:
    """A cascade has a defective pole exactly; rounding moves each section's alone."""
    rng = np.random.default_rng([82, seed])
    pole = 1.0 - 10.0 ** rng.uniform(-5.0, -1.0)
    A = np.diag(np.full(4, pole)) + np.diag(rng.uniform(0.1, 1.0, 3), -1)
    A = sla.block_diag(A, [[0.5]])
    s = SampledStateSpace(A, np.eye(5)[:, :1], np.eye(5)[3:4], np.zeros((1, 1)), period_s=0.05)
    assert not package_law(Compensator(s, (WAY,), (FORCE,)), "cascade").unstable
