"""Starts of a fit, from frequency-domain subspaces of several sizes; nothing to tune.

The subspace (`frequency_subspace`) is mostly made larger than the fit, so that the extra poles take up delay,
noise and modes that are not asked for, and the modes that would be missed most are kept (`prune`).

Input vectors are the rank-one parts of residues of any rank, solved for at the poles. Where poles are closer
than the band can tell apart, such residues are noise; a subspace of the right size then gives its own output
vectors, and input vectors follow from those (`drive_vectors`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
import scipy.linalg
from jaxtyping import Bool, Complex, Float

from middeck.identification.model.fit_options import FitOptions
from middeck.identification.problem.data import Data
from middeck.identification.problem.residual_and_slopes import build_terms
from middeck.identification.problem.terms import columns, fractions, shapes
from middeck.identification.problem.transient_projection import as_real
from middeck.identification.problem.unknowns_layout import Layout, Point, Start, pack
from middeck.identification.start.frequency_subspace import block_rows, prune, subspace_modes, subspace_poles
from middeck.identification.start.vector_fitting import relocate

# Size of the subspace as a multiple of the states kept, and its block rows as a multiple of the least.
REAL_SIZES = tuple((size, rows) for size in (1.0, 1.5, 2.0) for rows in (1.5, 2.0, 3.0))
COMPLEX_SIZES = ((1.5, 1.5), (2.0, 1.5), (1.5, 2.0), (2.0, 2.0), (1.0, 2.0))
# One start more with complex constants: a subspace whose poles vector fitting moves on so many times.
RELOCATED_SIZE, RELOCATIONS = (1.25, 1.5), 3
# And some with the subspace's own vectors: block rows as a multiple of the least. More rows average more
# noise, and show whether there are modes far below or above the others.
OWN_ROWS = (2.0, 3.0, 4.0)
# Delays tried, in steps of this share of the shortest period in the band.
DELAY_STEP = 0.125
# First tried on either side of zero, and the share of the response that a right delay explains.
FIRST_DELAYS = 64
ENOUGH = 0.5
# A band from f to less than so many times f is narrow: delays half a period apart look alike in it, and the
# steps are finer by this factor. One that leaves a third or more of what the promptest leaves is not tried.
NARROW, FINER, HOPELESS = 2.0, 64, 3.0
# Peaks of what delays explain that are climbed: at least, and times lines; and steps of Newton's method.
FEWEST_PEAKS, PEAKS_TIMES_LINES, CLIMBS = 8, 2**17, 3
# What a grid of those steps misses of a peak half a step away, over the most that it shows anywhere: by
# Bernstein's inequality for the second derivative of a sum of a limited band.
MISSED = 1.0 / ((np.pi * DELAY_STEP) ** -2 - 1.0)
# Lines that are closer than so small a share of the band are taken for one when delays are tried.
MOST_LINES = 2**15
# Damping ratio above which a candidate is no mode of a structure but takes up delay or noise.
HEAVY = 0.3


def starts(data: Data, options: FitOptions) -> Iterator[Start]:
    """First guesses, from several sizes of the subspace."""
    for size, rows in REAL_SIZES if options.real_constants else COMPLEX_SIZES:
        found = _sized_poles(data, options, size, rows)
        yield from () if found is None else starts_from(data, options, found)
    if not options.real_constants:
        found = _sized_poles(data, options, *RELOCATED_SIZE)
        if found is not None:
            moved = relocate(data, found, options.period_s, iterations=RELOCATIONS)
            yield from starts_from(data, options, moved)
        for rows in OWN_ROWS if _has_vectors(data, options) else ():
            yield from _own_start(data, options, rows)


def few_starts(data: Data, options: FitOptions) -> Iterator[Start]:
    """One or two starts, enough where many orders are compared.

    Modes far below a band that is mapped to the circle need the subspace's own vectors; in a sampled model's,
    the whole circle is even, and the first start will do.
    """
    sizes = REAL_SIZES if options.real_constants else COMPLEX_SIZES
    found = _sized_poles(data, options, *sizes[0])
    yield from () if found is None else starts_from(data, options, found)
    if not options.real_constants and not options.period_s and _has_vectors(data, options):
        yield from _own_start(data, options, OWN_ROWS[-1])


def _has_vectors(data: Data, options: FitOptions) -> bool:
    return data.drive is None and data.H.shape[2] > 1 and not options.full_rank and not options.at_zero


def _own_start(data: Data, options: FitOptions, factor: float) -> Iterator[Start]:
    """The subspace model of the right size as it is, its input vectors by least squares."""
    rows = block_rows(data, options.moving, factor)
    found = subspace_modes(data, options.period_s, states=options.moving, rows=rows)
    if found is None:
        return
    poles, pair = upper_half(found[0], options.period_s)
    shapes = found[1][:, [int(np.argmin(np.abs(found[0] - pole))) for pole in poles]]
    b = drive_vectors(data, options, poles, pair, shapes)
    yield start_at(data, options, poles, pair, np.zeros((len(data.H), 1)), b)


def starts_from(data: Data, options: FitOptions, found: Complex[np.ndarray, " state"]) -> Iterator[Start]:
    """Starts (or none) at the modes among candidate poles ``found`` that would be missed most."""
    if options.real_constants:
        yield from _real_starts(data, options, found)
        return
    yield from _complex_starts(data, options, found)


def _sized_poles(data: Data, options: FitOptions, size: float, rows: float) -> np.ndarray | None:
    # An odd number of states asks for an odd number of real poles.
    order = options.moving + options.at_zero + 2 * round(0.5 * (size - 1.0) * options.moving)
    return next(subspace_poles(data, options.period_s, [order], block_rows(data, order, rows)), None)


def _complex_starts(data: Data, options: FitOptions, found: np.ndarray) -> Iterator[Start]:
    """The strongest poles of the subspace, each with the rank-one part of its residue.

    Without a delay, and at the best ones of each output: the residues take up a short delay, not a long one.
    """
    poles, pair = upper_half(found, options.period_s)
    prompt = np.zeros((len(data.H), 1))
    delays = [prompt]
    if options.delay_of:
        delays += list(_first_delays(data, options, _one_by_one(data, options, poles, pair)[2]))
    states = [int(n) for n in np.where(pair, 2, 1)]
    if sum(states) == options.moving:
        yield from (start_at(data, options, poles, pair, delay_s) for delay_s in delays)
        return
    start = start_at(data, options, poles, pair, prompt)
    terms = build_terms(start.layout, data, start.theta)
    if terms is None:
        return
    line, level = _weights_alike(data)
    modes = [start.layout.columns_of(m) for m in range(len(pair))]
    rows = as_real(terms.X * line).T
    for delay_s in delays:
        target = data.H * np.exp(data.s[:, None] * delay_s[:, None]) * level * line
        kept = prune(rows, as_real(target).T, modes, states, options.moving)
        if kept is not None:
            yield start_at(data, options, poles[kept], pair[kept], delay_s)


def upper_half(
    poles: Complex[np.ndarray, " state"], period_s: float
) -> tuple[Complex[np.ndarray, " mode"], Bool[np.ndarray, " mode"]]:
    """One of each conjugate pair, by frequency, then the real poles; and which are pairs."""
    nyquist = np.pi / period_s if period_s else np.inf
    imag = np.imag(poles)
    single = (imag == 0.0) | (np.abs(imag) >= nyquist * (1.0 - 1e-9))
    upper = poles[~single & (imag > 0.0)]
    upper = upper[np.argsort(np.imag(upper))]
    real = poles[single]
    both = np.concatenate([upper, np.real(real) + 1j * np.abs(np.imag(real))])
    return both, np.arange(len(both)) < len(upper)


def start_at(
    data: Data,
    options: FitOptions,
    poles: np.ndarray,
    pair: np.ndarray,
    delay_s: np.ndarray,
    vectors: Complex[np.ndarray, "mode input"] | None = None,
) -> Start:
    """A start at given poles and delays [output, path]; input vectors from the data, unless given."""
    none = np.zeros((0, data.H.shape[2]))
    b, psi = _input_vectors(data, options, poles, pair, delay_s) if vectors is None else (vectors, none)
    return start_from_point(options, pair, Point(poles, b, delay_s, psi), len(data.H))


def start_from_point(
    options: FitOptions, pair: Bool[np.ndarray, " mode"], point: Point, outputs: int
) -> Start:
    """A start at a point whose vectors have any scale."""
    psi = np.zeros((0, point.b.shape[1])) if point.psi is None else point.psi
    rigid = min(options.rigid, len(psi))
    layout = Layout(
        pair=pair,
        fixed_imag=np.where(pair, 0.0, np.imag(point.poles)),
        pivot=np.argmax(np.abs(point.b), axis=1),
        inputs=point.b.shape[1],
        outputs=outputs,
        options=options,
        rigid_pivot=_largest(psi[:rigid]),
        integral_pivot=_largest(psi[rigid:]),
    )
    return Start(layout, pack(layout, point))


def _largest(psi: Float[np.ndarray, "row input"]) -> tuple[int, ...]:
    """Indices of as many inputs as rows, whose columns are farthest from dependent."""
    return tuple(int(i) for i in scipy.linalg.qr(psi, mode="r", pivoting=True)[-1][: len(psi)])


def _input_vectors(
    data: Data, options: FitOptions, poles: np.ndarray, pair: np.ndarray, delay_s: np.ndarray
) -> tuple[Complex[np.ndarray, "mode input"], Float[np.ndarray, "rigid input"]]:
    """b and psi: the dominant right singular vectors of full residue matrices, of 1/s^2 and 1/s also."""
    inputs = data.H.shape[2]
    if inputs == 1:
        return np.ones((len(poles), 1), dtype=complex), np.ones((options.rigid + options.integrators, 1))
    residues, double, single = weighted_residues(data, options, poles, pair, delay_s)
    if options.real_constants:
        residues[pair] *= 2j * np.imag(poles)[pair, None, None]
    b = _scaled(np.linalg.svd(residues)[2][:, 0])
    b = np.where((pair & (not options.real_constants))[:, None], b, np.real(b))
    rigid, integral = (np.linalg.svd(x)[2] for x in (double, single))
    return b, np.vstack([rigid[: options.rigid], integral[: options.integrators]])


def _scaled(b: Complex[np.ndarray, "mode input"]) -> Complex[np.ndarray, "mode input"]:
    """Each vector over its largest entry."""
    return b / np.take_along_axis(b, np.argmax(np.abs(b), axis=1)[:, None], axis=1)


def drive_vectors(
    data: Data, options: FitOptions, poles: np.ndarray, pair: np.ndarray, shapes: np.ndarray
) -> Complex[np.ndarray, "mode input"]:
    """b of given poles and output vectors ``shapes`` [output, mode], by least squares on all outputs."""
    layout, _, X = _one_by_one(data, options, poles, pair)
    pairs, inputs = int(np.sum(pair)), data.H.shape[2]
    own, constant = X[: layout.mode_columns], X[layout.mode_columns :]
    first, second, single = own[0 : 2 * pairs : 2], own[1 : 2 * pairs : 2], own[2 * pairs :]
    rows: list[np.ndarray] = []
    targets: list[np.ndarray] = []
    for o, c in enumerate(shapes):
        # c b u + conj(c b) l of each pair, by the real and by the imaginary part of b.
        re, im = np.real(c[:pairs, None]), np.imag(c[:pairs, None])
        by_b = np.concatenate(
            [re * first + im * second, re * second - im * first, np.real(c[pairs:, None]) * single]
        )
        weight = np.sqrt(np.mean(data.weight[o] ** 2, axis=1))
        A, y, free = (as_real((v * weight)[:, :, None]).T for v in (by_b, data.H[o].T, constant))
        Q = np.linalg.qr(free)[0]
        rows.append(A - Q @ (Q.T @ A))
        targets.append(y - Q @ (Q.T @ y))
    stacked = np.concatenate(rows)
    size = np.linalg.norm(stacked, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    x = np.linalg.lstsq(stacked / size, np.concatenate(targets), rcond=None)[0] / size[:, None]
    b = np.zeros((len(poles), inputs), dtype=complex)
    b[:pairs] = x[:pairs] + 1j * x[pairs : 2 * pairs]
    b[pairs:] = x[2 * pairs :]
    return _scaled(b)


def weighted_residues(
    data: Data, options: FitOptions, poles: np.ndarray, pair: np.ndarray, delay_s: np.ndarray
) -> tuple[
    Complex[np.ndarray, "mode output input"],
    Float[np.ndarray, "output input"],
    Float[np.ndarray, "output input"],
]:
    """Residues of any rank at given poles, of 1/s^2 and of 1/s; each output times its weight."""
    outputs, _, inputs = data.H.shape
    layout, point, X = _one_by_one(data, options, poles, pair)
    residues = np.zeros((len(poles), outputs, inputs), dtype=complex)
    double, single = np.zeros((2, outputs, inputs))
    at = layout.mode_columns
    prompt = data.H * np.exp(data.s[:, None] * delay_s[:, None])
    for o in range(outputs):
        weight = np.sqrt(np.mean(data.weight[o] ** 2, axis=1))
        A = np.ascontiguousarray(X * weight).view(float).T
        y = np.ascontiguousarray((prompt[o] * weight[:, None]).T).view(float).T
        x = np.linalg.lstsq(A, y, rcond=None)[0]
        # A weight for the output makes rows of unlike units comparable.
        level = np.sqrt(np.mean(weight**2))
        residues[:, o] = level * np.array([shapes(layout, point, x[:, i]) for i in range(inputs)]).T
        if layout.integral_pivot:
            single[o] = level * x[at]
        if layout.options.residuals:
            double[o] = level * x[at + len(layout.integral_pivot)]
    return residues, double, single


def _one_by_one(
    data: Data, options: FitOptions, poles: np.ndarray, pair: np.ndarray
) -> tuple[Layout, Point, Complex[np.ndarray, "column line"]]:
    """The columns of a single entry of H: every entry has residues of its own."""
    layout = Layout(
        pair=pair,
        fixed_imag=np.where(pair, 0.0, np.imag(poles)),
        pivot=np.zeros(len(poles), dtype=int),
        inputs=1,
        outputs=1,
        options=dataclasses.replace(
            options,
            delay=False,
            full_rank=False,
            relative_degree=None,
            residuals=options.residuals or options.rigid > 0,
        ),
        integral_pivot=(0,) if options.integrators else (),
    )
    point = Point(
        poles,
        np.ones((len(poles), 1), dtype=complex),
        np.zeros((1, 1)),
        np.ones((len(layout.integral_pivot), 1)),
    )
    return layout, point, columns(layout, point, fractions(layout, poles, data.s), data.s)[:, :, 0]


def _real_starts(data: Data, options: FitOptions, found: np.ndarray) -> Iterator[Start]:
    """The strongest oscillating modes among the candidates, at the best delays of each output.

    Heavily damped ones are tried too, only where the others explain little at any delay: a loop about the
    article has such modes. In a narrow band they stand for phase, as a delay does.
    """
    poles = found[np.imag(found) > 0.0]
    poles = poles[np.argsort(np.imag(poles))]
    started, explained = _starts_among(data, options, poles[-np.real(poles) < HEAVY * np.abs(poles)])
    if explained < ENOUGH and data.omega[-1] >= NARROW * data.omega[0]:
        started += _starts_among(data, options, poles)[0]
    yield from started


def _starts_among(
    data: Data, options: FitOptions, poles: Complex[np.ndarray, " mode"]
) -> tuple[list[Start], float]:
    """Starts at the strongest of these pairs, none where they are too few, and the part that all explain."""
    if not len(poles):
        return [], 0.0
    pair, wanted = np.ones(len(poles), dtype=bool), options.moving // 2
    _, _, X = _one_by_one(data, options, poles, pair)
    line, level = _weights_alike(data)
    modes = [np.array([m]) for m in range(len(poles))]
    rows = as_real((X * line[:, 0])[:, :, None]).T
    Q = np.linalg.qr(rows)[0]
    started, explained = list[Start](), 0.0
    for delay_s in _first_delays(data, options, X):
        prompt = np.moveaxis(data.H * np.exp(data.s[:, None] * delay_s[:, None]) * level * line, 1, 2)
        targets = as_real(prompt.reshape(-1, len(data.s))[:, :, None]).T
        explained = max(explained, float(np.sum((Q.T @ targets) ** 2) / np.sum(targets**2)))
        kept = prune(rows, targets, modes, [2] * len(poles), options.moving) if len(poles) >= wanted else None
        if kept is not None:
            started.append(start_at(data, options, poles[kept], pair[kept], delay_s))
    return started, explained


def _first_delays(
    data: Data, options: FitOptions, X: Complex[np.ndarray, "column line"]
) -> Iterator[Float[np.ndarray, "output path"]]:
    """The best delays, the shortest that may do first; then those that explain far more, if any."""
    outputs, _, inputs = data.H.shape
    if not options.delay_of:
        yield np.zeros((outputs, 1))
        return
    groups = [[i] for i in range(inputs)] if options.delay_of == "path" else [list(range(inputs))]
    delays = np.array([[_best_delays(data, X, o, g) for g in groups] for o in range(outputs)])
    if options.delay_of == "common":
        delays = np.broadcast_to(np.median(delays, axis=0), delays.shape)
    yield delays[..., 0]
    if np.any(delays[..., 1] != delays[..., 0]):
        yield delays[..., 1]


def _best_delays(
    data: Data, X: Complex[np.ndarray, "column line"], output: int, inputs: list[int]
) -> tuple[float, float]:
    """The delay (negative: a lead) on a grid at which real constants explain most of some entries.

    The grid grows to half the record until most is explained: longer delays need closer lines.
    In a narrow band half a period more or less is little else than a change of sign, which constants take up:
    there the best delay from zero to half a period comes first, the best of all only if it leaves far less.
    """
    omega = data.omega
    weight = np.sqrt(np.mean(data.weight[output] ** 2, axis=1))
    target = data.H[output][:, inputs] * weight[:, None]
    products = _products(X * weight, target)
    tau, explained = _explained(omega, products)
    count, whole = FIRST_DELAYS, np.sum(np.abs(target) ** 2)
    while True:
        near = np.arange(-min(count, len(tau) // 2), min(count, len(tau) // 2))
        best = near[int(np.argmax(explained[near]))]
        if explained[best] > ENOUGH * whole or 2 * count >= len(tau):
            break
        count *= 4
    if omega[-1] >= NARROW * omega[0]:
        least = float(explained[best] - MISSED * explained.max())
        right = _at_peaks(omega, products, tau[near], explained[near], least)
        return right, right
    half = 2.0 * np.pi / (omega[0] + omega[-1])
    soon, of_soon = _sharpened(omega, products, np.arange(0.0, half, tau[1] / FINER))
    other, of_other = _sharpened(omega, products, tau[best] + tau[1] * np.arange(-1.0, 1.0, 1.0 / FINER))
    return soon, other if HOPELESS * (whole - of_other) < whole - of_soon else soon


def _products(X: Complex[np.ndarray, "column line"], target: np.ndarray) -> np.ndarray:
    """conj(Q_l) y_l of each line l, on the orthonormal Q of the columns."""
    Q = np.linalg.qr(np.ascontiguousarray(X).view(float).T)[0]
    products = (Q[0::2] - 1j * Q[1::2])[:, :, None] * target[:, None, :]
    return products.reshape(len(target), -1)


def _explained(
    omega: np.ndarray, products: Complex[np.ndarray, "line product"]
) -> tuple[np.ndarray, np.ndarray]:
    """Delays, those of leads last, and the squares that are explained of the target less each of them.

    All at once: they are |Re sum_l conj(Q_l) y_l exp(j omega_l tau)|^2 (`_products`), a Fourier transform of
    lines put on an even grid.
    """
    step = max(float(np.min(np.diff(omega), initial=omega[-1])), omega[-1] / MOST_LINES)
    place = np.round(omega / step).astype(int)
    count = 2 ** int(np.ceil(np.log2(omega[-1] / step / DELAY_STEP)))
    on_grid = np.zeros((count // 2 + 1, products.shape[1]), dtype=complex)
    # Half of each line but that at zero: the other half is its conjugate's.
    np.add.at(on_grid, place, np.where(place > 0, 0.5, 1.0)[:, None] * products)
    tau = 2.0 * np.pi / step * np.fft.fftfreq(count)
    along = np.fft.irfft(on_grid, count, axis=0, norm="forward")
    return tau, np.einsum("dp,dp->d", along, along)


def _at_peaks(
    omega: np.ndarray,
    products: Complex[np.ndarray, "line product"],
    tau: Float[np.ndarray, " delay"],
    explained: Float[np.ndarray, " delay"],
    least: float,
) -> float:
    """The grid point at the peak that explains most, of the highest ones, each climbed by Newton's method.

    Modes of light damping are a few lines each, so that many delays suit the phases of two or three of them:
    what the grid misses of the right delay is more than what such another one leaves. Points of the grid
    that explain less than ``least`` are beside no such peak.
    """
    high = (explained >= np.roll(explained, 1)) & (explained >= np.roll(explained, -1))
    peaks = np.flatnonzero(high & (explained >= least))
    most = max(FEWEST_PEAKS, PEAKS_TIMES_LINES // len(omega))
    highest, step = tau[peaks[np.argsort(-explained[peaks])[:most]]], tau[1] - tau[0]
    at = highest
    derivatives = [products * (1j * omega[:, None]) ** order for order in range(3)]
    for _ in range(CLIMBS):
        turned = np.exp(1j * np.outer(at, omega))
        size, rate, bend = (np.real(turned @ x) for x in derivatives)
        slope, curvature = np.sum(size * rate, axis=1), np.sum(rate**2 + size * bend, axis=1)
        top = -curvature * step > np.abs(slope)  # else no peak is within a step
        at = at - np.divide(slope, curvature, out=np.zeros_like(at), where=top)
    reached = np.sum(np.real(np.exp(1j * np.outer(at, omega)) @ products) ** 2, axis=1)
    return float(highest[np.argmax(reached)])


def _sharpened(
    omega: np.ndarray, products: Complex[np.ndarray, "line product"], tau: Float[np.ndarray, " delay"]
) -> tuple[float, float]:
    """The best of a few delays, on the lines where they are, and the squares it explains."""
    explained = np.sum(np.real(np.exp(1j * np.outer(tau, omega)) @ products) ** 2, axis=1)
    best = int(np.argmax(explained))
    return float(tau[best]), float(explained[best])


def _weights_alike(data: Data) -> tuple[Float[np.ndarray, "line one"], Float[np.ndarray, "output one one"]]:
    """A weight for each line and one for each output, so that all outputs have the same columns."""
    line = np.sqrt(np.mean(data.weight**2, axis=(0, 2)))[:, None]
    return line, np.sqrt(np.mean(data.weight**2, axis=(1, 2)))[:, None, None]
