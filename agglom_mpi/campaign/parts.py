"""What every piece of a campaign file shares: no unknown keys, frozen, laws called by name."""

from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from agglom_mpi.campaign.quantities import shown
from agglom_mpi.campaign.source import Path

WholeNumber = Annotated[int, Field(strict=True)]
"""An integer that is written as one: no text, no `true`, no 100.0."""

Flag = Annotated[bool, Field(strict=True)]
"""`true` or `false`: no 1, no `yes`."""


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError(
            "holds a character that cannot be printed; allowed: one line of plain text"
        )
    return text


Line = Annotated[str, AfterValidator(_printable)]
"""One line of text: no line break, null byte or lone surrogate."""


class Part(BaseModel):
    """A section or a submodel of the campaign."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class RefusalError(ValueError):
    """Fields that do not fit together, each with its path below the validated part."""

    def __init__(self, *problems: tuple[Path, str]) -> None:
        super().__init__("; ".join(message for _, message in problems))
        self.problems = problems


def refuse(problems: list[tuple[Path, str]]) -> None:
    """Raise a `RefusalError` if there are any problems."""
    if problems:
        raise RefusalError(*problems)


def _named(value: Any) -> Any:
    if isinstance(value, str):
        return {"law": value}
    if not isinstance(value, dict | Part):
        raise ValueError(f"is {shown(value)}; must be the name of a law or a mapping with `law:`")
    return value


def _named_or_none(value: Any) -> Any:
    return _named("none" if value is None else value)


NAMED = BeforeValidator(_named)
"""Reads `key: foo` as `key: {law: foo}`."""
NAMED_OR_NONE = BeforeValidator(_named_or_none)
"""The same, and an empty entry as `none`."""
