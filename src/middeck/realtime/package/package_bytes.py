"""The binary form of a controller package: one encoding for each package, sealed by its SHA-256.

Little-endian. Magic, twelve words of 32 bits, the period, texts (16 bits of length, then UTF-8), the places
of the sections, zeros up to a multiple of eight bytes, doubles column by column, the test vectors, and the
hash of all that stands before it. A reader rebuilds the bytes from what it has read and refuses those that
differ: there is no second way to say the same.
"""

import hashlib
import math
import struct
from typing import NamedTuple, NoReturn

import numpy as np

from middeck.errors import ConfigError, DataError
from middeck.realtime.package.core import Core
from middeck.realtime.package.filter_sections import InputFilter, LoopPath, Section
from middeck.realtime.package.package import (
    CHANNELS,
    RAMP,
    SAMPLES,
    SECTIONS,
    STATES,
    TEXT,
    ControllerPackage,
    TestVectors,
)
from middeck.signals.ports import Port

MAGIC = b"MIDDECKP"
FORMAT = 1
AGAIN = "the file as it was generated"
MODAL, SINGLE, UNSTABLE, APPLIED, OWN = 1, 2, 4, 8, 16
_HASH = 32


class _Head(NamedTuple):
    """The words of 32 bits."""

    format: int
    flags: int
    states: int
    pairs: int
    inputs: int
    outputs: int
    filters: int
    paths: int
    ramp: int
    samples: int
    start_level: int
    reserved: int


_MOST = _Head(FORMAT, 31, STATES, STATES // 2, CHANNELS, CHANNELS, SECTIONS, SECTIONS, RAMP, SAMPLES, RAMP, 0)
_HEAD = struct.Struct(f"<8s{len(_Head._fields)}Id")


def encode_package(package: ControllerPackage) -> bytes:
    """The bytes of ``package``; raises `ConfigError` for one without test vectors."""
    vectors, core = package.vectors, package.core
    if vectors is None:
        raise ConfigError("a package without test vectors", hint="add_test_vectors(package)")
    flags = (
        MODAL * (core.pairs is not None)
        + SINGLE * package.single
        + UNSTABLE * package.unstable
        + APPLIED * core.drives
        + OWN * package.error_bound_own
    )
    head = _Head(
        FORMAT, flags, len(core.A), core.pairs or 0, len(package.inputs), len(package.outputs),
        len(package.filters), len(package.paths), package.ramp, len(vectors.y), vectors.start_level, 0,
    )  # fmt: skip
    front = _HEAD.pack(MAGIC, *head, package.period_s) + _text(package.name)
    front = pad_bytes(front + _port_texts(package) + _places(package))
    numbers = _bytes([*_limits(package), *_coefficients(package), vectors.y, vectors.u])
    body = front + numbers + pad_bytes(vectors.engaged.astype(np.uint8).tobytes())
    return body + hashlib.sha256(body).digest()


def hash_package(package: ControllerPackage) -> str:
    """SHA-256 of the binary form, in hexadecimal: the name under which a package is known."""
    return encode_package(package)[-_HASH:].hex()


def hash_law(package: ControllerPackage) -> str:
    """SHA-256 of what computes: sizes, period, ports, places of the sections and coefficients.

    It is the name under which a blacklist knows a law: another name, ramp, range or limit of the package, and
    other test vectors, leave it as it is. The same law in other coordinates has another.
    """
    core = package.core
    sizes = (
        MODAL * (core.pairs is not None) + SINGLE * package.single + APPLIED * core.drives,
        len(core.A), core.pairs or 0, len(package.inputs), len(package.outputs),
        len(package.filters), len(package.paths), 0,
    )  # fmt: skip
    parts = (_port_texts(package), _places(package), _bytes(_coefficients(package)))
    digests = b"".join(hashlib.sha256(part).digest() for part in parts)
    return hashlib.sha256(struct.pack("<8Id", *sizes, package.period_s) + digests).hexdigest()


def decode_package(data: bytes, where: str = "") -> ControllerPackage:
    """The package in ``data``.

    Raises `DataError` for what is no package, cut short, changed, of another version or byte order, or not
    the one encoding of what it says. No size is believed before it is checked.
    """
    head, period_s = _read_head(data, where)
    if hashlib.sha256(data[:-_HASH]).digest() != data[-_HASH:]:
        if _is_cut(data, head):
            _refuse(f"cut short: its {len(data)} bytes end before what its sizes need", where)
        _refuse("the package was changed: its hash does not fit", where)
    try:
        package = _Reader(data[_HEAD.size : -_HASH], where).package(head, period_s)
    except ConfigError as error:
        raise DataError(error.what, where=where, hint=error.hint) from None
    if encode_package(package) != data:
        _refuse("not the one encoding of what it says", where)
    return package


def _read_head(data: bytes, where: str) -> tuple[_Head, float]:
    if not data:
        _refuse("the file is empty", where)
    if not data.startswith(MAGIC):
        _refuse("no controller package: it begins otherwise", where)
    if len(data) < _HEAD.size + _HASH:
        _refuse(f"cut short: {len(data)} bytes", where)
    _, *words, period_s = _HEAD.unpack_from(data)
    head = _Head(*words)
    if head.format == int.from_bytes(struct.pack(">I", FORMAT), "little"):
        _refuse("the bytes of each number stand in the other order (big-endian)", where)
    if head.format != FORMAT:
        _refuse(f"format {head.format}; this program reads {FORMAT}", where)
    for name, value, most in zip(_Head._fields, head, _MOST, strict=True):
        if value > most:
            _refuse(f"{name} {value}; at most {most}", where)
    if not head.inputs * head.outputs:
        _refuse(f"{head.inputs} inputs and {head.outputs} outputs; at least one of each", where)
    return head, period_s


def _is_cut(data: bytes, head: _Head) -> bool:
    """Whether it ends before what its sizes need: for the reason only, as a length may have been changed."""
    n, m, p, places, at = head.states, head.inputs, head.outputs, head.filters + head.paths, _HEAD.size
    for _ in range(1 + 2 * (m + p)):
        length = int.from_bytes(data[at : at + 2], "little")
        if length > TEXT:
            return False
        at += 2 + length
    at += 8 * places
    dynamics = n + 2 * head.pairs if head.flags & MODAL else n * n
    path, bound = n * p * bool(head.flags & APPLIED), p * bool(head.flags & SINGLE)
    law = dynamics + n * m + p * n + p * m + path + 5 * places
    numbers = m + 3 * p + bound + law + head.samples * (m + p)
    return len(data) < at + -at % 8 + 8 * numbers + head.samples + -head.samples % 8 + _HASH


def _port_texts(package: ControllerPackage) -> bytes:
    ports = (*package.inputs, *package.outputs)
    return b"".join(_text(text) for port in ports for text in (port.name, port.unit))


def _places(package: ControllerPackage) -> bytes:
    places = [(f.input, 0) for f in package.filters] + [(p.input, p.output) for p in package.paths]
    return b"".join(struct.pack("<II", *place) for place in places)


def _bytes(parts: list[np.ndarray]) -> bytes:
    """Doubles column by column."""
    return np.concatenate([np.ravel(part, order="F") for part in parts]).astype("<f8").tobytes()


def _limits(package: ControllerPackage) -> list[np.ndarray]:
    bound = [] if package.error_bound is None else [package.error_bound]
    return [package.input_range, package.lower, package.upper, package.slew, *bound]


def _coefficients(package: ControllerPackage) -> list[np.ndarray]:
    """All numbers of compensator and sections."""
    core = package.core
    pairs = core.pairs
    if pairs is None:
        dynamics = [core.A]
    else:
        first = np.arange(pairs)
        dynamics = [np.diag(core.A), core.A[first, first + pairs], core.A[first + pairs, first]]
    sections = [s for place in (*package.filters, *package.paths) for s in (place.section.b, place.section.a)]
    return [*dynamics, core.B, core.C, core.D, *([core.E] if core.drives else []), *sections]


class _Reader:
    """Takes a body apart; what is not there ends it with a `DataError`."""

    def __init__(self, body: bytes, where: str) -> None:
        self.body, self.at, self.where = body, 0, where

    def package(self, head: _Head, period_s: float) -> ControllerPackage:
        m, p = head.inputs, head.outputs
        name = self.text()
        inputs = tuple(Port(self.text(), self.text()) for _ in range(m))
        outputs = tuple(Port(self.text(), self.text()) for _ in range(p))
        places = [struct.unpack("<II", self.take(8)) for _ in range(head.filters + head.paths)]
        self.align()
        limits = [self.numbers(m), *(self.numbers(p) for _ in range(3))]
        bound = self.numbers(p) if head.flags & SINGLE else None
        core = self.core(head)
        placed = [(place, Section(self.numbers(3), self.numbers(2))) for place in places]
        y, u = self.numbers(head.samples, m), self.numbers(head.samples, p)
        engaged = np.frombuffer(self.take(head.samples + -head.samples % 8)[: head.samples], np.uint8) != 0
        return ControllerPackage(
            name=name, period_s=period_s, inputs=inputs, outputs=outputs,
            input_range=limits[0], lower=limits[1], upper=limits[2], slew=limits[3], core=core,
            filters=tuple(InputFilter(i, s) for (i, _), s in placed[: head.filters]),
            paths=tuple(LoopPath(i, o, s) for (i, o), s in placed[head.filters :]),
            ramp=head.ramp, unstable=bool(head.flags & UNSTABLE), single=bool(head.flags & SINGLE),
            error_bound=bound, error_bound_own=bool(head.flags & OWN),
            vectors=TestVectors(start_level=head.start_level, engaged=engaged, y=y, u=u),
        )  # fmt: skip

    def core(self, head: _Head) -> Core:
        n, m, p, pairs = head.states, head.inputs, head.outputs, head.pairs
        if head.flags & MODAL:
            if 2 * pairs > n:
                _refuse(f"{pairs} blocks for {n} states", self.where)
            dynamics = np.diag(self.numbers(n))
            first = np.arange(pairs)
            dynamics[first, first + pairs] = self.numbers(pairs)
            dynamics[first + pairs, first] = self.numbers(pairs)
        else:
            dynamics = self.numbers(n, n)
        B, C, D = self.numbers(n, m), self.numbers(p, n), self.numbers(p, m)
        E = self.numbers(n, p) if head.flags & APPLIED else np.zeros((n, p))
        return Core(A=dynamics, B=B, C=C, D=D, E=E, pairs=pairs if head.flags & MODAL else None)

    def take(self, count: int) -> bytes:
        end = self.at + count
        if end > len(self.body):
            _refuse("wrong size: its sizes need more bytes than it has", self.where)
        found, self.at = self.body[self.at : end], end
        return found

    def text(self) -> str:
        (length,) = struct.unpack("<H", self.take(2))
        if length > TEXT:
            _refuse(f"a text of {length} bytes; at most {TEXT}", self.where)
        try:
            return self.take(length).decode()
        except UnicodeDecodeError:
            _refuse("a text that is not UTF-8", self.where)

    def numbers(self, *shape: int) -> np.ndarray:
        return np.frombuffer(self.take(8 * math.prod(shape)), dtype="<f8").reshape(shape, order="F")

    def align(self) -> None:
        self.take(-(_HEAD.size + self.at) % 8)


def _text(text: str) -> bytes:
    return struct.pack("<H", len(text.encode())) + text.encode()


def pad_bytes(data: bytes) -> bytes:
    """``data`` with zeros up to a multiple of eight bytes."""
    return data + bytes(-len(data) % 8)


def _refuse(what: str, where: str) -> NoReturn:
    raise DataError(what, where=where, hint=AGAIN)
