"""Covariance of all unknowns of a fitted model: the Cramer-Rao value, or one from the residual.

With weights 1 / V the information is A = sum Re J^H V^-1 J, and if V is the variance of a complex residual,
half of it in each part, the covariance is A^-1 / 2. Where the model leaves significantly more than noise, or
neighbouring lines of a response were estimated from common samples (local models, averaged spectra), the
residual is not of variance V or not independent from line to line: then A^-1 B A^-1 is taken instead, with
B the covariance of the scores as the residual shows it (`_scores_spread`), in no direction less than the
former. A is never formed: what is inverted is an orthogonal factor of J (`orthogonal`). Noise that entries of
H have in common is counted (`response_derivatives`).
"""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.model.measurement_model import MeasurementModel, model_response
from middeck.identification.spectra.excess_variance import (
    INDEPENDENT,
    averaged_degrees,
    by_output,
    inverse_bias,
    line_degrees,
)
from middeck.identification.uncertainty import orthogonal
from middeck.identification.uncertainty.common_noise import common_noise, common_scores
from middeck.identification.uncertainty.model_unknowns import (
    ModelStructure,
    UnknownPlaces,
    places_of,
    ties,
    unknowns_of,
)
from middeck.identification.uncertainty.response_derivatives import (
    EntrySlopes,
    entry_factors,
    entry_slopes,
    shared_functions,
)
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

# Standard deviations by which the mean square residual must exceed noise before it is no longer taken for it.
CLEARLY_MORE = 3.0
# A line that determines an unknown alone leaves no residual: its leverage is counted up to here.
MOST_LEVERAGE = 0.9
# Lines taken together: their functions stay in a processor's cache.
CHUNK = 256
# A modal constant is real if its imaginary part is no more than rounding.
ROUNDING = 1e-9


@record(kw_only=True)
class ModelCovariance:
    """Joint uncertainty of the unknowns of a model.

    Attributes:
        model, structure: The fitted model; its unknowns and their order are those of `unknowns`.
        root: R of their covariance R R^T: deviations that come from it keep the digits that those from the
            matrix lose where unknowns are hardly distinguished. Lower triangular, but for what is loose.
        inflation: Variance of each unknown over its variance if all others were known.
        degrees: Degrees of freedom of the variance behind it: Student's t, and F, stand for the normal law.
        robust: True where the residual is clearly more than noise or correlated from line to line, or a
            record's weights are not those of noise, and the covariance follows the residual.
        loose: Number of last columns of ``root`` that are directions in which the data do not fix the
            unknowns.
    """

    model: MeasurementModel
    structure: ModelStructure
    root: Float[np.ndarray, "unknown direction"]
    inflation: Float[np.ndarray, " unknown"]
    degrees: float
    robust: bool
    loose: int = 0

    @functools.cached_property
    def at(self) -> UnknownPlaces:
        """Places of each kind of unknown."""
        return places_of(self.model, self.structure)

    @functools.cached_property
    def unknowns(self) -> Float[np.ndarray, " unknown"]:
        """Values of the unknowns."""
        return unknowns_of(self.model, self.structure)

    @functools.cached_property
    def matrix(self) -> Float[np.ndarray, "unknown unknown"]:
        """The covariance itself; large, but finite, where unknowns are not fixed."""
        return self.root @ self.root.T

    @property
    def fixed(self) -> Float[np.ndarray, "unknown direction"]:
        """The root without its loose columns."""
        return self.root[:, : self.root.shape[1] - self.loose]

    def deviation(self, slope: Float[np.ndarray, "row unknown"] | None = None) -> Float[np.ndarray, " row"]:
        """Standard deviation of a quantity with these derivatives by the unknowns, or of each unknown.

        Infinite where the data do not fix it: where more of it is loose than is not, for what rounding leaves
        of a loose direction is no more; or, beside a loose direction, where what is fixed of it is told from
        the other unknowns so badly that rounding turns the two into each other (two modes a share d of their
        width apart have directions of d, d^2 and d^3).
        """
        slope = np.eye(len(self.root)) if slope is None else slope
        fixed, loose = np.split(slope @ self.root, [self.fixed.shape[1]], axis=1)
        known = np.linalg.norm(fixed, axis=1)
        if not self.loose:
            return known
        alone = np.linalg.norm(slope * (np.linalg.norm(self.root, axis=1) / np.sqrt(self.inflation)), axis=1)
        sure = (np.linalg.norm(loose, axis=1) <= known) & (np.cbrt(orthogonal.LOOSE) * known <= alone)
        return np.where(sure, known, np.inf)


def estimate_covariance(
    model: MeasurementModel,
    structure: ModelStructure,
    measured: FrequencyResponse,
    *,
    assumed: Float[np.ndarray, "output line input"],
    noise: Float[np.ndarray, "output line input"],
) -> ModelCovariance:
    """The covariance of a weighted least-squares fit at its end.

    Args:
        measured: The fitted response.
        assumed: The variance whose inverse weighed the residual, of real and imaginary part together.
        noise: The part of it that was measured, averaged over neighbouring lines; without a measured variance
            it is not looked at.
    """
    s = 2j * np.pi * measured.frequency_hz
    each = _Entries(model, structure, s, assumed)
    F = each.factor()
    inverse, loose = orthogonal.inverse_root(F, ties(model, structure))
    inflation = np.maximum(np.linalg.norm(F, axis=0) * np.linalg.norm(inverse, axis=1), 1.0) ** 2
    W, free = np.split(inverse, [inverse.shape[1] - loose], axis=1)
    residual = by_output(measured.H - model_response(model, measured.frequency_hz))
    degrees, robust = _quality(measured, residual, noise, unknowns=len(W))
    root = np.sqrt(0.5) * W
    common = None if robust else common_noise(measured, 0.5 * degrees)
    if common is not None:
        flat = (v.mT.reshape(-1, len(s)) for v in (assumed, noise))
        root = W @ orthogonal.root_of(common_scores(each.slopes(), W, common, *flat))
    if robust:
        least: np.ndarray | float = 0.5
        # Else the window is known, and `scatter_of_blows` counts it.
        if measured.alike in (None, INDEPENDENT):
            least = orthogonal.root_of(_scores_if_alike(each, residual, W), least)
        root = W @ orthogonal.root_of(_scores_spread(each, residual, W), least)
    root = np.hstack([orthogonal.canonical_root(root), np.sqrt(0.5) * free])
    return ModelCovariance(
        model=model,
        structure=structure,
        root=root,
        inflation=inflation,
        degrees=degrees,
        robust=robust,
        loose=loose,
    )


class _Entries:
    """Derivatives of all entries of H, by their factors; lines are taken some at a time."""

    def __init__(
        self, model: MeasurementModel, structure: ModelStructure, s: np.ndarray, variance: np.ndarray
    ) -> None:
        self.model, self.structure, self.s, self.variance = model, structure, s, variance
        at = places_of(model, structure)
        self.unknowns = at.size
        outputs, inputs = model.direct.shape
        self.factors = {
            (o, i): entry_factors(model, structure, at, o, i) for o in range(outputs) for i in range(inputs)
        }

    def slopes(self) -> Iterator[EntrySlopes]:
        """Each entry's derivatives as they are."""
        return (entry_slopes(self.model, self.structure, self.s, o, i) for o, i in self.factors)

    def some_lines(self) -> Iterator[tuple[slice, Complex[np.ndarray, "function line"]]]:
        """Some lines, and the functions of all entries on them."""
        for first in range(0, len(self.s), CHUNK):
            lines = slice(first, first + CHUNK)
            yield lines, shared_functions(self.model, self.structure, self.s[lines])

    def weighted(
        self, entry: tuple[int, int], lines: slice, shared: np.ndarray
    ) -> Complex[np.ndarray, "function line"]:
        """Functions of an entry over its deviation; its delay, that would turn all alike, left out."""
        size = np.sqrt(self.variance[entry[0], lines, entry[1]])
        return self.factors[entry].functions(shared, self.s[lines]) / size

    def factor(self) -> Float[np.ndarray, "row unknown"]:
        """Orthogonal factor of the derivatives of all entries by all unknowns."""
        return orthogonal.factor_of(self._blocks())

    def _blocks(self) -> Iterator[Float[np.ndarray, "row unknown"]]:
        """The derivatives of one output at a time."""
        functions: dict[tuple[int, int], np.ndarray] = {}
        for lines, shared in self.some_lines():
            for entry in self.factors:
                f = self.weighted(entry, lines, shared).view(float).T
                before = functions.get(entry)
                functions[entry] = orthogonal.triangle(f if before is None else np.vstack([before, f]))
        for o in range(len(self.model.direct)):
            rows = [np.zeros((0, self.unknowns))]
            for (output, i), R in functions.items():
                if output == o:
                    rows.append(np.zeros((len(R), self.unknowns)))
                    rows[-1][:, self.factors[o, i].place] = R @ self.factors[o, i].by.T
            yield np.vstack(rows)


def _quality(
    measured: FrequencyResponse, residual: np.ndarray, noise: np.ndarray, unknowns: int
) -> tuple[float, bool]:
    """Degrees of freedom, and whether the residual is more than noise or not independent.

    The mean of the inverse of an averaged variance is larger than that of the variance (`inverse_bias`).
    """
    numbers = 2.0 * residual.size
    if measured.variance is None:
        return max(numbers - unknowns, 1.0), True
    averaged = averaged_degrees(measured)
    z = residual / np.sqrt(noise)
    power = np.abs(z) ** 2
    by_chance = np.sqrt((1.0 + 1.0 / line_degrees(measured)) * (measured.alike or 1.0) / z.size)
    more = float(np.mean(power)) / inverse_bias(averaged) - 1.0 > CLEARLY_MORE * by_chance
    next_line = abs(float(np.sum(np.real(z[:, 1:] * z[:, :-1].conj()))))
    return 2.0 * averaged, more or next_line > CLEARLY_MORE / np.sqrt(z.size) * float(np.sum(power))


def _scores_spread(
    each: _Entries, residual: np.ndarray, W: Float[np.ndarray, "unknown direction"]
) -> Float[np.ndarray, "direction direction"]:
    """Covariance of the scores in the directions W, heteroscedastic and correlated over lines.

    White (1980) with MacKinnon and White's (1985) correction of each residual for its leverage, and Newey
    and West's (1987) weights over as many lines as the residual stays correlated.
    """
    scores = np.zeros((each.unknowns, residual.shape[1]))
    # |T f|^2 is the leverage of f.
    hats = {k: orthogonal.triangle(W[e.place].T @ e.by) for k, e in each.factors.items()}
    for lines, shared in each.some_lines():
        for (o, i), entry in each.factors.items():
            f = each.weighted((o, i), lines, shared)
            r = residual[o, lines, i] * np.exp(each.s[lines] * entry.delay_s)
            re, im = np.real(f).copy(), np.imag(f).copy()
            left = _without_leverage(re, im, hats[o, i], r / np.sqrt(each.variance[o, lines, i]))
            scores[entry.place, lines] += entry.by @ (re * np.real(left) + im * np.imag(left))
    # The weights 1 - |lag| / width are a window of so many lines, convolved with itself.
    lags = 2 * len(_correlations(residual / np.sqrt(each.variance)))
    width = min(lags, residual.shape[1] // 10) + 1
    sums = np.cumsum(np.pad(W.T @ scores, ((0, 0), (width, width - 1))), axis=1)
    windows = sums[:, width:] - sums[:, :-width]
    return windows @ windows.T / width


def _scores_if_alike(
    each: _Entries, residual: np.ndarray, W: Float[np.ndarray, "unknown direction"]
) -> Float[np.ndarray, "direction direction"]:
    """The same for noise of the assumed variance with one correlation between lines, alike on all of them.

    On the few lines of a narrow peak the residual itself is no measure of the noise: the fit follows them.
    """
    rho = _correlations(residual / np.sqrt(each.variance))
    if not len(rho) or abs(rho[0]) <= CLEARLY_MORE / np.sqrt(residual.size):  # may be chance
        return 0.5 * np.eye(W.shape[1])
    size = 2 ** int(np.ceil(np.log2(CHUNK + 2 * len(rho) + 1)))
    kernel = np.fft.fft(np.concatenate([[0.0], rho]), size)
    before = dict[tuple[int, int], np.ndarray]()
    both = {entry: np.zeros((by.by.shape[1],) * 2) for entry, by in each.factors.items()}
    for lines, shared in each.some_lines():
        for entry, its in each.factors.items():
            f = each.weighted(entry, lines, shared) * np.exp(-each.s[lines] * its.delay_s)
            joined = np.hstack([before.get(entry, np.zeros((len(f), len(rho)))), f])
            before[entry] = joined[:, joined.shape[1] - len(rho) :]
            earlier = np.fft.ifft(np.fft.fft(joined, size, axis=1) * kernel, axis=1)
            both[entry] += np.real(earlier[:, len(rho) : joined.shape[1]] @ f.conj().T)
    spread = 0.5 * np.eye(W.shape[1])
    for entry, its in each.factors.items():
        rows = W[its.place].T @ its.by
        spread += 0.5 * rows @ (both[entry] + both[entry].T) @ rows.T
    return spread


def _without_leverage(
    re: Float[np.ndarray, "function line"],
    im: Float[np.ndarray, "function line"],
    hat: Float[np.ndarray, "row function"],
    r: Complex[np.ndarray, " line"],
) -> Complex[np.ndarray, " line"]:
    """(I - h)^-1 r on each line, h the 2 x 2 block of the hat matrix, |hat f|^2, for real and imaginary part.

    Of h, whose eigenvalues are m + d and m - d, a function is its mean at these and half of its difference
    times (h - m I) / d, which turns r into (a + j b) conj(r) / d, a half the difference of the diagonal.
    """
    by_re, by_im = hat @ re, hat @ im
    first, second = np.sum(by_re**2, axis=0), np.sum(by_im**2, axis=0)
    middle, apart = 0.5 * (first + second), 0.5 * (first - second) + 1j * np.sum(by_re * by_im, axis=0)
    size = np.abs(apart)
    more, less = (1.0 / (1.0 - np.clip(middle + d, 0.0, MOST_LEVERAGE)) for d in (size, -size))
    turned = apart / np.maximum(size, np.finfo(float).tiny) * r.conj()
    return 0.5 * (more + less) * r + 0.5 * (more - less) * turned


def _correlations(z: Complex[np.ndarray, "output line input"]) -> Float[np.ndarray, " lag"]:
    """Correlation with the next lines, up to the first that is not significant; a tenth of all at most."""
    power, lines = float(np.sum(np.abs(z) ** 2)), z.shape[1]
    found: list[float] = []
    for lag in range(1, lines // 10 + 1):
        both = float(np.sum(np.real(z[:, lag:] * z[:, :-lag].conj()))) / power
        if abs(both) <= 2.0 / np.sqrt(z.size):
            break
        found.append(both * lines / (lines - lag))
    return np.array(found)


def as_exact(model: MeasurementModel) -> ModelCovariance:
    """A model without a record, such as the one a controller was designed on: nothing in it is uncertain."""
    unit = np.where(model.is_pair, 1j, 1.0)
    constants = (model.shapes * unit)[:, :, None] * model.participation
    real = bool(np.all(np.abs(np.imag(constants)) <= ROUNDING * np.abs(constants)))
    delay, lower, direct = (bool(np.any(part)) for part in (model.delay_s, model.lower, model.direct))
    structure = ModelStructure(real_constants=real, with_delay=delay, with_lower=lower, with_direct=direct)
    size = places_of(model, structure).size
    return ModelCovariance(
        model=model,
        structure=structure,
        root=np.zeros((size, size)),
        inflation=np.ones(size),
        degrees=np.inf,
        robust=False,
    )


def draw_errors(
    covariance: ModelCovariance, count: int, rng: np.random.Generator
) -> Float[np.ndarray, "unknown draw"]:
    """Errors of the unknowns, jointly: normal, or Student's multivariate t for an uncertain variance.

    Along directions that the data do not fix nothing is drawn.
    """
    normal = covariance.fixed @ rng.standard_normal((covariance.fixed.shape[1], count))
    if np.isinf(covariance.degrees):
        return normal
    return normal * np.sqrt(covariance.degrees / rng.chisquare(covariance.degrees, count))
