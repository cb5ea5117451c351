"""Every public function names an argument of another kind, and lets errors of its own pass."""

from __future__ import annotations

import dataclasses
import inspect
from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import middeck as md
from middeck.arguments import fits, named_kinds, words
from middeck.errors import ConfigError, DataError
from middeck.identification.model.measurement_model import model_response

FUNCTIONS = sorted(name for name in md.__all__ if inspect.isfunction(getattr(md, name)))
# Rooms whose functions have their own guards.
ELSEWHERE = {"examine_package", "package_law"}


class Strange:
    """What no function takes."""


@pytest.mark.parametrize("name", sorted(set(FUNCTIONS) - ELSEWHERE))
def test_what_no_function_takes_is_named(name: str) -> None:
    function = getattr(md, name)
    needed = [
        p.name
        for p in inspect.signature(function).parameters.values()
        if p.default is p.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    ]
    with pytest.raises(md.MiddeckError) as caught:
        function(**dict.fromkeys(needed, Strange()))
    assert any(word in str(caught.value) for word in ("Strange", f"{needed[0]} is not"))
    assert "\n  try: " in str(caught.value)


RESPONSE = md.evaluate_plant(md.make_plant([[-1.0]], [[1.0]], [[1.0]]), np.linspace(0.01, 1.0, 40))

RECORD = md.Record(
    sample_hz=10.0,
    u=np.random.default_rng(1).standard_normal((1, 2, 64, 1)),
    y=np.zeros((1, 2, 64, 1)),
    inputs=RESPONSE.inputs,
    outputs=RESPONSE.outputs,
    periodic=True,
)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: md.stabilisation([1.0]), "a list stands in place of measured"),
        (lambda: md.stabilisation(RESPONSE, sample_hz=np.nan), "a float stands in place of sample_hz"),
        (lambda: md.fit_response(RESPONSE, states="4"), "states is a whole number or None"),
        (lambda: md.measured_plant(RESPONSE), "that of a fit is fit_response(...).model"),
        (lambda: md.compare_fits(None, None), "None stands in place of before"),
        (lambda: md.track_modes(None, RESPONSE), "start_tracking makes one"),
    ],
)
def test_a_message_names_the_argument_and_what_it_is(call: Any, message: str) -> None:
    with pytest.raises(md.MiddeckError) as caught:
        call()
    assert message in str(caught.value)


def test_orders_without_a_light_mode_have_empty_rows() -> None:
    """A response of one decaying pole has none at first."""
    assert not len(md.stabilisation(RESPONSE, orders=(1, 2)).natural_hz)


@pytest.mark.parametrize("delay_s", [np.nan, -0.1, 0.02])
def test_a_delay_that_a_model_would_leave_aside_is_refused(delay_s: float) -> None:
    model = md.fit_response(RESPONSE, states=1, constants="complex").model
    with pytest.raises(md.MiddeckError, match="delay_s"):
        md.expected_accuracy(model, RECORD, 1e-3, delay_s=delay_s)


def test_errors_that_no_argument_explains_pass() -> None:
    @named_kinds
    def fails(number: float, names: list[str]) -> None:
        """It fails."""
        raise ValueError(f"{number} {names}")

    with pytest.raises(ValueError, match=r"1\.0 \['a'\]"):
        fails(1.0, ["a"])
    with pytest.raises(TypeError, match="missing 1 required"):
        fails(1.0)  # ty: ignore[missing-argument]
    with pytest.raises(md.MiddeckError, match="a str stands in place of names"):
        fails(1.0, "a")  # ty: ignore[invalid-argument-type]
    assert fails.__doc__ == "It fails."
    assert fails.__globals__ is globals()  # where doctest looks for it


def test_warnings_blame_the_line_that_called() -> None:
    plant = md.make_plant([[0.0, 100.0], [-100.0, -1.0]], [[0.0], [1.0]], [[1.0, 0.0]], u=["u1"], y=["y1"])
    law = md.Compensator(plant.dynamics, plant.outputs, plant.inputs)
    with pytest.warns(UserWarning, match="rings at") as caught:
        md.emulate(law, 0.1)
    assert [warning.filename for warning in caught] == [__file__]


@pytest.mark.parametrize(
    ("value", "hint", "expected"),
    [
        (np.float64(1.0), float, True),
        (np.int64(1), int, True),
        (True, int, False),
        (np.True_, bool, True),
        pytest.param(10**400, float, True, id="beyond floats"),
        (np.nan, float, False),
        (1j, float, False),
        ((1, 2.0), tuple[float, float], True),
        ([1.0], tuple[float, float], False),
        ({"a": 1}, dict[str, float], True),
        ({"a": "b"}, dict[str, float], False),
        (np.zeros(0), list[float], False),
        ([], list[float], True),
        (deque([1.0]), Sequence[float], True),
        (deque(["a"]), Sequence[float], False),
    ],
)
def test_what_fits(value: object, hint: Any, expected: bool) -> None:
    assert fits(value, hint) is expected
    assert words(hint)


@pytest.mark.parametrize("rate", [np.nan, np.inf, 0.0, -1.0])
def test_a_record_of_an_impossible_rate_is_refused(rate: float) -> None:
    with pytest.raises(DataError, match="is not possible"):
        dataclasses.replace(RECORD, sample_hz=rate)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"sample_hz": "10"}, "a str stands in place of the sampling rate"),
        ({"sample_hz": True}, "a truth value stands in place of the sampling rate"),
        ({"inputs": ("force",)}, "a str stands in place of the port among the inputs"),
        ({"outputs": [None]}, "None stands in place of the port among the outputs"),
        ({"outputs": RECORD.outputs[0]}, "a Port stands in place of the outputs"),
    ],
)
def test_a_record_of_no_rate_or_ports_is_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        dataclasses.replace(RECORD, **fields)


def test_a_rate_may_be_the_array_of_one_number_that_a_file_gives() -> None:
    rate = dataclasses.replace(RECORD, sample_hz=np.array(10.0)).sample_hz
    assert (rate, type(rate)) == (10.0, float)


def test_a_model_has_no_response_where_a_frequency_is_none() -> None:
    model = md.fit_response(RESPONSE, states=1, constants="complex").model
    for none in (np.nan, np.inf):
        with pytest.raises(ConfigError, match="a frequency is not finite"):
            model_response(model, np.array([0.1, none]))
