"""Errors of a campaign's text, with file, line, field, value and what is allowed."""

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any, NamedTuple, get_args

from pydantic import (
    BaseModel,
    ValidationError,
)

from agglom_mpi.config.yaml_source import CampaignError, Source
from agglom_mpi.declaration.choices import choice_of
from agglom_mpi.declaration.components import number_of
from agglom_mpi.declaration.declared import Declared, FieldError, FieldPath
from agglom_mpi.declaration.reading import PLAIN, Reading
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.declaration.units import quoted

Models = list[Any]
"""Pydantic models, and declared classes, whose fields are the same to messages."""


EXPECTATIONS = {
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "string_type": "must be a text; put it in quotes",
    "string_unicode": "must be a text",
    "string_too_short": "must not be empty",
    "too_short": "must not be empty",
    "bool_type": "must be true or false",
    "model_type": "must be a mapping",
    "tuple_type": "must be a list",
    "finite_number": "must be a finite number",
    "greater_than": "must be greater than {gt}",
    "greater_than_equal": "must be at least {ge}",
    "less_than": "must be less than {lt}",
    "less_than_equal": "must be at most {le}",
    "multiple_of": "must be a multiple of {multiple_of}",
    "too_long": "must have {max_length} entries",
}
"""Statements of what is allowed, by type of pydantic's errors."""


def to_campaign_error(
    error: ValidationError,
    source: Source,
    model: type[Any],
    reading: Reading = PLAIN,
    needs: Mapping[FieldPath, str] | None = None,
) -> CampaignError:
    """Return the CampaignError of a failed validation of `source.data` by `model`.

    `needs` gives the reason why an entry is needed, for the message where it is missing.
    """
    models = _Models(source, model, reading)
    problems = []
    for details in error.errors(include_url=False):
        for path, message in _messages(dict(details), source, models):
            if details["type"] == "missing" and needs and path in needs:
                message = f"{message}; {needs[path]}"
            problems.append(source.problem(path, message))
    return CampaignError(*problems)


def _messages(
    details: dict[str, Any], source: Source, models: "_Models"
) -> Iterator[tuple[FieldPath, str]]:
    kind, loc, context = details["type"], details["loc"], details.get("ctx", {})
    path = _path_in_file(loc, source)
    match kind:
        case "value_error" if isinstance(context["error"], FieldError):
            for below, message in context["error"].problems:
                yield (*path, *below), message
        case "value_error":
            yield path, str(context["error"])
        case "missing" if isinstance(loc[-1], int):
            path = _path_in_file(loc[:-1], source)
            yield path, f"is {quoted(source.value(path))}; has too few entries"
        case "missing":
            (*_, last) = loc
            wanted = [_expectation(found, last) for found in models.at(loc[:-1])]
            message = "; ".join(["is missing", *filter(None, wanted)])
            yield (*_path_in_file(loc[:-1], source), last), message
        case "extra_forbidden":
            section = ".".join(part for part in path[:-1] if isinstance(part, str))
            more = f" (see `{' '.join(filter(None, ('agglom explain', section)))}`)"
            yield path, _unknown_key(str(loc[-1]), models.at(loc[:-1])) + more
        case "literal_error":
            value = quoted(source.value(path))
            yield path, f"is {value}; allowed: {_unquoted(context['expected'])}"
        case "model_attributes_type":
            yield path, f"is {quoted(source.value(path))}; must be a mapping"
        case _:
            allowed = (
                EXPECTATIONS[kind].format(**context) if kind in EXPECTATIONS else details["msg"]
            )
            yield path, f"is {quoted(source.value(path))}; {allowed}"


def _expectation(model: type[Any], key: str) -> str | None:
    field = model.model_fields[key]
    number = number_of(field)
    return field.description or (number.meaning if number is not None else None)


def _unquoted(quoted: str) -> str:
    return ", ".join(re.findall(r"'([^']*)'", quoted))


def _unknown_key(key: str, models: Models) -> str:
    allowed = [name for model in models for name in model.model_fields]
    return f"unknown key '{key[:40]}'; {suggestion(key, allowed)}"


def _path_in_file(loc: FieldPath, source: Source) -> FieldPath:
    """Return a location without what pydantic adds: types of unions, `law` of a short form."""
    path: FieldPath = ()
    for part in loc:
        if (*path, part) in source.lines:
            path = (*path, part)
    return path


class _Models(NamedTuple):
    """The models, `outermost` first, that the data of a source is validated by."""

    source: Source
    outermost: type[Any]
    reading: Reading

    def at(self, loc: FieldPath) -> Models:
        """Return the models that pydantic may have tried at a location."""
        models: Models = [self.outermost]
        for i, part in enumerate(loc):
            if isinstance(part, int):  # an entry of a list, whose type the key before it gives
                continue
            models = [
                inner
                for found in models
                if part in found.model_fields
                for inner in self._inside(found.model_fields[str(part)], loc[: i + 1])
            ]
        return models

    def _inside(self, field: Any, loc: FieldPath) -> Models:
        """Return the models that the value of a field may have."""
        choice = choice_of(field)
        if choice is None:
            return _models_within(field.annotation)
        with suppress(ValueError):
            entry = self.source.value(_path_in_file(loc, self.source))
            return [choice.class_of(entry, self.reading)]
        return []


def _models_within(annotation: Any) -> Models:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel | Declared):
        return [annotation]
    return [model for inner in get_args(annotation) for model in _models_within(inner)]
