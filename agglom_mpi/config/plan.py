"""The sections of a search: `search`, `ensemble`, `stopping`, and `final` and `output`."""

from functools import partial
from typing import Annotated, Any, Final, NamedTuple

from agglom_mpi.config.certificate_plan import CertificatePlan
from agglom_mpi.declaration.components import In, Whole
from agglom_mpi.declaration.declared import LATER, Declared, FieldError, Reads
from agglom_mpi.declaration.field_types import NONE, NotEmpty
from agglom_mpi.declaration.reading import Reading
from agglom_mpi.declaration.units import quoted
from agglom_mpi.search.ending import EndingCriterion, Generations, any_of
from agglom_mpi.search.methods.method import SearchMethod
from agglom_mpi.search.stopping import StoppingRule


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

    @property
    def ending(self) -> EndingCriterion:
        """The criterion that ends the campaign: any of those given, or its last generation."""
        return any_of(*self.criteria.values(), Generations(generations=self.generations))

    def recorded_criteria(self) -> dict[str, Any]:
        """Return the entries of the identity: those of the criteria."""
        return {k: v for k, v in self.entries().items() if k in EndingCriterion.components()}


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
    allowed = "must be a list of different whole numbers with 1 among them, like [1, 2, 4]"
    if not isinstance(value, list | tuple):
        raise ValueError(f"is {quoted(value)}; {allowed}")
    for each in value:
        is_number = isinstance(each, int | float) and not isinstance(each, bool)
        if not (is_number and float(each).is_integer()):
            raise ValueError(f"has {quoted(each)}; {allowed}")
        if not 1 <= each <= MAX_VOLUME:
            raise ValueError(f"has {each:g}; must be from 1 to {MAX_VOLUME}")
    if 1 not in value or len(set(value)) < len(value):
        raise ValueError(f"is {quoted(list(value))}; {allowed}")
    if len(value) > MAX_VOLUMES:
        raise ValueError(f"has {len(value)} volumes; must have at most {MAX_VOLUMES}")
    return tuple(sorted(int(each) for each in value))


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
