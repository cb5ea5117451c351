"""The plants of a promise, on which other compensators may be tried."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from middeck.errors import DataError, MiddeckError
from middeck.files.json.hash_seal import SEAL, read_sealed, seal
from middeck.files.json.input import json_numbers, read_ports
from middeck.files.laws.compensators import build_system
from middeck.files.promises.promise_file import read_promise
from middeck.systems.plants.plant import Plant, name_states, remove_delays
from middeck.updating.promise.plan import Plan
from middeck.updating.promise.promise import Promise
from middeck.values import record

PLANTS = "middeck.promised-plants/1"
AGAIN = "the plants as `middeck promise --plants` wrote them with this promise"


@record
class PromisedPlants:
    """Plants by environment and number of the draw, and the promise that they belong to.

    Attributes:
        inner: Inputs whose inner loops are closed in the plants.
        sha256: Seal of the promise.
    """

    plants: Mapping[str, Plant]
    inner: tuple[str, ...]
    sha256: str


def plants_document(promises: Mapping[str, Promise], plan: Plan) -> dict[str, Any]:
    """The sealed document of all plants that were drawn, with all digits."""
    drawn = {
        f"{place} {number}": _described(plant)
        for place, promise in promises.items()
        for number, plant in enumerate(promise.plants)
    }
    inner = () if plan.inner is None else plan.inner.names
    return seal({"schema": PLANTS, "inner": inner, "plants": drawn})


def _described(plant: Plant) -> dict[str, Any]:
    system = remove_delays(plant).system
    matrices = {name: getattr(system, name) for name in "ABCD"}
    ports = {"inputs": plant.inputs, "outputs": plant.outputs}
    return {**ports, **matrices, "state_names": name_states(plant), "delay_s": plant.delay_s}


def load_promised_plants(path: str | Path) -> PromisedPlants:
    """The plants of the promise in ``path``, from the file beside it that it names.

    Raises `DataError` for a promise that names none, and for plants that are not those it was made on.
    """
    promise = read_promise(path)
    named = promise.get("plants")
    if named is None:
        hint = "middeck promise ARTICLE PLAN -o PROMISE.json --plants PLANTS.json"
        raise DataError("the promise names no file of its plants", where=str(path), hint=hint)
    file = Path(path).parent / Path(named["name"]).name
    found = read_sealed(file, PLANTS)
    if found[SEAL] != named[SEAL]:
        raise DataError(f"not the plants that {path} was made on", where=str(file), hint=AGAIN)
    try:
        plants = {name: _plant(table, f"{file}, {name}") for name, table in found["plants"].items()}
        return PromisedPlants(plants, tuple(found["inner"]), promise[SEAL])
    except (KeyError, TypeError, AttributeError, MiddeckError) as error:  # sealed without being whole
        raise DataError(f"no plants: {error}", where=str(file), hint=AGAIN) from None


def _plant(table: Mapping[str, Any], where: str) -> Plant:
    inputs, outputs = (read_ports(table[side], where, AGAIN) for side in ("inputs", "outputs"))
    matrices = {name: json_numbers(table[name], where, AGAIN) for name in "ABCD"}
    return Plant(
        dynamics=build_system(matrices, None, (len(inputs), len(outputs)), where),
        inputs=inputs,
        outputs=outputs,
        state_names=tuple(table["state_names"]),
        delay_s=json_numbers(table["delay_s"], where, AGAIN),
    )
