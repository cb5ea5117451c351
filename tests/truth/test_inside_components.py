"""What a survey measures inside a component, by its outputs, beside the same points of the whole article."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg as sla
from reduced import bent_beam, with_component
from scipy.spatial.transform import Rotation

from middeck.errors import ConfigError
from middeck.structure.correlation.measured_modes import (
    AXES,
    MeasuredModes,
    channels_inside,
    drawn_at,
    measure_modes,
)
from middeck.structure.correlation.placing import place_channels
from middeck.structure.model.article import Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.component import WAYS, Component
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium

AT = [("m", way) for way in AXES] + [("c", "y")]
FLEXIBLE = range(6, 14)


def turned(part: Component) -> Component:
    """The same component with its matrices in axes of its own."""
    R = Rotation.from_rotvec([0.4, -0.7, 1.1]).as_matrix()
    own = sla.block_diag(np.kron(np.eye(4), R.T), np.eye(part.modal))
    assert part.outputs == tuple(f"m {way}" for way in WAYS)
    assert part.recovery is not None
    return dataclasses.replace(
        part,
        axes=R,
        positions=part.positions @ R,
        stiffness=own @ part.stiffness @ own.T,
        mass=own @ part.mass @ own.T,
        recovery=np.kron(np.eye(2), R.T) @ part.recovery @ own.T,
    )


def floating(article: Structure) -> Modes:
    return solve_modes(solve_equilibrium(article, Environment.orbit()))


def articles(stiffness: float = 100.0) -> tuple[Structure, Structure]:
    whole, part = bent_beam(np.random.default_rng(11), stiffness)
    made = with_component(whole, part, count=66, recover=["m"])
    return whole, dataclasses.replace(made, components=(turned(made.components[0]),))


@pytest.fixture(scope="module")
def both() -> tuple[Modes, Modes]:
    whole, reduced = articles()
    return floating(whole), floating(reduced)


def test_a_point_inside_moves_as_in_the_whole_article(both: tuple[Modes, Modes]) -> None:
    whole, reduced = (measure_modes(modes, AT, chosen=FLEXIBLE) for modes in both)
    np.testing.assert_allclose(reduced.frequency_hz, whole.frequency_hz, rtol=1e-6)
    sign = np.sign(np.sum(whole.shape * reduced.shape, axis=0))
    np.testing.assert_allclose(reduced.shape * sign, whole.shape, atol=1e-5 * np.abs(whole.shape).max())


def test_shapes_that_are_written_have_the_points_inside(both: tuple[Modes, Modes]) -> None:
    whole, reduced = both
    at = channels_inside(reduced.equilibrium.model)
    assert at == [("m", way) for way in AXES]
    assert channels_inside(whole.equilibrium.model) == []


def test_so_it_does_where_the_article_has_turned() -> None:
    """Stiff, on a hinge under gravity: it hangs far from where it was drawn."""
    hinge = Clamp(node="c", along="xyz", about="xy")
    hung = Environment(title="hinge", gravity=np.array([3.0, -9.0, 1.0]), clamps=(hinge,))
    rests = [solve_equilibrium(article, hung) for article in articles(1e7)]
    since = rests[0].config.since_drawn
    assert since is not None
    assert np.abs(since.turn).max() > 0.3
    whole, reduced = (measure_modes(solve_modes(rest), AT[:6], chosen=range(6)) for rest in rests)
    sign = np.sign(np.sum(whole.shape * reduced.shape, axis=0))
    np.testing.assert_allclose(reduced.shape * sign, whole.shape, atol=1e-4 * np.abs(whole.shape).max())


def test_it_is_found_by_its_place(both: tuple[Modes, Modes]) -> None:
    whole, reduced = both
    model = reduced.equilibrium.model
    place = drawn_at(whole.equilibrium.model, "m")
    np.testing.assert_allclose(drawn_at(model, "m"), place, atol=1e-12)
    test = MeasuredModes(
        frequency_hz=np.array([1.0]),
        damping=np.array([0.01]),
        node=("4",),
        direction=("x",),
        shape=np.ones((1, 1)),
        position_m=place[None],
    )
    assert place_channels(model, test).node == ("m",)


def test_a_turn_that_no_output_gives_is_refused() -> None:
    _, article = articles()
    (part,) = article.components
    assert part.recovery is not None
    bare = dataclasses.replace(part, outputs=part.outputs[:3], recovery=part.recovery[:3])
    modes = floating(dataclasses.replace(article, components=(bare,)))
    with pytest.raises(ConfigError, match="component 'part' has no output m turn about x"):
        measure_modes(modes, [("m", "rx")], chosen=FLEXIBLE)


def test_points_of_one_name_in_two_components_are_distinguished() -> None:
    """Two panels of one file: the second's point was read for both."""
    _, article = articles()
    (part,) = article.components
    assert part.recovery is not None
    there = dataclasses.replace(part, name="other", recovery=np.diag([1.0] * 3 + [2.0] * 3) @ part.recovery)
    modes = floating(dataclasses.replace(article, components=(part, there)))
    single, double = measure_modes(modes, [("part/m", "rx"), ("other/m", "rx")], chosen=FLEXIBLE).shape
    np.testing.assert_allclose(np.abs(double), 2.0 * np.abs(single), rtol=1e-6)
    with pytest.raises(ConfigError, match="'m'"):
        measure_modes(modes, [("m", "rx")], chosen=FLEXIBLE)
