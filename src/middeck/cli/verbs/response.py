"""``middeck response``: frequency responses of an article between its named ports."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

import middeck as md
from middeck.cli import figures, options
from middeck.cli.shown.file_of_an_error import reading
from middeck.cli.shown.screen import ScreenTable, case_lines, cells, show

if TYPE_CHECKING:
    import numpy as np

    from middeck.structure.plants.residual_flexibility import StaticGainComparison

LACKING = 1e-3
"""Share of a response from which on modes that are left out are told."""
LINES = 16
"""Lines of a response on which they are looked for: 0.07 s each for 200 coordinates."""
EXAMPLES = """\
  middeck response articles/mace-dm.toml --environment lab \\
    --input pri_rel_z --output pri_in_z_rate,bus_z_rate --at 0.5,1,8
  middeck response articles/mace-dm.toml --environment orbit --json \\
    --input bus_z --output bus_z --at 2 --set damping.flexible=0.02
"""


@click.command("response", cls=options.Verb, examples=EXAMPLES)
@options.case
@options.several(
    "--input",
    "inputs",
    metavar="PORT",
    required=True,
    callback=options.names,
    help="Actuator; may be repeated.",
)
@options.several(
    "--output",
    "outputs",
    metavar="PORT",
    required=True,
    callback=options.names,
    help="Sensor, or its _rate; may be repeated.",
)
@options.several(
    "--at",
    "frequency_hz",
    metavar="HZ,HZ",
    type=options.Frequencies(),
    required=True,
    callback=options.chained,
    help="Frequencies.",
)
@options.count
@click.option("--static", is_flag=True, help="Add the residual flexibility of the other modes.")
@figures.figure
@options.common
def verb(
    case: options.TypedSetup,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    frequency_hz: tuple[float, ...],
    count: int,
    static: bool,
    figure_file: str | None,
    as_json: bool,
) -> None:
    """Frequency responses of ARTICLE between named ports.

    From torques and forces to angles, displacements, their rates, and accelerations. Damping is the article's
    [damping]. --static adds the residual flexibility of the modes beyond --count and prints its share of the
    gain at low frequency. A warning says where these modes have more than a thousandth of a response.
    """
    import numpy as np

    from middeck.cli.given.typed_article import find_case, solve_case
    from middeck.structure.plants.residual_flexibility import compare_static_gain, complete_response

    modes = solve_case(case, count, standstill=True)
    with reading(find_case(case.article, case.environment)[0]):
        plant = md.build_plant(modes, inputs=inputs, outputs=outputs, count=count, static=static)
        gain = compare_static_gain(modes, inputs=inputs, outputs=outputs, count=count) if static else None

    def respond(hz: np.ndarray) -> md.FrequencyResponse:
        found = md.evaluate_plant(plant, hz)
        if not static:
            return found
        return complete_response(modes, found, inputs=inputs, outputs=outputs, count=count)

    with reading(find_case(case.article, case.environment)[0]):
        response = respond(np.array(frequency_hz))
        lacking = _warnings_on_modes_left_out(modes, response, count=count, static=static)
    document = {
        "schema": "middeck.response/1",
        "article": modes.equilibrium.model.structure.title,
        "environment": modes.equilibrium.environment.title,
        **describe(response),
        **({} if gain is None else {"static_gain": describe_gain(gain)}),
        "warnings": (*modes.warnings, *lacking),
    }
    if figure_file is not None:
        _draw(respond, modes, np.array(frequency_hz), figure_file)
    show(as_json, document, *_tables(document))


def _warnings_on_modes_left_out(
    modes: md.Modes, response: md.FrequencyResponse, *, count: int, static: bool
) -> tuple[str, ...]:
    """Responses that lack more than `LACKING` without the modes beyond ``count``, on some of the lines."""
    import numpy as np

    from middeck.structure.plants.residual_flexibility import left_out_gain

    lines = np.unique(np.linspace(0, len(response.frequency_hz) - 1, LINES).astype(int))
    inputs, outputs = ([port.name for port in side] for side in (response.inputs, response.outputs))
    try:
        gain = left_out_gain(
            modes,
            inputs=inputs,
            outputs=outputs,
            count=count,
            frequency_hz=response.frequency_hz[lines],
            static=static,
        )
    except md.MiddeckError:  # beside a stiff member no gain is known; its own warning says so
        return ()
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.nan_to_num(np.abs(gain) / (np.abs(gain) + np.abs(response.H[lines])), nan=0.0)
    if not (share > LACKING).any():
        return ()
    k, o, i = np.unravel_index(int(np.argmax(share)), share.shape)
    return (
        f"the modes beyond the {count} lowest are left out: at {response.frequency_hz[lines[k]]:g} Hz their "
        f"share of {inputs[i]} to {outputs[o]} is {100.0 * share[k, o, i]:.2g} %; keep more, with --count",
    )


def _draw(
    respond: Callable[[np.ndarray], md.FrequencyResponse], modes: md.Modes, asked_hz: np.ndarray, file: str
) -> None:
    from middeck.plot.response import response_figure, response_lines

    rest = modes.equilibrium
    found = md.solve_gyroscopic_modes(modes)
    lines = response_lines(asked_hz, found.frequency_hz, found.zeta)
    title = f"{rest.model.structure.title} in {rest.environment.title}"
    figures.write_figure(
        response_figure(respond(lines), respond(asked_hz), title),
        file,
        key="response",
        title=f"Frequency responses of {title}",
        description=f"Magnitude and phase from {lines[0]:.4g} to {lines[-1]:.4g} Hz.",
    )


def describe(response: md.FrequencyResponse) -> dict[str, Any]:
    """Every pair of ports in ``responses``; the numbers of a single pair stand beside it as well."""
    from middeck.files.json.results import response_numbers

    pairs = [
        {
            "input": u.name,
            "output": y.name,
            "unit": f"{y.unit} per {u.unit}",
            **response_numbers(response, output=o, input=i),
        }
        for o, y in enumerate(response.outputs)
        for i, u in enumerate(response.inputs)
    ]
    alone = pairs[0] if len(pairs) == 1 else {"frequency_hz": response.frequency_hz}
    return {**alone, "responses": pairs}


def describe_gain(gain: StaticGainComparison) -> dict[str, Any]:
    """Gains at low frequency of every pair of ports: of all modes, and of the kept ones alone."""
    pairs = [
        {
            "input": u.name,
            "output": y.name,
            "full": gain.full[o, i],
            "kept": gain.truncated[o, i],
            "missing": gain.truncated_error[o, i],
        }
        for o, y in enumerate(gain.outputs)
        for i, u in enumerate(gain.inputs)
    ]
    return {"frequency_hz": gain.frequency_hz, "pairs": pairs}


def _share(missing: float) -> str:
    """The share as text; "-" for a pair that is not coupled."""
    return f"{missing:.1e}" if missing == missing else "-"


def _tables(document: dict[str, Any]) -> list[str | ScreenTable]:
    import numpy as np

    blocks: list[str | ScreenTable] = [*case_lines(document)]
    for pair in document["responses"]:
        H = pair["re"] + 1j * pair["im"]
        rows = [
            [f"{f:g}", f"{h.real:.6e}", f"{h.imag:.6e}", f"{abs(h):.6e}", f"{np.degrees(np.angle(h)):.2f}"]
            for f, h in zip(pair["frequency_hz"], H, strict=True)
        ]
        title = f"{pair['input']} to {pair['output']}, {pair['unit']}"
        blocks.append(ScreenTable(title, ["Hz", "real", "imaginary", "magnitude", "phase deg"], rows))
    if "static_gain" in document:
        gain = document["static_gain"]
        keys = ("input", "output", "full:.6e", "kept:.6e")
        rows = [[*cells(p, *keys), _share(p["missing"])] for p in gain["pairs"]]
        title = f"undamped gain at {gain['frequency_hz']:.3g} Hz, without and with the modes left out"
        blocks.append(ScreenTable(title, ["from", "to", "all modes", "kept modes", "missing"], rows))
    return blocks
