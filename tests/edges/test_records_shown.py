"""Records on a screen: short arrays as they are, long ones by shape and kind."""

import dataclasses
import pickle

import numpy as np
import pytest
from jaxtyping import Float

import middeck as md
from middeck.errors import ConfigError
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record


@record
class Inner:
    x: Float[np.ndarray, " sample"]


@record
class Outer:
    name: str
    inner: tuple[Inner, ...]
    H: np.ndarray


@record(kw_only=True)
class Named:
    first: float
    second: Float[np.ndarray, " sample"]


@record
class Holder:
    one: Outer
    other: Inner


def test_long_arrays_are_shown_by_shape_and_kind() -> None:
    shown = repr(Outer("a", (Inner(np.zeros(10_000)),), np.zeros((20, 2), complex)))
    assert (
        shown == "Outer(name='a', inner=(Inner(x=array(10000) of float64),), H=array(20 x 2) of complex128)"
    )


def test_short_arrays_are_shown_as_they_are() -> None:
    assert repr(Inner(np.array([1.0, 2.5]))) == "Inner(x=array([1. , 2.5]))"


def test_what_shows_itself_is_left_alone() -> None:
    @record
    class Own:
        x: Float[np.ndarray, " sample"]

        def __repr__(self) -> str:
            return "mine"

    assert repr(Own(np.zeros(3))) == "mine"


def test_long_tuples_are_shown_by_their_ends() -> None:
    shown = repr(Outer("a", tuple(Inner(np.array([float(k)])) for k in range(9)), np.zeros(1)))
    ends = "Inner(x=array([0.])), Inner(x=array([1.])), ..., Inner(x=array([8.])): 9 in all"
    assert shown == f"Outer(name='a', inner=({ends}), H=array([0.]))"


def test_long_records_within_records_are_shown_by_name() -> None:
    holder = Holder(Outer("a" * 100, (), np.zeros(1)), Inner(np.zeros(1)))
    assert repr(holder) == "Holder(one=Outer(...), other=Inner(x=array([0.])))"


def test_fields_by_name_only_are_locked_and_come_back_from_a_file() -> None:
    made = Named(first=1.0, second=np.array([1.0, 2.0]))
    again = pickle.loads(pickle.dumps(made))
    assert again == made
    assert not again.second.flags.writeable
    with pytest.raises(TypeError, match="positional"):
        Named(1.0, [1.0, 2.0])


def test_five_fields_are_given_by_name() -> None:
    def of(count: int) -> type:
        return type("Many", (), {"__annotations__": dict.fromkeys("abcdefgh"[:count], float)})

    assert record(of(4))(1.0, 2.0, 3.0, 4.0).d == 4.0
    with pytest.raises(TypeError, match="Many: 5 fields by position"):
        record(of(5))
    assert record(kw_only=True)(of(5))(a=1.0, b=2.0, c=3.0, d=4.0, e=5.0).e == 5.0


@pytest.mark.parametrize("A", [np.array([[1.0 + 1.0j]]), [[1.0j]], np.array([[1.0 + 0.0j]])])
def test_no_imaginary_part_is_dropped(A):
    """NumPy drops it with a warning at most."""
    with pytest.raises(ConfigError, match=r"StateSpace\.A: no array of numbers: complex ones"):
        StateSpace(A, [[1.0]], [[1.0]], [[0.0]])


def test_lists_given_for_tuples_become_tuples() -> None:
    """Loops are known by their halves: ports in lists were no keys, and could change."""
    names = ["p", "q"]

    @record
    class Several:
        names: tuple[str, ...]
        more: tuple[str, ...] | None = None

    made = Several(names, ["r"])
    names.append("s")
    assert (made.names, made.more, Several(("p",)).more) == (("p", "q"), ("r",), None)
    plant = md.make_plant([[-1.0]], [[1.0]], [[1.0]])
    listed = dataclasses.replace(plant, inputs=list(plant.inputs), outputs=list(plant.outputs))
    lag = StateSpace([[-1.0]], [[1.0]], [[-1.0]], [[0.0]])
    law = md.Compensator(lag, list(plant.outputs), list(plant.inputs))
    assert listed == plant
    assert not listed.delay_s.flags.writeable  # what changed would go by the loop that is known
    assert md.decide_stability(listed, law).stable


@record
class Gathered:
    by_name: dict[str, np.ndarray]
    each: tuple[Float[np.ndarray, " sample"], ...]


def test_arrays_within_tuples_and_tables_are_left_alone() -> None:
    given = np.arange(3.0)
    made = Gathered({"a": given}, [given, given[:2]])
    assert made.by_name["a"] is given
    assert [len(x) for x in made.each] == [3, 2]


def test_records_that_hold_tuples_of_arrays_are_compared_by_their_numbers() -> None:
    @record
    class Held:
        parts: tuple[np.ndarray, ...]

    one, same, other = (Held((np.array([1.0, last]), np.zeros(2))) for last in (2.0, 2.0, 3.0))
    assert one == same
    assert one != other
    assert one != Held((np.array([1.0, 2.0]),))
