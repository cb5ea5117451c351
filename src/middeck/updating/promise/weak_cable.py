"""Compensators that a weak cable, which the plan does not state, would make unstable in orbit."""

from middeck.control.robust.verification.monte_carlo import which_decay
from middeck.structure.model.umbilical import floats, tie_umbilical
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.updating.orbit.predicted_frequencies import CABLE_HZ
from middeck.updating.promise.blocks_of_draws import Site
from middeck.updating.promise.plan import close_inner, group_loop, plant_of, weights_of

TRIED_HZ = (CABLE_HZ, 0.1 * CABLE_HZ)
"""Frequencies that the cable gives the article: intervals of modes allow for the first, stated or not."""


def may_have_cable(site: Site) -> bool:
    """Whether the article floats at an attach point, and the plan states no cable."""
    structure, place, _ = site.drawing.there
    return bool(structure.attach_points) and floats(place) and site.plan.loop.umbilical_hz == 0.0


def lost_to_cable(site: Site) -> tuple[str, ...]:
    """Names of the compensators that are stable on the most probable article, and not with each cable."""
    plan, plants = site.plan, [_tied(site, hz) for hz in (0.0, *TRIED_HZ)]
    lost: list[str] = []
    for name, law in site.laws.items():
        u, y = (tuple(p.name for p in side) for side in (law.outputs, law.inputs))
        seen = [group_loop(plan, plant, u, y) for plant in plants]
        free, *tied = which_decay(seen, law, weights_of(plan, law.outputs, law.inputs)).tolist()
        lost += [name] * (free and not all(tied))
    return tuple(lost)


def _tied(site: Site, cable_hz: float) -> Plant:
    """The most probable article by the model alone, inner loops closed and the delay in."""
    there, plan = site.drawing.there, site.plan
    tied = there._replace(environment=tie_umbilical(*there[:2], cable_hz))
    plant = close_inner(plan, plant_of(plan, tied.solve(site.drawing.refined.x)))
    return delay_plant(plant, plan.loop.delay_s) if plan.loop.delay_s else plant
