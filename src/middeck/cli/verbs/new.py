"""``middeck new``: a folder with an article, its environments, a record and a study that run."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path
from string import Template

import click

import middeck as md
from middeck.cli import options
from middeck.cli.shown.screen import show
from middeck.errors import ConfigError

EXAMPLES = """\
  middeck new boom
  middeck new work/antenna --json
"""

RATE_HZ, PERIOD_S, PERIODS, BAND_HZ = 200.0, 40.0, 3, (0.5, 24.0)
TORQUE_NM = 0.02  # rms, of the paddle's motor
NOISE = (2.0e-5, 2.0e-4)  # rms, of the angles of the tip and of the paddle [rad]


@click.command("new", cls=options.Verb, examples=EXAMPLES)
@click.argument("folder", metavar="NAME", type=click.Path(path_type=Path))
@options.printing
def verb(folder: Path, as_json: bool) -> None:
    """Make the folder NAME with an article, a record and a study.

    The article is a bus of tubes with torque wheels and a paddle; the record is a simulated test of it. Both
    environments (laboratory and orbit) are there too. NAME must not exist yet.
    """
    from middeck.files.disk.atomic import making_folder
    from middeck.files.records import write_record

    name = folder.resolve().name
    if folder.exists():
        raise ConfigError(f"{folder} exists already", hint="a name that no file or folder has")
    if not re.fullmatch(r"[A-Za-z_][\w-]*", name, re.ASCII):
        raise ConfigError(
            f"{name!r} is no name of an article", hint="letters, digits, - and _, a letter first"
        )
    with making_folder(folder) as place:
        for source in files("middeck.files").joinpath("start").iterdir():
            text = Template(source.read_text(encoding="utf-8")).substitute(name=name)
            (place / source.name).write_text(text, encoding="utf-8", newline="\n")
        write_record(place / "record.npz", simulate_test(place))
    made = sorted(folder.iterdir())
    document = {"schema": "middeck.new/1", "folder": folder, "files": made}
    lines = [f"made  {path}" for path in made]
    show(as_json, document, *lines, "", f"next: cd {folder}; README.md says how to go on")


def simulate_test(folder: Path) -> md.Record:
    """The article in the laboratory, driven by the paddle's motor with a multisine that fills the band."""
    import numpy as np

    import middeck as md
    from middeck.signals.excitation.multisine import random_multisine

    hung = md.solve_modes(md.solve_equilibrium(*md.load_setup(folder / "article.toml", folder / "lab.toml")))
    u, y = ("paddle_rel",), ("tip_z", "paddle_rel")
    plant = md.build_plant(hung, inputs=u, outputs=y, count=19, u=u, y=y)
    rng = np.random.default_rng(1)
    torque = random_multisine(BAND_HZ, PERIOD_S, RATE_HZ, TORQUE_NM, rng)
    sensors = {name: md.laboratory.Sampler(noise) for name, noise in zip(y, NOISE, strict=True)}
    rig = md.build_rig(plant, sample_hz=RATE_HZ, delay_s=0.01, sensors=sensors)
    run = md.run_open_loop(rig, torque[:, None], periods=PERIODS, rng=rng, settle=0, steady=True)
    assert run.record is not None, run.cause
    return run.record
