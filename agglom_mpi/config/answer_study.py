"""The file of an answer study: a question, and settings that are varied one at a time."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.own_components import BesideCampaign
from agglom_mpi.config.searchable import check_search_library, check_searchable, log_narrow
from agglom_mpi.config.yaml_source import CampaignError, Problem, Source, parse, read_text
from agglom_mpi.declaration.components import In, Whole
from agglom_mpi.declaration.declared import Declared, FieldError, FieldPath, Line, Meaning, NotEmpty
from agglom_mpi.declaration.reading import Reading
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.declaration.units import quoted
from agglom_mpi.measurements.files.campaign_files import FilesBeside

DEFAULT: Final = "default"
"""Name of the setting that the others are compared with."""
CHANGED: Final = ("scene", "search", "ensemble", "stopping")
"""Sections of a campaign that a setting may change: single keys of the first, the others whole."""


MAX_TARGETS: Final = 50
"""Maximum number of errors to reach."""


class AnswerDocument(Declared):
    """The entries of the file of an answer study."""

    title: Line = ""
    question: Annotated[NotEmpty, Meaning("the campaign file of the question")]
    answer: Literal["best", "set"] = "best"
    tolerance: Annotated[float, In("1", above=0, below=1)] = 0.05
    points: Annotated[int, Whole(at_least=64, at_most=10**5)] = 4096
    seeds: Annotated[int, Whole(at_least=2, at_most=10**4)] = 10
    samples: Annotated[
        int, Whole(at_least=8, at_most=10**6, meaning="fresh samples of each string")
    ]
    targets: Annotated[
        list[Annotated[float, In("1", above=0)]], Meaning("errors to reach, the largest first")
    ]
    compared: Annotated[float, In("1", meaning="the target that settings are compared at")]
    default: Any = None
    factors: dict[str, dict[str, Any]]

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield targets that are no ladder, or without the one that is compared."""
        if not 1 <= len(self.targets) <= MAX_TARGETS:
            yield ("targets",), f"has {len(self.targets)}; must have 1 to {MAX_TARGETS} entries"
        elif any(a <= b for a, b in zip(self.targets, self.targets[1:], strict=False)):
            yield ("targets",), f"is {self.targets}; must descend"
        elif self.compared not in self.targets:
            allowed = ", ".join(f"{target:g}" for target in self.targets)
            yield ("compared",), f"is {self.compared:g}; allowed: {allowed}"


def file_stem(words: str) -> str:
    """Return a name in lower case without anything but letters, digits, points and underscores."""
    return re.sub(r"[^a-z0-9.]+", "_", words.lower()).strip("_")


class Setting(NamedTuple):
    """One way to answer the question: its factor, its name, and the campaign that is run.

    The text of the campaign is JSON, which is YAML, too.
    """

    factor: str
    name: str
    campaign: Campaign

    @property
    def stem(self) -> str:
        """Stem of the names of its files."""
        return file_stem(self.name if self.name == DEFAULT else f"{self.factor} {self.name}")


class AnswerStudy(NamedTuple):
    """An answer study.

    Attributes
    ----------
    title
    question
        The campaign in whose scene all answers are estimated.
    answer
        `best`, the best string; `set`, the feasible set.
    tolerance, points
        Tolerance of the set, and number of points of the box that it is compared at.
    seeds
        Number of runs of each setting, with the seeds 1, 2, ….
    samples
        Fresh samples of each string or point.
    targets
        Errors to reach, the largest first.
    compared
        The target that settings are compared at.
    settings
        The default first, then those of each factor.
    """

    title: str
    question: Campaign
    answer: str
    tolerance: float
    points: int
    seeds: int
    samples: int
    targets: tuple[float, ...]
    compared: float
    settings: tuple[Setting, ...]

    @property
    def factors(self) -> dict[str, list[Setting]]:
        """The settings of each factor, the default first in each."""
        default, *others = self.settings
        found: dict[str, list[Setting]] = {}
        for setting in others:
            found.setdefault(setting.factor, [default]).append(setting)
        return found


def load_answer_study(path: str, allow_code: bool = False) -> AnswerStudy:
    """Read and validate the file of an answer study, and the campaign that it names.

    The name of the campaign file is relative to the folder of the study.

    Raises
    ------
    CampaignError
        With everything that is wrong: file, line, field, value and what is allowed.
    """
    source = parse(read_text(path), path)
    try:
        document = AnswerDocument.checked(source.data)
    except FieldError as error:
        raise source.error(error) from None
    question = load_campaign(str(Path(path).parent / document.question), allow_code)
    log_narrow(question)
    campaign = _Variants(source, question, allow_code)
    settings = [Setting("", DEFAULT, campaign.of(("default",)))]
    for factor, named in document.factors.items():
        for name in named:
            settings.append(Setting(factor, name, campaign.of(("factors", factor, name))))
    _check_stems(source, settings)
    _check_answer(source, document, question)
    return AnswerStudy(
        document.title or question.title,
        question,
        document.answer,
        document.tolerance,
        document.points,
        document.seeds,
        document.samples,
        tuple(document.targets),
        document.compared,
        tuple(settings),
    )


class _Variants:
    """Campaigns that differ from a question's by what the file of a study, `source`, says."""

    def __init__(self, source: Source, question: Campaign, allow_code: bool) -> None:
        self._source = source
        self._question = question
        self._data = parse(question.text, question.name).data | {"final": "none"}
        self._data.pop("output", None)
        folder = Path(question.name).parent
        own, files = BesideCampaign(folder, allow_code), FilesBeside(folder)
        self._reading = Reading(own=own, files=files)

    def of(self, path: FieldPath) -> Campaign:
        """Return the campaign of the setting at a place of the study's file.

        Raises
        ------
        CampaignError
            If it is no campaign that can be searched.
        """
        data = dict(self._data)
        for place in dict.fromkeys(((DEFAULT,), path)):
            for section, value in _changes(self._source, place).items():
                data[section] = data[section] | value if section == "scene" else value
        text = json.dumps(data, indent=1)
        try:
            campaign = Campaign.from_text(
                text,
                self._question.name,
                self._question.user_function,
                self._reading,
            )
            check_searchable(campaign)
            check_search_library(campaign)
        except CampaignError as error:
            # The lines are those of a text that nobody has written.
            problems = [self._problem(path, problem) for problem in error.problems]
            raise CampaignError(*problems) from None
        return campaign

    def _problem(self, path: FieldPath, problem: Problem) -> Problem:
        within = tuple(problem.field.split("."))
        while within and (*path, *within) not in self._source.lines:
            within = within[:-1]
        rest = problem.field.removeprefix(".".join(within)).lstrip(".")
        message = f"{rest}: {problem.message}" if rest else problem.message
        return self._source.problem((*path, *within), message)


def _changes(source: Source, path: FieldPath) -> dict[str, Any]:
    """Return the sections that a setting changes; raise a CampaignError if it cannot."""
    found = source.value(path) if path in source.lines else None
    if found is None:
        return {}
    if not isinstance(found, dict):
        message = f"is {quoted(found)}; must be a mapping of sections: {', '.join(CHANGED)}"
        raise CampaignError(source.problem(path, message))
    problems = [
        source.problem((*path, key), f"unknown key '{key[:40]}'; {suggestion(key, CHANGED)}")
        for key in found
        if key not in CHANGED
    ]
    if not isinstance(scene := found.get("scene", {}), dict):
        message = f"is {quoted(scene)}; must be a mapping of keys of the scene"
        problems.append(source.problem((*path, "scene"), message))
    if problems:
        raise CampaignError(*problems)
    return found


def _check_stems(source: Source, settings: list[Setting]) -> None:
    seen: dict[str, str] = {}
    for setting in settings[1:]:
        path = ("factors", setting.factor, setting.name)
        if not setting.stem or setting.stem in {DEFAULT, *seen}:
            other = seen.get(setting.stem, DEFAULT)
            message = f"has the same letters and digits as {other!r}; choose another name"
            raise CampaignError(source.problem(path, message))
        seen[setting.stem] = setting.name


def _check_answer(source: Source, document: AnswerDocument, question: Campaign) -> None:
    """Raise a CampaignError if the question has no answer that can be compared with others."""
    if question.objective.needs_data:
        message = f"is {document.question!r}, whose objective {question.objective.name} compares"
        raise CampaignError(source.problem(("question",), f"{message} measured data; no study can"))
    if document.answer == "set" and not question.objective.is_magnitude:
        message = (
            f"is 'set', which needs a question with a growth target; the objective of "
            f"{question.name} is {question.objective.name}"
        )
        raise CampaignError(source.problem(("answer",), message))
