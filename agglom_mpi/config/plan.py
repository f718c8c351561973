"""The sections of a search: `stopping`, `final`, `output`, and `certify`, its certificate."""

from collections.abc import Collection, Iterator, Mapping
from functools import partial
from typing import Annotated, Any, Final, NamedTuple, Self

from agglom_mpi.config.arguments import mistaken_argument, read_amount, read_fraction, shown
from agglom_mpi.declaration.components import In, Whole
from agglom_mpi.declaration.declared import (
    LATER,
    NONE,
    Declared,
    FieldError,
    FieldPath,
    NotEmpty,
    Problems,
    Reads,
)
from agglom_mpi.declaration.reading import Reading
from agglom_mpi.declaration.units import quoted
from agglom_mpi.search.criteria import NoCriterionError
from agglom_mpi.search.ending import EndingCriterion, Generations, any_of
from agglom_mpi.search.membership import DECISION_ERROR, right_needed, strings_needed
from agglom_mpi.search.methods.method import SearchMethod
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.search.stopping import StoppingRule

ENTRY: Final = "certificate."
"""Beginning of the entries of an identity that belong to a certificate."""
WOBBLE: Final = "wobble."
"""Beginning of their names that state by how much a variable deviates."""
DEFAULT_TOLERANCE: Final = 0.05
"""Tolerance of a set that none is given for."""

NOT_SEARCHED: Final = "is no searched variable; allowed:"

Share = Annotated[float, In("1", above=0, below=1), Reads(read_fraction)]


class CertificatePlan(Declared):
    """Section `certify`: a certificate of the feasible set by fresh runs after the search.

    Attributes
    ----------
    claim
        Share of the part, with `robust` of its pairs, that is to be right.
    confidence
        Confidence of the bounds.
    tolerance
        Tolerance of the set, as of `agglom report --feasible-set`.
    strings
        Number of strings that are drawn.
    max_samples
        Maximum number of samples of a string; one that they do not decide counts as wrong.
    seed
        Seed of the strings and of their samples.
    robust
        Maximum relative deviations of variables, `{relative_speed: 5%}`: each string is judged once
        with the variable off by a drawn even share of itself, at most this one, and not beyond the
        box. The claim is then of pairs of a string and a deviation.
    """

    claim: Share = 0.9
    confidence: Share = 0.95
    tolerance: Annotated[float, In("1"), Reads(lambda given: read_amount(given)[0])] = (
        DEFAULT_TOLERANCE
    )
    strings: Annotated[int, Whole(at_least=1, at_most=10**5)] = 100
    max_samples: Annotated[int, Whole(at_least=40, at_most=10**6)] = 2560
    seed: Annotated[int, Whole(at_least=0)] = 1
    robust: dict[str, Share] = {}  # noqa: RUF012  (a field)

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield a claim that no strings can show, or not so few."""
        if self.right_needed is None:
            enough = strings_needed(1.0, self.claim, self.confidence, DECISION_ERROR)
            if enough is None:
                yield ("claim",), f"is {self.claim:g}; no number of strings can show it"
            else:
                rule = f"must be at least {enough} for this claim and confidence"
                yield ("strings",), f"is {self.strings}; {rule}"

    def misfits(self, objective: Objective, searched: Collection[str]) -> Problems:
        """Yield what does not fit a campaign, by its objective and its searched variables."""
        try:
            tolerance = read_tolerance(objective, self.tolerance)
            if not objective.code_of_means:  # the function may not be at hand
                objective.criterion(tolerance)
        except NoCriterionError as error:
            yield (), f"needs a feasible set; {error}"
        except ValueError as error:
            yield ("tolerance",), str(error)
        for name in self.robust:
            if name not in searched:
                yield ("robust", name), f"{NOT_SEARCHED} {', '.join(searched)}"

    @property
    def right_needed(self) -> int | None:
        """Number of strings that must be right for the claim to hold; None if all do not do."""
        return right_needed(self.strings, self.claim, self.confidence, DECISION_ERROR)

    def recorded_entries(self) -> dict[str, object]:
        """Return it as entries of the identity of a certificate."""
        numbers = {ENTRY + name: value for name, value in self if name != "robust"}
        return numbers | {ENTRY + WOBBLE + name: share for name, share in self.robust.items()}

    @classmethod
    def of_identity(cls, identity: Mapping[str, Any]) -> Self:
        """Return the plan of the identity of a certificate."""
        start = ENTRY + WOBBLE
        robust = {n.removeprefix(start): v for n, v in identity.items() if n.startswith(start)}
        numbers = {name: identity.get(ENTRY + name) for name in cls.model_fields}
        return cls.recorded(numbers | {"robust": robust})

    @property
    def text(self) -> str:
        """The plan in words."""
        robust = "".join(f", robust {name}={share:g}" for name, share in self.robust.items())
        return (
            f"claim {self.claim:g}, confidence {self.confidence:g}, tolerance {self.tolerance:g}, "
            f"{self.strings} strings of at most {self.max_samples} samples, seed {self.seed}"
            f"{robust}"
        )


def read_robust(
    file: object, given: Mapping[str, Any], searched: Collection[str]
) -> dict[str, float]:
    """Return largest relative deviations by variable; raise an ArgumentError if one is impossible.

    Parameters
    ----------
    file
        File of the variables, for errors.
    given
        Fractions between 0 and 1 by name, such as `"5%"`.
    searched
        Names of the variables that may deviate.
    """
    found = {}
    for name, share in given.items():
        try:
            if name not in searched:
                raise ValueError(f"{NOT_SEARCHED} {', '.join(searched)}")
            found[name] = read_fraction(share)
        except ValueError as error:
            raise mistaken_argument(file, f"robust.{name}", error) from None
    return found


def deviations_text(robust: Mapping[str, float]) -> str:
    """Return deviations in words."""
    return ", ".join(f"{name} by up to {100 * share:.3g} %" for name, share in robust.items())


def read_tolerance(objective: Objective, tolerance: float | str) -> float:
    """Return the tolerance of an objective, given as a number or a text such as `5%`.

    It is a fraction between 0 and 1, relative to the target or to the maximum, unless the limits of
    the objective are others.

    Raises
    ------
    ValueError
        If it is something else.
    """
    lower, upper = objective.tolerance_limits
    if upper == 1.0:
        return read_fraction(tolerance)
    value = read_amount(tolerance)[0]
    if value <= lower:
        raise ValueError(f"is {shown(tolerance)}; must be greater than {lower:g}")
    return value


class _Generations(Declared):
    generations: Annotated[int, Whole(at_least=1, at_most=10**6, meaning="the most generations")]


def with_criteria(base: type[Declared]) -> Any:
    """Return a section with the keys of another one, and then one for each ending criterion."""
    types: dict[str, Any] = {}
    for key, criterion in EndingCriterion.components().items():
        marks = (NONE,) if criterion.always_recorded else (NONE, LATER)
        read = Reads(partial(_read_criterion, criterion), in_context=True)
        types[key] = Annotated[(criterion | None, read, *marks)]
    named = {"__annotations__": types, "__module__": __name__, **dict.fromkeys(types)}
    metaclass: Any = type(base)
    return metaclass("Criteria", (base,), named)


def _read_criterion(
    criterion: type[EndingCriterion], entry: Any, reading: Reading
) -> EndingCriterion | None:
    """Return a criterion of its entry, which may be the value of its only field."""
    mapping = criterion.as_mapping(entry)
    if entry is None or mapping is entry:
        return entry
    try:
        return criterion.checked(mapping, reading)
    except FieldError as error:
        [(_, message)] = error.problems
        raise ValueError(message) from None


Criteria: Any = with_criteria(_Generations)


class Stopping(Criteria):
    """Section `stopping`: what ends the campaign.

    Attributes
    ----------
    generations
        Maximum number of generations.
    max_failures
        Number of failed samples at which the campaign is abandoned.
    max_seconds
        Maximum run time of a sample; longer ones fail, so results depend on the machine.
    """

    max_failures: Annotated[int, Whole(at_least=1)] = 100
    max_seconds: Annotated[Annotated[float, In("s", above=0)] | None, NONE] = None

    @property
    def criteria(self) -> dict[str, EndingCriterion]:
        """Criteria that end the campaign before its last generation, by key."""
        found = {key: getattr(self, key) for key in EndingCriterion.components()}
        return {key: each for key, each in found.items() if each is not None}

    def recorded_criteria(self) -> dict[str, Any]:
        """Return the entries of the identity: those of the criteria."""
        return {k: v for k, v in self.entries().items() if k in EndingCriterion.components()}

    @property
    def ending(self) -> EndingCriterion:
        """The criterion that ends the campaign: any of those given, or its last generation."""
        return any_of(*self.criteria.values(), Generations(generations=self.generations))


class Plan(NamedTuple):
    """The sections of a search, which a scene alone does not have."""

    search: SearchMethod
    ensemble: StoppingRule
    stopping: Stopping
    certify: CertificatePlan | None = None


MAX_VOLUME: Final = 1000
"""Maximum control volume of the final estimate relative to the box of the campaign."""
MAX_VOLUMES: Final = 8
"""Maximum number of control volumes of the final estimate."""


def _read_volumes(value: Any) -> Any:
    """Return different factors in ascending order, with 1 among them; or raise a ValueError."""
    given = list(value) if isinstance(value, list | tuple) else []
    known = [each for each in given if isinstance(each, int | float) and not isinstance(each, bool)]
    whole = {int(each) for each in known if 1 <= each <= MAX_VOLUME and float(each).is_integer()}
    if len(whole) < len(given) or 1 not in whole or len(given) > MAX_VOLUMES:
        limits = f"at most {MAX_VOLUMES} different whole numbers from 1 to {MAX_VOLUME}"
        raise ValueError(f"is {quoted(value)}; must be a list of {limits}, 1 among them: [1, 2, 4]")
    return tuple(sorted(whole))


class FinalAnswer(Declared):
    """Section `final`: re-estimation of the best strings on fresh samples after the search.

    Attributes
    ----------
    strings
        Number of best strings that are estimated again.
    samples
        Number of fresh samples of each string.
    volumes
        Multiples of the control volume in which the best strings are estimated; size and volume
        fraction of the grains stay the same.
    """

    strings: Annotated[int, Whole(at_least=1, at_most=10**5)] = 6
    samples: Annotated[int, Whole(at_least=2, at_most=10**6)] = 100
    volumes: Annotated[tuple[int, ...], Reads(_read_volumes), LATER] = (1,)

    @property
    def larger(self) -> tuple[int, ...]:
        """The volumes beside the campaign's own, ascending."""
        return self.volumes[1:]


class FramesOfBest(Declared):
    """Frames of the first samples of the best strings, recorded after the search.

    Attributes
    ----------
    count
        Number of frames of each sample.
    strings
        Number of best strings.
    samples
        Number of samples of each string.
    """

    count: Annotated[int, Whole(at_least=1, at_most=10**5, meaning="frames of each sample")]
    strings: Annotated[int, Whole(at_least=1)] = 6
    samples: Annotated[int, Whole(at_least=1)] = 1


class Output(Declared):
    """Section `output`: name of the campaign file, and what it stores beside rows of samples.

    Attributes
    ----------
    file
        Name of the campaign file; by default that of the YAML file, ending in `.h5`.
    final_particles
        Store the particles at the end of every sample.
    frames
        Frames of the best strings over time, for ParaView.
    census
        Times beside those of `data` at which particles are counted by size, up to the end_time of
        the scene. Data of these times can be added later without new samples.
    """

    file: NotEmpty | None = None
    final_particles: bool = False
    frames: Annotated[FramesOfBest | None, NONE] = None
    census: tuple[Annotated[float, In("s", above=0)], ...] = ()
