"""The public interface of components of one's own: `from agglom_mpi.components import Friction`.

A module beside a campaign file takes from here what a component is written with; the names below
stay as they are. They are imported when they are first used, so that a module with a stopping rule
loads no physics, and one with a law no search.
"""

from importlib import import_module
from typing import Any, Final

_BY_MODULE: Final[dict[str, tuple[str, ...]]] = {
    "declaration.components": ("In", "Whole", "Setting"),
    "declaration.choices": ("Choice",),
    "declaration.declared": (
        *("Declared", "FieldPath", "Meaning", "LATER", "Flag", "Line", "NONE"),
    ),
    "declaration.laws": ("Law", "Group", "Reported", "Values"),
    "compilation.stages": ("Submodel", "inlined", "not_inlined"),
    # Laws of an impact
    "physics.pair": ("ContactPair",),
    "physics.restitution": (
        *("Restitution", "RestitutionSolution", "CriticalSpeeds", "ImpactLaws", "IMPACT_PRESSURE"),
        *("solve_restitution", "is_still_in_contact"),
        *("solve_pressure_law", "log_pressure_scale", "log_pressure_ratio"),
    ),
    "physics.dry_contact": ("RestitutionAroundDry", "without_energy"),
    "physics.elastic_contact": (
        *("YoungsModulus", "PoissonRatio", "contact_modulus", "reduced_radius"),
        *("separation_work", "tabor_number", "FIXED_DISPLACEMENT", "FIXED_LOAD"),
    ),
    "physics.contact": (
        *("Duration", "LengthDuration", "LengthRatio"),
        *("area_fraction", "area_slope", "contact_area"),
        *("force_scale", "restitution_factor", "restitution_factor_slope"),
    ),
    "physics.hardness": (
        *("Hardness", "SOFTENING", "UNIQUE_HARDENING"),
        *("log_hardening", "softening_rate", "root_is_unique"),
    ),
    "physics.friction": (
        *("Friction", "capped_impulse", "is_sticking", "normal_loss", "friction_loss"),
        *("tangential_impulse", "impulse_slopes", "tangential_loss", "tangential_mass"),
        *("keeps_loss_concave", "least_loss_slope"),
    ),
    "physics.rough": ("SpinningFriction", "sticking_impulse"),
    "physics.heating": (
        *("Heating", "HEATING", "keeps_root_unique", "merge_dissipation", "impact_heats"),
        *("own_energy_loss", "least_own_energy_slope"),
    ),
    "physics.reaction": ("Reaction", "REACTION", "contact_heat"),
    "physics.fragmentation": ("Fragmentation", "FragmentCount", "FRAGMENTATION", "equal_pieces"),
    "physics.constants": ("GAS_CONSTANT", "LIGHT_SPEED", "STEFAN_BOLTZMANN"),
    # Laws of a single grain, and of the start
    "physics.cooling": (
        *("Cooling", "SteppableCooling", "Integration", "cooling_rate", "rate_slope"),
        *("COLDEST", "PANEL", "SHORT", "equilibrium_temperature", "relaxation_rate"),
        *("panel_time", "panel_width", "short_width", "cooled_towards_zero"),
        "quartic_coefficient",
    ),
    "physics.velocities": ("Velocities",),
    "physics.sizes": ("Sizes", "Length", "Basis"),
    "physics.size_distributions": (
        *("SizeDistribution", "SizeLaw", "LognormalDistribution", "UniformDistribution"),
        *("VolumeUniformDistribution", "ListedDistribution"),
    ),
    # Searches
    "outcome": ("SampleSummary",),
    "statistics": ("Floats", "RunningMean", "PooledMoments", "t_95"),
    "search.objectives.objective": (
        *("Objective", "RadiusObjective", "ObjectiveAccumulator", "MeanAccumulator", "Ratio"),
        "ReachedMoment",
    ),
    "search.criteria": ("Criterion", "Band", "NearMaximum", "band_text"),
    "search.methods.method": (
        *("SearchMethod", "PopulationMethod", "RunningSearch", "SearchInputs"),
    ),
    "search.methods.baselines": ("BaselineSearch", "SobolStrings"),
    "search.proposals": (
        *("Proposals", "Evaluations", "Ranked", "EvaluatedStrings"),
        *("as_proposals", "begun_with", "joined_proposals"),
        *("RANDOM", "OFFSPRING", "MODEL", "GIVEN", "AGAIN", "NO_PARENT"),
    ),
    "search.space": ("SearchSpace",),
    "random_streams": (
        *("search_stream", "OWN_SEARCH", "RANDOM_STRING", "OFFSPRING_BLEND", "EVOLUTION"),
    ),
    "search.stopping": ("StoppingRule", "AdaptiveRule", "EnsembleState"),
    "search.racing": ("Racing",),
    "formatting": ("pluralise", "value_with_prefix", "value_with_error"),
}
_MODULES: Final = {name: module for module, names in _BY_MODULE.items() for name in names}

__all__ = sorted(_MODULES)


def __dir__() -> list[str]:
    """Return the public names."""
    return __all__


def __getattr__(name: str) -> Any:
    """Import a name when it is first used."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(f"agglom_mpi.{_MODULES[name]}"), name)
    globals()[name] = found
    return found
