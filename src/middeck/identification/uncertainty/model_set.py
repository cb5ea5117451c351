"""Sets of models that the data cannot distinguish from the fitted one, for designs that hold for all."""

import numpy as np

from middeck.errors import ConfigError
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.uncertainty.covariance import ModelCovariance, draw_errors
from middeck.identification.uncertainty.model_unknowns import model_at
from middeck.identification.uncertainty.response_drift import check_channels

# Deviation of the logarithm of a decay rate, and of a delay's phase [rad] at the highest mode, beyond which a
# linearised covariance says nothing of the ends of its distribution.
LARGEST = 1.0


def sample_models(
    *covariances: ModelCovariance, count: int, rng: np.random.Generator
) -> tuple[MeasurementModel, ...]:
    """Models drawn from the joint distribution of a fit's unknowns, or from several fits in equal shares.

    All unknowns are drawn together, with their correlations; decay rates and frequencies in their
    logarithms, so that every member is stable; delays that come out negative are zero. Members have the
    structure of their fit: order, real constants, rank-one residues, which terms there are.

    covariances: Covariance of one fit, or of fits to records of different days: the set is then their
        union, and spans what changed between them.
    count: Members in all. Each fit gives count / fits of them, the first ones of the list one more if needed.

    Raises `ConfigError` if there is nothing to draw, if the fits have unlike ports or rates, or if a decay or
    a delay is known so badly that the set would hold anything.

    ``members = sample_models(monday.covariance, friday.covariance, count=50, rng=np.random.default_rng(1))``
    """
    _check(covariances, count)
    shares = [len(range(k, count, len(covariances))) for k in range(len(covariances))]
    return tuple(
        model_at(of.model, of.structure, of.unknowns + error)
        for of, share in zip(covariances, shares, strict=True)
        for error in draw_errors(of, share, rng).T
    )


def _check(covariances: tuple[ModelCovariance, ...], count: int) -> None:
    if not covariances or count < 1:
        raise ConfigError(
            f"{count} models of {len(covariances)} fits make no set", hint="one of each or more"
        )
    for other in covariances[1:]:
        check_alike(covariances[0].model, other.model)
    for covariance in covariances:
        _check_known(covariance)


def _check_known(of: ModelCovariance) -> None:
    """Raise `ConfigError` where a draw would leave the range of the covariance, that of small errors."""
    at, deviation = of.at, of.deviation()
    size = np.abs(of.model.poles)
    late = np.where(at.delay >= 0, deviation[at.delay], 0.0) * size.max()
    for kind, errors, names in (
        ("decay of the mode at", deviation[at.sigma], [f"{w / (2.0 * np.pi):.4g} Hz" for w in size]),
        ("delay of", late, [p.name for p in of.model.outputs]),
    ):
        if errors.max(initial=0.0) > LARGEST:
            raise ConfigError(
                f"the {kind} {names[int(np.argmax(errors))]} is not known, and the set would hold anything",
                hint="real constants, a fit without delay, fewer states, or a longer record",
            )


def check_alike(first: MeasurementModel, second: MeasurementModel) -> None:
    """Raise `ConfigError` unless two models are of the same channels and of one kind."""
    check_channels(first, second)
    if first.sample_hz != second.sample_hz:
        rates = " and ".join(
            "none" if m.sample_hz is None else f"{m.sample_hz:g} Hz" for m in (first, second)
        )
        raise ConfigError(f"the sampling rates of the models differ: {rates}", hint="fit both in one way")
