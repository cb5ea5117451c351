"""Arguments of another kind, as two that are swapped, are named, with the call that is meant."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import middeck as md
from structure_builders import body, node, structure

P: Any = md.make_plant([[-1.0]], [[1.0]], [[1.0]], w=["u1"], u=["u1"], z=["y1"], y=["y1"])
K: Any = md.Compensator(md.systems.StateSpace([[-3.0]], [[1.0]], [[-2.0]], [[0.0]]), P.outputs, P.inputs)
WEIGHTS = md.LQGWeights(output=[1.0], input=[1.0], disturbed=("u1",), process=[[1.0]], sensor=[1.0])
BAND = md.Performance([1.0], [[1.0]], (0.0, 1.0))
ARTICLE: Any = structure([node("a", (0, 0, 0), body(1.0, inertia=(0.1, 0.1, 0.1)))])
ORBIT: Any = md.Environment.orbit()
REST: Any = md.solve_equilibrium(ARTICLE, ORBIT)
GAIN: Any = np.eye(1)
RECORD: Any = md.Record(
    sample_hz=1.0, u=np.ones((1, 1, 8, 1)), y=np.ones((1, 1, 8, 1)), inputs=P.inputs, outputs=P.outputs,
    periodic=False,
)  # fmt: skip

MISTAKES: dict[str, tuple[Callable[[], Any], str]] = {
    "margins": (lambda: md.measure_margins(K, P), "a Compensator stands in place of the plant"),
    "disk": (lambda: md.control.measure_disk_margin(K, P), "a Compensator stands in place of the plant"),
    "stability": (lambda: md.decide_stability(K, P), "a Compensator stands in place of the plant"),
    "loop": (lambda: md.close_loop(K, P), "a Compensator stands in place of the plant"),
    "rms": (lambda: md.measure_rms(K, P, BAND), "a Compensator stands in place of the plant"),
    "two plants": (lambda: md.decide_stability(P, P), "a Plant stands in place of the compensator"),
    "response": (lambda: md.evaluate_plant(K, [1.0]), "a Compensator stands in place of the plant"),
    "design": (lambda: md.design_lqg(ARTICLE, WEIGHTS, 1.0), "a Structure stands in place of the plant"),
    "emulation": (lambda: md.emulate(P, 0.1), "a Plant stands in place of the compensator"),
    "one plant": (lambda: md.qualify_compensator(K, P, WEIGHTS), "a Plant stands in place of the plants"),
    "gain": (lambda: md.Compensator(GAIN, P.outputs, P.inputs), "a ndarray stands in place of the law's dyn"),
    "ports": (lambda: md.Compensator(K.dynamics, ("y1",), ("u1",)), "a str stands in place of the port"),  # ty: ignore[invalid-argument-type]
    "article": (
        lambda: md.solve_equilibrium(ORBIT, ARTICLE),
        "an Environment stands in place of the article",
    ),
    "path": (lambda: md.solve_equilibrium("a.toml", ORBIT), "a str stands in place of the article"),  # ty: ignore[invalid-argument-type]
    "no environment": (
        lambda: md.solve_equilibrium(ARTICLE, None),
        "None stands in place of the environment",
    ),  # ty: ignore[invalid-argument-type]
    "modes": (lambda: md.solve_modes(ARTICLE), "a Structure stands in place of the rest state"),
    "plant": (
        lambda: md.build_plant(REST, inputs=[], outputs=[]),
        "an Equilibrium stands in place of the mo",
    ),
    "clamps": (lambda: md.Environment.clamped(["a"]), "a list stands in place of the name of a node"),  # ty: ignore[invalid-argument-type]
    "parameters": (
        lambda: md.differentiate_frequencies(md.solve_modes(REST), ["node.a.mass"]),  # ty: ignore[invalid-argument-type]
        "a str stands in place of the parameter",
    ),
    "blows": (lambda: md.fit_impact(RECORD), "a Record stands in place of the impact test"),
    "break": (lambda: md.control.measure_disk_margin(P, K, at="input"), "broken at 'input'"),  # ty: ignore[invalid-argument-type]
    "frequency": (lambda: md.evaluate_plant(P, [np.nan]), "a frequency is not finite"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_an_argument_of_another_kind_is_named(mistake: str) -> None:
    call, message = MISTAKES[mistake]
    with pytest.raises(md.MiddeckError) as caught:
        call()
    assert message in str(caught.value)
    assert "\n  try: " in str(caught.value)


def test_one_rate_and_one_frequency_need_no_list() -> None:
    one, *_ = (r.stable for r in md.qualify_compensator(K, {"p": P}, WEIGHTS, rates_hz=100.0))  # ty: ignore[invalid-argument-type]
    assert one
    assert md.evaluate_plant(P, 0.0).H.tolist() == [[[1.0]]]  # ty: ignore[invalid-argument-type]
