"""Components in files: NPZ and MAT with names, in SI units; OUTPUT4 or punched DMIG with their cards."""

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from middeck.errors import ConfigError, DataError, MiddeckError
from middeck.files.articles.form import ComponentForm
from middeck.files.disk.atomic import replacing
from middeck.structure.model.component import Component, require_component, rigid_vectors

SCHEMA = "middeck.component/1"
# Endings of files of cards that may hold matrices, punched.
PUNCHED = (".pch", ".dat", ".bdf", ".nas")
OPTIONAL = ("damping", "present", "outputs", "recovery", "left_out")
# Names by which others may have them.
ALSO = {"K": "stiffness", "M": "mass", "B": "damping", "C": "damping"}
# How far what a motion as one body gives may be off for an output that is a shift or a turn.
AS_BODY = 1e-6
HINT = "stiffness, mass, grids and positions; middeck reduce writes them"


def write_component(path: str | Path, component: Component) -> None:
    """Write a component to an NPZ or MAT file, by the ending, whole or not at all.

    Arrays: ``stiffness``, ``mass`` (six coordinates of each grid, then modal ones; SI units), ``grids``,
    ``positions`` [m], ``next_hz``, and where there are any ``damping``, ``present``, ``outputs``,
    ``recovery`` and ``left_out``. Raises
    `ConfigError` for another ending.
    """
    path = Path(path)
    arrays: dict[str, Any] = {"schema": SCHEMA, "name": component.name, "grids": list(component.grids)}
    arrays |= {key: getattr(component, key) for key in ("positions", "stiffness", "mass", "next_hz")}
    arrays |= {
        key: value for key in OPTIONAL if (value := getattr(component, key)) is not None and len(value)
    }
    with replacing(path) as temporary, open(temporary, "wb") as stream:
        if path.suffix == ".npz":
            np.savez(stream, **arrays)
        elif path.suffix == ".mat":
            _save_mat(stream, arrays)
        else:
            raise ConfigError(f"a component file {path.name!r}", where=str(path), hint="name it .npz or .mat")


def _save_mat(stream: Any, arrays: Mapping[str, Any]) -> None:
    import scipy.io

    texts = {key: np.array(arrays[key], dtype=object) for key in ("grids", "outputs") if key in arrays}
    scipy.io.savemat(stream, {**arrays, **texts}, oned_as="column")


def load_component(path: str | Path) -> Component:
    """The component in an NPZ or MAT file, its grids fixed to frames of the same names.

    Raises `DataError` naming file and array for what is missing, broken or no component.
    """
    where = str(path)
    given = [(ALSO.get(key, key), value) for key, value in _arrays(Path(path)).items()]
    arrays = dict(given)
    twice = [key for key, count in Counter(key for key, _ in given).items() if count > 1]
    if twice:
        raise DataError(f"{twice[0]} under two names", where=where, hint="leave one of them out")
    missing = [key for key in ("stiffness", "mass", "grids", "positions") if key not in arrays]
    if missing:
        there = ", ".join(arrays) or "nothing"
        raise DataError(f"no {', '.join(missing)}; there is {there}", where=where, hint=HINT)
    grids = _names(arrays["grids"])
    try:
        return require_component(
            Component(
                name=str(np.ravel(arrays.get("name", Path(path).stem))[0]),
                grids=grids,
                frames=grids,
                positions=_real(arrays, "positions"),
                stiffness=_real(arrays, "stiffness"),
                mass=_real(arrays, "mass"),
                damping=_real(arrays, "damping") if "damping" in arrays else None,
                present=_real(arrays, "present") != 0.0 if "present" in arrays else None,
                outputs=_names(arrays.get("outputs", [])),
                recovery=_real(arrays, "recovery") if "recovery" in arrays else None,
                next_hz=float(np.ravel(arrays.get("next_hz", np.inf))[0]),
                left_out=_real(arrays, "left_out") if "left_out" in arrays else None,
            )
        )
    except ConfigError as error:
        raise DataError(error.what, where=where, hint=error.hint or HINT) from None


def _names(given: Any) -> tuple[str, ...]:
    """Texts; MATLAB has whole numbers as floats, and others texts as bytes."""
    found = np.ravel(given).tolist()
    return tuple(
        x.decode() if isinstance(x, bytes) else f"{x:{'.15g' * isinstance(x, float)}}" for x in found
    )


def _arrays(path: Path) -> dict[str, Any]:
    from middeck.files.records.mat import mat_arrays

    try:
        if path.suffix == ".npz":
            with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as file:
                return {key: file[key] for key in file.files}
        if path.suffix == ".mat":
            return mat_arrays(path)
    except FileNotFoundError:
        raise DataError("cannot be read: no such file", where=str(path), hint="check the path") from None
    except MiddeckError:
        raise
    except Exception as error:
        raise DataError(f"truncated or no {path.suffix} file: {error}", where=str(path), hint=HINT) from None
    raise DataError("no ending of a component", where=str(path), hint=".npz or .mat, or .op4 with its cards")


def _real(arrays: Mapping[str, Any], key: str) -> np.ndarray:
    array = np.asarray(arrays[key])
    if array.dtype.kind not in "fiub" or array.ndim != 2:
        raise ConfigError(
            f"{key} is no real matrix: {array.dtype} of shape {array.shape}",
            hint="a two-dimensional array of real numbers",
        )
    return array.astype(float)


def build_component(form: ComponentForm, folder: Path) -> Component:
    """The component that a valid form describes; its files are sought beside the article.

    Raises `DataError` for files, and `ConfigError` for grids without a frame.
    """
    found = _read(form, folder)
    where = f"component {form.name!r}"
    unknown = [grid for grid in (*form.nodes, *form.offsets_m) if grid not in found.grids]
    if unknown:
        raise ConfigError(
            f"no grid {unknown[0]}", where=where, hint=f"its grids are {', '.join(found.grids)}"
        )
    lost = [grid for grid in found.grids if grid not in form.nodes]
    if lost:
        raise ConfigError(
            f"grid {lost[0]} is fixed to nothing",
            where=f"{where}, nodes",
            hint=f'{lost[0]} = "name of a frame"',
        )
    given = np.array([form.offsets_m.get(grid, (0.0, 0.0, 0.0)) for grid in found.grids])
    axes = form.axes(where)
    return dataclasses.replace(
        found,
        name=form.name,
        frames=tuple(form.nodes[grid] for grid in found.grids),
        offsets=given + found.fixed_at @ axes.T,
        axes=axes,
    )


def _in_si(part: Component, text: str, kinds: Sequence[str]) -> Component:
    """The component of a file in other units; ``kinds`` of its outputs where the file states them."""
    from middeck.files.nastran.deck.units import parse_units

    units = parse_units(text)
    step = np.ones(len(part.stiffness))
    step[: 6 * len(part.grids)].reshape(-1, 6)[:, :3] = 1.0 / units.length
    energy = units.mass * units.length**2 / units.time**2 * np.outer(step, step)
    sizes = {
        "length": units.length,
        "angle": 1.0,
        "number": 1.0,
        "force": units.mass * units.length / units.time**2,
        "moment": units.mass * units.length**2 / units.time**2,
        "stress": units.mass / units.length / units.time**2,
    }
    found = kinds or _kinds(part)
    odd = [name for name, kind in zip(part.outputs, found, strict=False) if kind not in sizes]
    if odd or len(found) != len(part.outputs):
        what = f"of what kind is its output {odd[0]!r}" if odd else f"{len(found)} kinds of outputs"
        raise ConfigError(
            f"{what}? {text} does not say how it becomes SI",
            where=f"component {part.name!r}",
            hint=f"an array kinds in its file, one text an output of {', '.join(sizes)}; or a file in SI",
        )
    out, cut = np.array([sizes[kind] for kind in found]), part.left_out
    return dataclasses.replace(
        part,
        positions=units.length * part.positions,
        stiffness=energy * part.stiffness,
        mass=energy * units.time**2 * part.mass,
        damping=None if part.damping is None else energy * units.time * part.damping,
        recovery=None if part.recovery is None else np.outer(out, step) * part.recovery,
        next_hz=part.next_hz / units.time,
        left_out=None if cut is None else (energy * units.time**4)[: len(cut), : len(cut)] * cut,
    )


def _kinds(part: Component) -> list[str]:
    """Kinds of outputs that follow the component as one body (shift, turn); "" for all others."""
    if part.recovery is None:
        return []
    body = part.recovery @ rigid_vectors(part.positions, len(part.stiffness))
    size = np.abs(part.positions).max() or 1.0
    shifts = np.abs(np.abs(body[:, :3]).max(axis=1) - 1.0) < AS_BODY  # along one axis, whatever its place
    shifts &= np.abs(np.abs(body[:, :3]).sum(axis=1) - 1.0) < AS_BODY
    turns = np.abs(body[:, :3]).max(axis=1) * size < AS_BODY
    turns &= np.abs(np.abs(body[:, 3:]).max(axis=1) - 1.0) < AS_BODY
    turns &= np.abs(np.abs(body[:, 3:]).sum(axis=1) - 1.0) < AS_BODY
    return ["length" if s else "angle" if t else "" for s, t in zip(shifts, turns, strict=True)]


def _read(form: ComponentForm, folder: Path) -> Component:
    from middeck.files.nastran.components.external import read_external
    from middeck.files.nastran.deck.units import parse_units

    path = folder / form.file
    if path.suffix in (".npz", ".mat"):
        if form.cards or form.superelement:
            raise ConfigError(
                f"cards and superelement are of OUTPUT4 and punched matrices, not of {path.suffix}",
                where=f"component {form.name!r}",
                hint="leave them out",
            )
        part = load_component(path)
        return _in_si(part, form.units, _names(_arrays(path).get("kinds", []))) if form.units else part
    if form.units is None:
        raise ConfigError(
            "matrices of another program do not state their units",
            where=f"component {form.name!r}, units",
            hint='such as units = "mm-kg-s-mN"',
        )
    # Cards alone may hold the matrices, punched.
    punched = path.suffix in PUNCHED
    if not punched and not form.cards:
        beside = Path(form.file).with_suffix(".pch").as_posix()
        raise ConfigError(
            f"no cards: OUTPUT4 ({form.file}) does not say which row is which grid or modal coordinate",
            where=f"component {form.name!r}",
            hint=f'the punched cards of the same superelement, such as cards = ["{beside}"]',
        )
    cards = [*([path] if punched else []), *(folder / card for card in form.cards)]
    return read_external(
        cards, None if punched else path, parse_units(form.units), number=form.superelement, name=form.name
    )
