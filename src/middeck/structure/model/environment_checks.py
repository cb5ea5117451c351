"""Requirements of an `Environment`, however it was made."""

from collections.abc import Iterator

import numpy as np

from middeck.errors import ConfigError
from middeck.structure.model.article import Structure
from middeck.structure.model.connectivity import redrawing_commands
from middeck.structure.model.environment import Environment
from middeck.structure.model.section_and_bushing_checks import bushing_faults


def check_environment(environment: Environment, structure: Structure) -> None:
    """Raise one `ConfigError` with all that is wrong with it, alone and around ``structure``."""
    faults = [*_gravity(environment), *_springs(environment), *_devices(environment)]
    faults += [fault for b in environment.bushings for fault in bushing_faults(b.name, b.stiffness, b.axes)]
    faults += redrawing_commands(structure, environment.bushings)
    if faults:
        raise ConfigError(
            "; ".join(faults),
            where=f"environment {environment.title!r}",
            hint="files are checked with line numbers by load_environment and by every verb",
        )


def _gravity(environment: Environment) -> Iterator[str]:
    if not np.all(np.isfinite(environment.gravity)):
        yield f"gravity {environment.gravity.tolist()} is not a number"


def _springs(environment: Environment) -> Iterator[str]:
    for spring in environment.springs:
        numbers = np.array([spring.stiffness, spring.free_length, *spring.anchor])
        if not np.all(np.isfinite(numbers)) or np.any(numbers[:2] < 0.0):
            yield f"spring {spring.name!r} has a stiffness, length or anchor that is no number or negative"


def _devices(environment: Environment) -> Iterator[str]:
    for device in environment.hung:
        if device.anchor is not None and not np.all(np.isfinite(device.anchor)):
            yield f"device {device.name!r} has an anchor that is not a number"
        if set(device.held) - set("xyz"):
            yield f"device {device.name!r} is held in {device.held!r}: of x, y and z only"
