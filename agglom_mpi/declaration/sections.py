"""Sections of a campaign: their base class, the types of their fields, and their errors."""

from typing import Annotated, Any, Final, TypeAlias

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from agglom_mpi.declaration.units import quoted

FieldPath: TypeAlias = tuple[str | int, ...]
"""Keys and list positions from the top of a file, or of a section, down to a field."""


class FieldError(ValueError):
    """Errors of fields, each with its path below the validated section."""

    def __init__(self, *problems: tuple[FieldPath, str]) -> None:
        super().__init__("; ".join(f"{'.'.join(map(str, path))}: {m}" for path, m in problems))
        self.problems = problems


def raise_field_errors(problems: list[tuple[FieldPath, str]]) -> None:
    """Raise a FieldError unless `problems` is empty."""
    if problems:
        raise FieldError(*problems)


MAX_EXACT: Final = 2**53
"""Largest size of a whole number up to which float64 tells it from its neighbours."""


def _whole(value: Any) -> Any:
    exact = isinstance(value, float) and value.is_integer() and abs(value) <= MAX_EXACT
    return int(value) if exact else value


WholeNumber = Annotated[int, Field(strict=True), BeforeValidator(_whole)]
"""An integer, which may be written `3e2`: no text, no `true`, no 100.5."""

Flag = Annotated[bool, Field(strict=True)]
"""`true` or `false`: no 1, no `yes`."""


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError(
            "holds a character that cannot be printed; allowed: one line of plain text"
        )
    return text


Line = Annotated[str, AfterValidator(_printable)]
"""One line of printable text: no line break, null byte or lone surrogate."""


def _none(value: Any) -> Any:
    return None if value == "none" else value


NONE = BeforeValidator(_none)
"""Validator that reads the word `none` as None."""


def meaning(text: str) -> Any:
    """Return metadata of a field: what it is, as a message states it where the field is missing."""
    return Field(description=text)


LATER: Final = "added later"
"""Metadata of a field added after version 0.1.0: at its default it is not in the identity."""


class Section(BaseModel):
    """Base of all sections and submodels."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)

    def entries(self) -> dict[str, Any]:
        """Return all fields as plain values, without those marked `LATER` at their default."""
        return {
            name: _plain(getattr(self, name))
            for name, field in type(self).model_fields.items()
            if LATER not in field.metadata or getattr(self, name) != field.default
        }


def _plain(value: Any) -> Any:
    if isinstance(value, Section):
        return value.entries()
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    return [_plain(inner) for inner in value] if isinstance(value, list | tuple) else value


def named(value: Any) -> Any:
    """Return `foo` as `{law: foo}`, and a mapping as it is.

    Raises
    ------
    ValueError
        If the value is something else.
    """
    if isinstance(value, str):
        return {"law": value}
    if not isinstance(value, dict | Section):
        raise ValueError(f"is {quoted(value)}; must be the name of a law or a mapping with `law:`")
    return value


def _named_or_none(value: Any) -> Any:
    return named("none" if value is None else value)


NAMED = BeforeValidator(named)
"""Validator that reads `key: foo` as `key: {law: foo}`."""
NAMED_OR_NONE = BeforeValidator(_named_or_none)
"""As `NAMED`, and reads an empty entry as `none`."""
