"""Settings of verbs without a document: options first, then ``--set``, all checked."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal, TypeVar

import click
from pydantic import Field

from middeck.files.toml.faults import DocumentFault
from middeck.files.toml.form import Band, Form, Positive, whole, within
from middeck.files.toml.overrides import OverriddenDocument, apply_overrides
from middeck.files.toml.source import Source, check, sound

F = TypeVar("F", bound=Form)
OPTIONS = "options"


class FitSettings(Form):
    """Settings of a fit to a record; the keys are the options of ``middeck identify``.

    Without ``states``: the recommended order. ``periods`` says how many whole ones each record holds; None
    leaves that to its file, or to its input. ``friction`` has joints as ``MOTOR=ANGLE``, or one name where
    both have it. The rest is as in `estimate_response` and `fit_response`.
    """

    states: Annotated[int, whole(1, 1000)] | None = None
    band_hz: Band | None = None
    sampled: bool | None = None
    cost: Literal["weighted", "logarithmic"] = "weighted"
    periods: Annotated[int, whole(1, 1_000_000)] | None = None
    method: Literal["samples", "periods", "local rational", "local polynomial", "h1", "h2", "hv"] | None = (
        None
    )
    reference: Annotated[tuple[str, ...], Field(strict=False)] = ()
    constants: Literal["real", "complex"] | None = None
    delay: Literal["none", "output", "path", "common"] | None = None
    residuals: bool = False
    full_rank: bool = False
    rigid: Annotated[int, whole(0, 6)] = 0
    integrators: Annotated[int, whole(0, 6)] = 0
    relative_degree: Literal[0, 1, 2] | None = None
    held: bool | None = None
    friction: Annotated[tuple[str, ...], Field(strict=False)] = ()


class RecordSettings(Form):
    """Descriptions of record files: as the options of ``middeck record``."""

    sample_hz: Positive | None = None
    variable: str = ""
    periods: Annotated[int, whole(1, 1_000_000)] | None = None


class ConvertSettings(Form):
    """Settings of the conversion of a deck: the options of ``middeck convert``."""

    units: str | None = None
    mass_formulation: Literal["consistent", "coupled", "lumped", "deck"] = "consistent"
    subcase: Annotated[int, whole(1, 99_999_999)] | None = None
    reals: Literal["double", "single"] = "double"


class ImpactSettings(Form):
    """Settings of the fit to an impact test; the keys are options of ``middeck impact``."""

    states: Annotated[int, whole(1, 1000)] | None = None
    band_hz: Band | None = None


class LoopSettings(Form):
    """Settings of a loop's design and judgement, in the units of the ports: N m and rad in an article.

    The last four are those of `FitSettings`, for a plant that is still to be fitted.
    """

    log10_authority: Annotated[float, within(least=-30.0, most=30.0)]
    angle_noise_rad_per_rthz: Positive
    disturbance_nm_per_rthz: Positive
    pade_order: Annotated[int, whole(1, 12)]
    band_hz: Band | None = None
    states: Annotated[int, whole(1, 1000)] | None = None
    fit_band_hz: Band | None = None
    sampled: bool | None = None
    periods: Annotated[int, whole(1, 1_000_000)] | None = None


def settle(form: type[F], options: Mapping[str, Any], overrides: Sequence[str]) -> F:
    """``options`` (None is left out) under ``overrides``, checked like a document; all faults at once."""
    source = Source(
        OPTIONS, {k: v for k, v in options.items() if v is not None}, lambda: {(k,): 0 for k in options}
    )
    listed = {k: list(v) if isinstance(v, tuple) else v for k, v in source.data.items()}
    (data,), (changed,) = apply_overrides([OverriddenDocument(source.file, listed, form)], overrides)
    checked = check(source, data, changed, form)
    return sound(replace(checked, faults=tuple(map(_named_as_typed, checked.faults))))


def _named_as_typed(fault: DocumentFault) -> DocumentFault:
    """``fault`` under the option that gave the value, where no override did."""
    options = {p.name: p.opts[0] for p in click.get_current_context().command.params}
    key, *_ = fault.key.split(".")
    typed = fault.file == OPTIONS and key in options
    return replace(fault, key=options[key]) if typed else fault
