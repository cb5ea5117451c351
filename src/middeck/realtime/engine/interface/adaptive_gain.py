"""A gain of the compensator that the power of a band moves."""

import hashlib
import math
import struct

from middeck.errors import ConfigError
from middeck.realtime.engine.interface.monitors import Monitor, band_edges
from middeck.values import record


@record(kw_only=True)
class AdaptiveGain:
    """A gain g of the command, u = p + g f c, which falls while the band rms of a sensor is high.

    The idea is that of the Space Launch System's adaptive augmenting control (Orr and VanZwieten 2012, AIAA
    2012-4549): a forward gain between fixed bounds, lowered by the power of an undesired band. Here it moves
    at one rate: g+ = g - ``rate`` T where the running rms is above ``loud_rms``, g + ``rate`` T where it is
    below ``quiet_rms``, and g between; kept between ``minimum`` and ``maximum``. It stands still while the
    fade f moves, and is at ``minimum`` until a law acts, so that f g never moves faster by it. The proof
    holds for every other rule within these bounds too: it does not ask what moves the gain.

    Attributes:
        maximum, minimum: Bounds of g; 1 is the package as designed. ``minimum`` is at most 1: up to there the
            gate tries the fades of a law.
        rate: Most change [1/s], which the computer enforces at each sample.
        sensor: Name of the input whose band is watched.
        band_hz: The band.
        quiet_rms, loud_rms: Running rms within the band [unit of the sensor].
        seconds: Time constant of the running mean square.

    Raises `ConfigError` for bounds, rate, band or rms that are no numbers or not in order.
    """

    maximum: float
    rate: float
    sensor: str
    band_hz: tuple[float, float]
    quiet_rms: float
    loud_rms: float
    minimum: float = 0.0
    seconds: float = 0.5

    def __post_init__(self) -> None:
        low, high = band_edges(self.band_hz, "adaptive gain")
        for fits, what, hint in (
            (0.0 <= self.minimum < self.maximum < math.inf and self.minimum <= 1.0,
             f"gains from {self.minimum} to {self.maximum}", "0 <= minimum < maximum, minimum <= 1"),
            (0.0 < self.rate < math.inf, f"a rate of {self.rate} 1/s", "> 0 1/s"),
            (0.0 < low < high < math.inf, f"a band from {low} to {high} Hz", "0 < low < high"),
            (0.0 < self.quiet_rms < self.loud_rms < math.inf,
             f"an rms that is quiet below {self.quiet_rms} and loud above {self.loud_rms}",
             "0 < quiet_rms < loud_rms"),
            (0.0 < self.seconds < math.inf, f"a time constant of {self.seconds} s", "> 0 s"),
        ):  # fmt: skip
            if not fits:
                raise ConfigError(what, where="adaptive gain", hint=hint)

    @property
    def monitor(self) -> Monitor:
        """What the engine looks at for it; it trips nothing."""
        return Monitor(channel=self.sensor, band_hz=self.band_hz, seconds=self.seconds)


@record(kw_only=True)
class ProvedGain:
    """What is proved of an adaptive gain, for the engine that moves it: `GateVerdict.proved_gain`.

    Attributes:
        package, hold: SHA-256 of the package (`hash_package`) and of the hold beside it (`hash_hold`).
        minimum, maximum, rate: Every gain between them, and every path of it within ``rate`` [1/s], is
            proved.
    """

    package: str
    hold: str
    minimum: float
    maximum: float
    rate: float


def encode_proof(proof: ProvedGain) -> bytes:
    """Its sealed bytes, which an engine takes beside the package."""
    hashes = bytes.fromhex(proof.package) + bytes.fromhex(proof.hold)
    body = b"MIDDECKG" + hashes + struct.pack("<3d", proof.minimum, proof.maximum, proof.rate)
    return body + hashlib.sha256(body).digest()
