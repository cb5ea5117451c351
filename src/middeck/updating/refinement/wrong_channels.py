"""Channels of a survey that contradict the model where the rest of the survey agrees with it."""

import itertools
from collections.abc import Sequence

import numpy as np

from middeck.structure.correlation.measured_modes import real_shapes, seen, sensor_rows, straight_channels
from middeck.updating.residuals.pairing import at_channels
from middeck.updating.residuals.surveys import Compared, neighbours, shape_deviations
from middeck.values import record

# Least part of its readings left by a wrong channel, largest (rms) by the others.
WRONG, RIGHT = 0.5, 0.15
# Largest share of wrong channels: more are another article.
FEW = 0.25
# Readings and motions that are alike but for a factor; deviations by which what is left is no noise.
ALIKE, NOISE = 0.8, 5.0
# Parts of the rms motion at all nodes: the least size of a channel's readings, and the motion below which
# the model stands still.
PART, STILL = 0.2, 0.01
# Part of the model's motion: a smaller part that is not alike is nothing.
NOTHING = 0.05
# Instruments fail one by one: more channels than these that no factor sets right are the model's matter too.
ALONE = 2
SHOWN = 5
EVERY_WAY = ("x", "y", "z", "rx", "ry", "rz")
TINY = np.finfo(float).tiny


def wrong_channels(compared: Compared) -> tuple[str, ...]:
    """A sentence for each; none if channels are too few to decide, or most of them disagree.

    One for all that no factor sets right, if they are many: as turns of nodes where a mesh is too coarse.
    """
    measured = compared.survey.measured
    if not measured.node:
        return ()
    shapes = _shapes(compared)
    kept = np.ones(len(shapes.read), dtype=bool)
    while True:
        moved = shapes.moved(kept)
        if moved is None:
            return ()
        wrong = shapes.left(moved) > np.maximum(WRONG, shapes.noise(moved))
        if not np.any(kept & wrong):
            break
        # One that dominates the fit makes others look wrong: the one without which they agree best.
        kept[min(np.flatnonzero(kept), key=lambda r: shapes.left_without(kept, r))] = False
        if np.count_nonzero(~kept) > FEW * len(kept):
            return ()
    if float(np.sqrt(np.mean(shapes.left(moved)[kept] ** 2))) > RIGHT:
        return ()
    still = STILL * shapes.elsewhere(moved)
    rows = np.flatnonzero(~kept & wrong)
    odd = [r for r in rows if not _by_a_factor(shapes.read[r], moved[r])]
    odd = odd if len(odd) > ALONE else []
    warnings = [
        _channel_warning(compared, r, how_it_reads(shapes.read[r], moved[r], still[r]))
        for r in rows
        if r not in odd
    ]
    return (*warnings, *([_warning_on_many(compared, odd)] if odd else []))


@record(kw_only=True)
class _Shapes:
    """Measured shapes, their deviations, motion of the model, its paired modes, and which are close.

    ``motion`` has the channels, then all nodes; ``straight`` says which of its rows are in metres.
    """

    read: np.ndarray
    std: np.ndarray
    motion: np.ndarray
    straight: np.ndarray
    column: np.ndarray
    near: np.ndarray

    def elsewhere(self, moved: np.ndarray) -> np.ndarray:
        """Rms motion of all nodes over all modes, of the sort (straight or turning) of each channel."""
        count = len(self.read)
        sorts = [moved[count:][self.straight[count:] == straight] for straight in (False, True)]
        rms = np.array([np.linalg.norm(rows) / np.sqrt(len(rows)) for rows in sorts])
        return rms[self.straight[:count].astype(int)]

    def size(self, moved: np.ndarray) -> np.ndarray:
        """Norm of each channel's readings over all modes, at least `PART` of the motion `elsewhere`."""
        least = np.maximum(PART * self.elsewhere(moved), TINY)
        return np.maximum(np.linalg.norm(self.read, axis=1), least)

    def noise(self, moved: np.ndarray) -> np.ndarray:
        """Part of `size` that may be noise."""
        return NOISE * np.linalg.norm(self.std, axis=1) / self.size(moved)

    def left(self, moved: np.ndarray) -> np.ndarray:
        """Part of `size` by which reading and motion differ."""
        return np.linalg.norm(self.read - moved[: len(self.read)], axis=1) / self.size(moved)

    def left_without(self, kept: np.ndarray, row: int) -> float:
        """Sum of squares of `left` over the other kept channels, fitted without channel ``row``."""
        others = kept & (np.arange(len(kept)) != row)
        moved = self.moved(others)
        return np.inf if moved is None else float(np.sum(self.left(moved)[others] ** 2))

    def moved(self, kept: np.ndarray) -> np.ndarray | None:
        """Motion by the modes that fit the kept channels best, each with its neighbours; None if too few."""
        out, count = np.empty((len(self.motion), len(self.near))), len(kept)
        for k, own in enumerate(self.near):
            basis = self.motion[:, self.column[k, own]]
            # Where the model stands still, a deviation in parts of what is read is one of rounding.
            usable = kept & (np.linalg.norm(basis[:count], axis=1) > STILL * self.elsewhere(basis))
            if np.count_nonzero(usable) < 2 * basis.shape[1] + 1:
                return None
            weight = 1.0 / self.std[usable, k]
            at = basis[:count][usable]
            parts = np.linalg.lstsq(weight[:, None] * at, weight * self.read[usable, k], rcond=None)[0]
            out[:, k] = basis @ parts
        return out


def _shapes(compared: Compared) -> _Shapes:
    measured, modes, ours = compared.survey.measured, compared.modes, compared.pairs[:, 1]
    nodes = [node.name for node in modes.equilibrium.model.structure.nodes]
    name, way = zip(*itertools.product(nodes, EVERY_WAY), strict=True)
    return _Shapes(
        read=real_shapes(measured)[:, ours], std=shape_deviations(modes, measured)[:, ours],
        motion=np.vstack([at_channels(modes, measured), seen(sensor_rows(modes, name, way), modes)]),
        straight=straight_channels(modes, (*measured.node, *name), (*measured.direction, *way)),
        column=compared.paired.column,
        near=neighbours(modes, compared.paired.column) | np.eye(len(ours), dtype=bool),
    )  # fmt: skip


def _by_a_factor(read: np.ndarray, moved: np.ndarray) -> bool:
    """Whether the reading is the model's motion times some number, as accurately as in right channels, or
    zero."""
    size, other = np.linalg.norm(read), np.linalg.norm(moved)
    return bool(
        size < NOTHING * other or (read @ moved) ** 2 >= (1.0 - (2.0 * RIGHT) ** 2) * (size * other) ** 2
    )


def how_it_reads(read: np.ndarray, moved: np.ndarray, still: float) -> str:
    """The likely fault of an instrument that reads ``read`` where the model moves by ``moved``.

    No motion below ``still`` counts, whatever it is alike.
    """
    sizes = float(np.linalg.norm(read)), float(np.linalg.norm(moved))
    both = float(read @ moved)
    if sizes[1] <= still or abs(both) < ALIKE * sizes[0] * sizes[1] or not both:
        if sizes[0] < NOTHING * sizes[1]:
            return "reads nothing where the model moves: is it dead? The"
        return "does not follow the model's motion there: another axis or place? The"
    by = both / sizes[1] ** 2
    if abs(by + 1.0) < WRONG:
        return "reads with the opposite sign. The"
    return f"reads {by:.2g} times the model's motion there: its calibration or unit? The"


def _channel_warning(compared: Compared, row: int, matter: str) -> str:
    measured = compared.survey.measured
    channel = f"channel {measured.node[row]} {measured.direction[row]}"
    return (
        f"{compared.survey.name}: {channel} {matter} other channels agree with the model; "
        "correct it or leave it out, for it biases all results and widens their intervals"
    )


def _warning_on_many(compared: Compared, rows: Sequence[int]) -> str:
    measured = compared.survey.measured
    some = ", ".join(f"{measured.node[r]} {measured.direction[r]}" for r in rows[:SHOWN])
    more = f" and {len(rows) - SHOWN} more" if len(rows) > SHOWN else ""
    return (
        f"{compared.survey.name}: channels {some}{more} do not follow the model's motion there, nor would a "
        "factor on each: local motion that its mesh is too coarse for (more elements_per_strut), or their "
        "axes and places? The other channels agree; mend the mesh, or correct or leave these out, for they "
        "bias all results and widen their intervals"
    )
