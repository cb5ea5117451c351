"""A package beside the hold of the engine that is to run it."""

import dataclasses

import numpy as np

from middeck.errors import ConfigError
from middeck.realtime.engine.interface.settings import Drive, EngineSettings
from middeck.realtime.package.core import Core
from middeck.realtime.package.filter_sections import LoopPath
from middeck.realtime.package.package import ControllerPackage
from middeck.signals.ports import Port


def with_hold(package: ControllerPackage, settings: EngineSettings) -> ControllerPackage:
    """The law that an article sees, u = p + f c: ``package`` with the hold of ``settings`` as its inner loop.

    Ports that only the hold has follow those of the package, with the ranges and limits of the settings; the
    limits of slew are those of both. Where nothing is added it is the package itself. Raises `ConfigError`
    for what no engine runs: other rates and ports, an inner loop of its own, single precision.
    """
    _require(not package.paths, "an inner loop of its own", "the hold belongs to the engine's settings")
    _require(not package.single, "single precision", "the engine runs the law in double precision")
    near = abs(package.period_s - settings.period_s) <= 1e-9 * settings.period_s
    _require(near, f"{1.0 / package.period_s:g} Hz", f"the engine's {1.0 / settings.period_s:g} Hz")
    there, drives = ([Port(p.name, p.unit) for p in side] for side in (settings.inputs, settings.outputs))
    for own, known in ((package.inputs, there), (package.outputs, drives)):
        lacking = [port.name for port in own if port not in known]
        _require(not lacking, f"without {', '.join(lacking)} of the package", "the same names and units")
    for port, most in zip(package.inputs, package.input_range, strict=True):
        test = settings.sensors[there.index(port)]
        reach, unit = min(test.range, test.envelope), port.unit
        said = f"clips {port.name} at {most:g} {unit}, within the {reach:g} {unit} of the engine"
        _require(reach <= most, said, "a larger range, or an envelope that trips first")
    own = [settings.drives[drives.index(port)] for port in package.outputs]
    for port, low, high, drive in zip(package.outputs, package.lower, package.upper, own, strict=True):
        said = f"moves {port.name} from {low:g} to {high:g} {port.unit}, the engine from {drive.lower:g} to "
        moves = max(low, drive.lower) < min(high, drive.upper)
        _require(moves, f"{said}{drive.upper:g}", "limits that leave more than zero")
    slew = np.minimum(package.slew, settings.period_s * np.array([drive.slew_rate for drive in own]))
    if np.any(slew < package.slew):
        package = dataclasses.replace(package, slew=slew, vectors=None)
    if not settings.hold:
        return package
    inputs = _joined(package.inputs, [there[path.input] for path in settings.hold])
    outputs = _joined(package.outputs, [drives[path.output] for path in settings.hold])
    m, p = len(package.inputs), len(package.outputs)
    tests = [settings.sensors[there.index(port)] for port in inputs[m:]]
    more = [settings.drives[drives.index(port)] for port in outputs[p:]]
    return dataclasses.replace(
        package,
        inputs=inputs,
        outputs=outputs,
        input_range=np.append(package.input_range, [test.range for test in tests]),
        lower=np.append(package.lower, [drive.lower for drive in more]),
        upper=np.append(package.upper, [drive.upper for drive in more]),
        slew=np.append(package.slew, [drive.slew_rate * settings.period_s for drive in more]),
        core=_widened(package.core, len(tests), len(more)),
        paths=tuple(
            LoopPath(inputs.index(there[path.input]), outputs.index(drives[path.output]), path.section)
            for path in settings.hold
        ),
        vectors=None,
    )


def drives_of(held: ControllerPackage, settings: EngineSettings) -> tuple[Drive, ...]:
    """The drive of each output of a package beside the hold."""
    return tuple(settings.drives[settings.outputs.index(port)] for port in held.outputs)


def with_drives(package: ControllerPackage, settings: EngineSettings) -> ControllerPackage:
    """``package`` without a hold, with the tighter limits of its own and of the engine's drives.

    Both keep the last output within their bounds, so that one after the other they are the tighter ones.
    """
    own = drives_of(package, settings)
    return dataclasses.replace(
        package,
        lower=np.maximum(package.lower, [drive.lower for drive in own]),
        upper=np.minimum(package.upper, [drive.upper for drive in own]),
        slew=np.minimum(package.slew, [drive.slew_rate * settings.period_s for drive in own]),
        vectors=None,
    )


def _joined(own: tuple[Port, ...], used: list[Port]) -> tuple[Port, ...]:
    return tuple(dict.fromkeys((*own, *used)))


def _widened(core: Core, inputs: int, outputs: int) -> Core:
    n = len(core.A)
    return dataclasses.replace(
        core,
        B=np.hstack([core.B, np.zeros((n, inputs))]),
        C=np.vstack([core.C, np.zeros((outputs, n))]),
        D=np.pad(core.D, ((0, outputs), (0, inputs))),
        E=np.hstack([core.E, np.zeros((n, outputs))]),
    )


def _require(holds: bool, what: str, hint: str) -> None:
    if not holds:
        raise ConfigError(f"not for this engine: {what}", where="package", hint=hint)
