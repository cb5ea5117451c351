"""What a controller package holds."""

from __future__ import annotations

import re

import numpy as np
from jaxtyping import Bool, Float

from middeck.errors import ConfigError
from middeck.realtime.package.core import Core
from middeck.realtime.package.filter_sections import InputFilter, LoopPath
from middeck.realtime.package.shown_characters import is_shown
from middeck.signals.ports import Port
from middeck.values import record

STATES, CHANNELS, SECTIONS, RAMP, SAMPLES, TEXT = 1024, 64, 256, 1 << 24, 4096, 64
"""Most states, inputs or outputs, filters or paths, samples of a ramp, test samples, and bytes of a name."""
HERE = "controller package"
LETTERS = "Latin, Greek, Cyrillic or East Asian characters, signs of mathematics and arrows"
NEAR = 1e-9
"""How far the poles of an undeclared law may seem to lie outside the unit circle: their own rounding."""


@record(kw_only=True)
class TestVectors:
    """Inputs from a reset, and what the law must give for them to the last bit.

    Attributes:
        start_level: Where the ramp stands at the first sample, in samples.
        engaged: Whether the ramp rises (True) or falls at each sample.
        y, u: Inputs, and outputs after the limits.
    """

    __test__ = False

    start_level: int
    engaged: Bool[np.ndarray, " sample"]
    y: Float[np.ndarray, "sample input"]
    u: Float[np.ndarray, "sample output"]


@record(kw_only=True)
class ControllerPackage:
    """A sampled law as data: what a control computer needs to run it, and nothing that it would execute.

    The law of a sample, in this order: inputs are kept within their range; ``filters`` act on them; the
    compensator gives c and its next states; the inner loop gives p from the inputs before the filters;
    p + f c is limited in slew, then in size; the compensator learns how far the result is from p + c. The
    fade f rises and falls with the ramp.

    Attributes:
        name: Letters, digits, ``_`` and ``-``, a letter first.
        period_s: Time from sample to sample.
        inputs, outputs: What it reads and drives, in order.
        input_range: Largest magnitude of each input; a larger one is taken as this. inf for none.
        lower, upper: Limits of each output.
        slew: Most that each output changes from one sample to the next.
        core, filters, paths: The compensator, filters of its inputs, and the inner loop.
        ramp: Samples from zero to full authority.
        unstable: Whether compensator or sections are declared to have poles on or outside the unit circle.
        single: Whether it is computed in single precision: all numbers are of 24 bits.
        error_bound: Of a law in single precision: the most by which each output differs from that of the law
            in double precision, whatever the inputs; None else.
        error_bound_own: Whether that holds only from a reset on while the law's own commands are applied in
            full; else it holds whatever limits, fade and others do to them.
        vectors: Test vectors; None before they are computed.

    Raises `ConfigError` for what does not fit or exceeds `STATES`, `CHANNELS`, `SECTIONS`, `RAMP`, `SAMPLES`.
    """

    name: str
    period_s: float
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    input_range: Float[np.ndarray, " input"]
    lower: Float[np.ndarray, " output"]
    upper: Float[np.ndarray, " output"]
    slew: Float[np.ndarray, " output"]
    core: Core
    filters: tuple[InputFilter, ...] = ()
    paths: tuple[LoopPath, ...] = ()
    ramp: int = 0
    unstable: bool = False
    single: bool = False
    error_bound: Float[np.ndarray, " output"] | None = None
    error_bound_own: bool = False
    vectors: TestVectors | None = None

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", self.name, re.ASCII) or len(self.name) > TEXT:
            _refuse(f"the name {self.name!r}", f"letters, digits, _ and -, a letter first, {TEXT} at most")
        if not (np.isfinite(self.period_s) and self.period_s > 0.0):
            _refuse(f"a sampling period of {self.period_s} s", "> 0 s")
        for side, ports in (("inputs", self.inputs), ("outputs", self.outputs)):
            check_ports(side, ports)
            for port in ports:
                if port.channel is not None:
                    _refuse(
                        f"{side}: {port.name} with its transducer", "Port(name, unit): a package has no bench"
                    )
        shape = (len(self.outputs), len(self.inputs))
        if self.core.D.shape != shape:
            _refuse(
                f"a compensator of {self.core.D.shape} for {shape} outputs and inputs",
                "one row for each output",
            )
        if len(self.core.A) > STATES:
            _refuse(f"{len(self.core.A)} states", f"{STATES} at most: reduce the compensator")
        if max(len(self.filters), len(self.paths)) > SECTIONS:
            _refuse(f"{len(self.filters)} filters and {len(self.paths)} paths", f"{SECTIONS} of each at most")
        if not 0 <= self.ramp <= RAMP:
            _refuse(f"a ramp of {self.ramp} samples", f"0 to {RAMP}")
        self._check_limits()
        self._check_places()
        self._check_declared()
        if self.single:
            self._check_single()
        elif self.error_bound is not None or self.error_bound_own:
            _refuse(
                "a bound of rounding for a law in double precision",
                "error_bound=None and error_bound_own=False",
            )
        if self.vectors is not None:
            self._check_vectors(self.vectors)

    def _check_limits(self) -> None:
        if len(self.input_range) != len(self.inputs) or len(self.lower) != len(self.outputs):
            _refuse(
                "ranges or limits do not fit the ports", "one range for each input, one limit for each output"
            )
        if not np.all(self.input_range > 0.0):
            _refuse(f"ranges of {self.input_range.tolist()}", "> 0, inf for none")
        if not (np.all(self.lower <= 0.0) and np.all(self.upper >= 0.0) and np.all(self.lower < self.upper)):
            _refuse(
                f"limits from {self.lower.tolist()} to {self.upper.tolist()}",
                "lower <= 0 <= upper, not both zero",
            )
        if not np.all(self.slew > 0.0):
            _refuse(f"slew limits of {self.slew.tolist()}", "> 0 a sample, inf for none")

    def _check_places(self) -> None:
        for place in (*self.filters, *self.paths):
            if place.input not in range(len(self.inputs)):
                _refuse(f"a section at input {place.input}", f"0 to {len(self.inputs) - 1}")
        for path in self.paths:
            if path.output not in range(len(self.outputs)):
                _refuse(f"a path to output {path.output}", f"0 to {len(self.outputs) - 1}")

    def _check_declared(self) -> None:
        if self.unstable:
            return
        if self.core.radius > 1.0 + NEAR:
            _refuse(f"an undeclared pole of magnitude {self.core.radius:.6f}", "declare it: unstable=True")
        if not all(place.section.stable for place in (*self.filters, *self.paths)):
            _refuse("a section with an undeclared pole on or outside the unit circle", "unstable=True")

    def _check_single(self) -> None:
        if self.error_bound is None or not np.all(np.isfinite(self.error_bound) & (self.error_bound >= 0.0)):
            _refuse("a law in single precision without a bound of its error", "build it with to_single")
        if self.unstable:
            _refuse("an unstable compensator in single precision", "double precision: its error has no bound")
        if self.error_bound_own and not self.core.drives:
            _refuse(
                "a bound for own commands of a law that does not learn what is applied",
                "error_bound_own=False",
            )
        with np.errstate(over="ignore"):  # beyond single precision, and so not equal
            longer = any(np.any(numbers != numbers.astype(np.float32)) for numbers in law_numbers(self))
        if longer:
            _refuse("a number of more than 24 bits in a law of single precision", "build it with to_single")

    def _check_vectors(self, vectors: TestVectors) -> None:
        shapes = (vectors.y.shape[1], vectors.u.shape[1])
        if shapes != (len(self.inputs), len(self.outputs)) or not 0 < len(vectors.y) <= SAMPLES:
            _refuse(
                f"test vectors of {len(vectors.y)} samples of {shapes}", f"1 to {SAMPLES}, one column a port"
            )
        if not (np.isfinite(vectors.y).all() and np.isfinite(vectors.u).all()):
            _refuse("a test vector with a number that is not finite", "compute them with add_test_vectors")
        if not 0 <= vectors.start_level <= self.ramp:
            _refuse(f"test vectors from level {vectors.start_level} of {self.ramp}", "a level on the ramp")


def law_numbers(package: ControllerPackage) -> list[np.ndarray]:
    """All coefficients and limits that the law computes with."""
    core = package.core
    sections = [s for place in (*package.filters, *package.paths) for s in (place.section.b, place.section.a)]
    limits = [package.input_range, package.lower, package.upper, package.slew]
    return [core.A, core.B, core.C, core.D, core.E, *sections, *limits]


def largest(single: bool) -> float:
    """The largest number that the law computes with: a limit of inf is this one."""
    return float(np.finfo(np.float32 if single else np.float64).max)


def check_ports(side: str, ports: tuple[Port, ...], where: str = HERE) -> None:
    """Raise `ConfigError` for ports of a side that no computer takes: too many, of one name, unreadable."""
    if not 0 < len(ports) <= CHANNELS:
        _refuse(f"{len(ports)} {side}", f"1 to {CHANNELS}", where)
    names = [port.name for port in ports]
    if len(set(names)) < len(names):
        _refuse(f"two {side} of one name among {', '.join(names)}", "names that differ", where)
    for port in ports:
        for text, what in ((port.name, "name"), (port.unit, "unit")):
            if not is_shown(text) or len(text.encode()) > TEXT or (what == "name" and not text.strip()):
                _refuse(f"{side}: the {what} {text!r}", f"{LETTERS}, {TEXT} bytes at most", where)


def _refuse(what: str, hint: str, where: str = HERE) -> None:
    raise ConfigError(what, where=where, hint=hint)
