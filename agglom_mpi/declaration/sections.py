"""Sections of a campaign as pydantic models."""

from typing import Any

from pydantic import BaseModel, ConfigDict

from agglom_mpi.declaration.declared import recorded_entries


class Section(BaseModel):
    """Base of all sections that are no components."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)

    def entries(self) -> dict[str, Any]:
        """Return all fields as plain values, without those marked `LATER` at their default."""
        return recorded_entries(self, type(self).model_fields)
