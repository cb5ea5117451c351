"""Values of a study that several chapters need."""

from middeck.files.studies.documents import Study
from middeck.laboratory.article_rig import build_rig_article
from middeck.laboratory.tested_article import RigArticle
from middeck.structure.gravity.compare_modes import ModeComparison, compare_modes
from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium

PAPER_MODES = 26  # Figures 4 and 5 show at least these, however few the controllers are designed on


def find_modes(structure: Structure, environment: Environment) -> Modes:
    """Rest state and modes of ``structure`` in ``environment``."""
    return solve_modes(solve_equilibrium(structure, environment))


def compare_environments(study: Study) -> ModeComparison:
    """Modes of the controlled article in orbit beside those in the laboratory (Figures 4, 5 and 7)."""
    article = study.control.article
    orbit, lab = (find_modes(*study.case(article, environment)) for environment in ("orbit", "lab"))
    return compare_modes(orbit, lab, max(PAPER_MODES, study.control.modes_kept))


def rig_article(study: Study) -> RigArticle:
    """The simulated article on which Figures 9 to 12 are measured."""
    return build_rig_article(*study.case(study.siso.article, study.siso.environment), study.rig)
