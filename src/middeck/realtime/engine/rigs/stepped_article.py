"""A linear article in Python: the numbers of ``source/rig_linear.c`` to rounding, its noise to the bit."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.realtime.engine.rigs.engine_rig import EngineRig
from middeck.realtime.engine.rigs.linear_article import LinearArticle

WORD = (1 << 64) - 1


class SteppedArticle(EngineRig):
    """``article`` sample by sample, where no compiler is at hand.

    Raises `ConfigError` for an article with faults, which the engine alone injects.
    """

    def __init__(self, article: LinearArticle) -> None:
        if article.faults:
            raise ConfigError("an article with faults", where="article in Python", hint="the engine's own")
        self.article, self.x, self.noise = article, article.x, NormalNumbers(article.seed)
        self.noisy = np.flatnonzero(article.sensor_noise > 0.0).tolist()

    def read(self) -> Float[np.ndarray, " sensor"]:
        """The sensors now; each call draws noise anew."""
        y = self.article.C @ self.x
        for i in self.noisy:
            y[i] += self.article.sensor_noise[i] * self.noise.draw()
        return y

    def write(self, u: Float[np.ndarray, " output"]) -> None:
        """One sample on."""
        a = self.article
        w = np.array([self.noise.draw() for _ in range(a.G.shape[1])])
        self.x = a.A @ self.x + a.B @ u + a.G @ w


class NormalNumbers:
    """Nearly normal numbers of variance one, as ``rig_linear.c`` draws them from a seed.

    Sums of twelve uniform numbers of 16 bits from xoshiro256++ (Blackman and Vigna 2019).
    """

    def __init__(self, seed: int) -> None:
        self.state: list[int] = []
        for _ in range(4):  # splitmix64
            seed = (seed + 0x9E3779B97F4A7C15) & WORD
            z = (seed ^ seed >> 30) * 0xBF58476D1CE4E5B9 & WORD
            z = (z ^ z >> 27) * 0x94D049BB133111EB & WORD
            self.state.append(z ^ z >> 31)

    def draw(self) -> float:
        """The next number, at most 6 to either side."""
        total = 0
        for _ in range(3):
            bits = self._bits()
            total += (bits & 0xFFFF) + (bits >> 16 & 0xFFFF) + (bits >> 32 & 0xFFFF) + (bits >> 48)
        return (total + 6.0) / 65536.0 - 6.0

    def _bits(self) -> int:
        a, b, c, d = self.state
        total = a + d & WORD
        result = ((total << 23 | total >> 41) + a) & WORD
        c, d = c ^ a, d ^ b
        b, a = b ^ c, a ^ d
        c ^= self.state[1] << 17 & WORD
        self.state = [a, b, c, (d << 45 | d >> 19) & WORD]
        return result
