"""From the ``[damping]`` of a valid article form to the `Damping` it describes."""

from __future__ import annotations

import numpy as np

from middeck.files.article_form import ArticleForm, DamperForm, DampingForm
from middeck.structure.model.article import Damper, DamperPlace, Damping, DampingTable


def build_damping(form: ArticleForm) -> Damping:
    """Ratios, table, loss factors by member, dampers, and modes of their own.

    A default gives way to what is more definite: both to a table, the flexible one to loss factors.
    """
    d = form.damping
    given = d.model_fields_set
    lossy = bool(d.material or d.section)
    flexible = 0.0 if "flexible" not in given and (d.table or lossy) else d.flexible
    suspension = 0.0 if "suspension" not in given and d.table else d.suspension
    return Damping(
        flexible=flexible,
        suspension=suspension,
        rigid=d.rigid,
        table=_table(d),
        loss_factor=_loss_factors(form),
        dampers=tuple(_damper(device) for device in d.device),
        by_mode=tuple((int(key) if key.isdigit() else key, ratio) for key, ratio in d.mode.items()),
        by_rank=d.rule == "rank",
    )


def _table(form: DampingForm) -> DampingTable | None:
    table = form.table
    if table is None:
        return None
    return DampingTable(np.array(table.frequency_hz), np.array(table.ratio), table.outside == "hold")


def _loss_factors(form: ArticleForm) -> tuple[tuple[str, float], ...]:
    """Loss factor of each member, by its section or else by the material of its section."""
    d = form.damping
    found: list[tuple[str, float]] = []
    for strut in form.strut:
        material = form.section[strut.section].material
        eta = d.section.get(strut.section, 0.0 if material is None else d.material.get(material, 0.0))
        if eta > 0.0:
            found.append((strut.name or f"{strut.from_}-{strut.to}", eta))
    return tuple(found)


def _damper(form: DamperForm) -> Damper:
    places = {DamperPlace.JOINT: form.joint, DamperPlace.SPRING: form.spring, DamperPlace.DEVICE: form.attach}
    place, at = next((place, at) for place, at in places.items() if at is not None)
    c = form.c_joint_nms_per_rad if place is DamperPlace.JOINT else form.c_ns_per_m
    return Damper(place, at, c or 0.0)
