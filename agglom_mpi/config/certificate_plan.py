"""Section `certify`: a claim about a feasible set, and how fresh runs test it.

`agglom certify` has an option for each of its keys.
"""

from collections.abc import Collection, Iterator, Mapping
from typing import Annotated, Any, Final, Self

from agglom_mpi.config.arguments import mistaken_argument, read_amount, read_fraction, shown
from agglom_mpi.declaration.components import In, Whole
from agglom_mpi.declaration.declared import Declared, FieldPath, Problems, Reads
from agglom_mpi.search.criteria import NoCriterionError
from agglom_mpi.search.membership import DECISION_ERROR, right_needed, strings_needed
from agglom_mpi.search.objectives.objective import Objective

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
    tolerance: Annotated[float, In("1"), Reads(lambda given: read_amount(given).value)] = (
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
    value = read_amount(tolerance).value
    if value <= lower:
        raise ValueError(f"is {shown(tolerance)}; must be greater than {lower:g}")
    return value
