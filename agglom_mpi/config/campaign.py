"""A campaign: everything that its file states, typed and in SI units."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from agglom_mpi.config import describe, identity
from agglom_mpi.config.arguments import read_count
from agglom_mpi.config.bounds import bounds_of
from agglom_mpi.config.box_ends import check_ends, refused_corners
from agglom_mpi.config.campaign_sections import CampaignSections
from agglom_mpi.config.data_section import built_data
from agglom_mpi.config.document import read_document
from agglom_mpi.config.own_variables import Parameters, read_strings, string_of
from agglom_mpi.config.relations import Relations
from agglom_mpi.config.scene import parse_engine
from agglom_mpi.config.searchable import check_start
from agglom_mpi.config.seeded_text import with_seed
from agglom_mpi.config.user_function import UserFunction
from agglom_mpi.config.yaml_source import (
    ArgumentError,
    CampaignError,
    Problem,
)
from agglom_mpi.declaration.reading import PLAIN, Reading
from agglom_mpi.public_face import PublicFace
from agglom_mpi.simulation.engines import Engine

CAMPAIGN_INTERNALS: Final = (
    *("scene", "variables", "objective", "plan", "output", "final", "user_function", "relations"),
    *("at", "measured_at", "most_grains", "objective_at", "scenes", "used_values", "used_columns"),
    *("search", "ensemble", "stopping", "common_configurations", "max_framed", "max_strings"),
    *("first_sample", "given_strings", "space", "allowed_strings", "fraction", "volume"),
    *("derived_values", "function_error", "check_scales"),
    *("search_error", "required_plan", "engine", "file_name", "from_text"),
    *("count", "with_generations", "with_seed"),
    *("data", "data_entries", "census"),
)
"""Names of a campaign for the package's own modules: sections, and what builds or checks a run."""


@dataclass(frozen=True, eq=False, repr=False)
class Campaign(CampaignSections, metaclass=PublicFace, internal=CAMPAIGN_INTERNALS):
    """A validated campaign; equal campaigns have equal `identity`.

    `agglom_mpi.load_campaign(path)` returns one that can be simulated and run, too.

    Attributes
    ----------
    title : str
        Title of the campaign.
    seed : int
        Seed of all random streams.
    text, name : str
        Text of the file, and its name in errors.
    """

    def __repr__(self) -> str:
        return f"<Campaign {self.name!r}: {describe.in_a_few_words(self)}>"

    @classmethod
    def from_text(
        cls,
        text: str,
        name: str = "campaign.yaml",
        user_function: UserFunction | None = None,
        reading: Reading = PLAIN,
    ) -> "Campaign":
        """Return the campaign of a YAML text; `name` stands for the file in errors.

        `reading` finds components of one's own and files of sizes, and reads a text that a run
        recorded as it was read then.
        """
        document, entries = read_document(text, name, reading)
        campaign = cls(
            title=document.title,
            seed=document.seed,
            scene=document.scene,
            variables=bounds_of(document.variables, document.scene, entries.table, entries.paths),
            objective=document.objective,
            plan=document.plan,
            output=document.output,
            final=document.final,
            data=built_data(document.data),
            data_entries=document.data,
            text=text,
            name=name,
            user_function=user_function,
            relations=Relations(document.derived, document.constraints),
        )
        check_ends(campaign)
        if campaign.plan is not None:
            check_start(campaign, campaign.given_strings())
        return campaign

    def given_strings(self) -> npt.NDArray[np.float64]:
        """Return the strings that `search.start` lists, in SI units, shape (n, k)."""
        listed = self.search.listed
        return np.array([self.parameters(values) for values in listed]).reshape(
            -1, self.variables.table.count
        )

    def allowed(self, parameters: Parameters) -> npt.NDArray[np.bool_]:
        """Return which of n strings satisfy the constraints, shape (n,); the box does not matter.

        Parameters
        ----------
        parameters
            Values by name, numbers in SI units or texts with units, each (n,) or one for all; what
            is not given is fixed, or the middle of its range. Or all variables of the campaign in
            SI units, shape (k,) or (n, k).

        Raises
        ------
        CampaignError
            If a name is unknown or a value impossible.
        """
        return self.allowed_strings(read_strings(self, parameters))

    def warnings(self, parameters: Mapping[str, float | str] | None = None) -> list[Problem]:
        """Return what is unlikely in the campaign, or in one string of it; `str` of each is a line.

        Parameters
        ----------
        parameters
            Values of a string as for `parameters`; None: the whole search box.

        Raises
        ------
        CampaignError
            If a name is unknown or a value impossible.
        """
        from agglom_mpi.config.plausibility import implausible

        corners = refused_corners(self) if parameters is None and self.variables.paths else []
        return implausible(self, parameters) + corners

    def with_seed(self, seed: int) -> "Campaign":
        """Return the campaign with another seed, which its `text` has, too."""
        return replace(self, seed=seed, text=with_seed(self.text, self.name, seed))

    def with_generations(self, generations: int) -> "Campaign":
        """Return the campaign with another number of generations; its `text` is unchanged."""
        generations = self.count("stopping.generations", generations, least=1)
        stopping = self.stopping.model_copy(update={"generations": generations})
        return replace(self, plan=self.required_plan._replace(stopping=stopping))

    def in_volume(self, volume: int) -> "Campaign":
        """Return the campaign in `volume` times the control volume, with as many times the grains.

        The size of the grains and the volume fraction stay the same, and the objective is still
        that of the campaign's own number of grains. `simulate` of the result gives the samples of
        larger volumes that `final: {volumes: …}` asks for. `text` and `identity` are unchanged.
        """
        return replace(self, volume=self.count("volume", volume, least=1))

    def parameters(
        self,
        values: Mapping[str, float | str] | None = None,
        fill: Literal["lower", "centre", "upper"] = "centre",
    ) -> npt.NDArray[np.float64]:
        """Return one parameter string.

        Parameters
        ----------
        values
            Values by name, SI numbers or texts with units; they may lie outside the search box.
            `volume_fraction` may stand in place of `size_ratio`.
            A variable that the scene does not use is checked and then ignored.
        fill
            Which value of its range a variable takes that is not in `values`.

        Returns
        -------
        numpy.ndarray
            The variables in SI units, shape (k,): relative_speed, size_ratio, density, hardness,
            heat_capacity, friction, temperature, activation_energy, reaction_heat, surface_energy,
            then numbers of the scene by the order of their paths; nan where the scene does not use
            one.

        Raises
        ------
        CampaignError
            If a name is unknown or a value impossible.
        """
        return string_of(self, values or {}, fill)

    def engine(self, text: str | Engine | None) -> Engine:
        """Return the engine `event`, `fixed`, `fixed:STEPS` or `adaptive`; for None the scene's."""
        if text is None:
            return self.scene.engine
        if not isinstance(text, str):
            if not isinstance(text, Engine):
                message = f"is {text!r}; must be event, fixed, fixed:STEPS or adaptive"
                raise ArgumentError.of(self.name, "engine", message)
            return text
        try:
            return parse_engine(text, self.scene.engine)
        except ValueError as error:
            raise CampaignError(Problem(self.name, None, "engine", str(error))) from None

    def count(self, field: str, value: Any, least: int = 0) -> int:
        """Return a whole number of at least `least`, given as an argument `field`."""
        try:
            return read_count(value, least)
        except ValueError as error:
            raise ArgumentError.of(self.name, field, error) from None

    def identity(self) -> dict[str, object]:
        """Return all that decides results, flat: `scene.particles` -> 100, in SI units."""
        return identity.identity(self)

    def sha256(self) -> str:
        """Return the SHA-256 of `identity` as 64 hexadecimal digits."""
        return identity.digest(self.identity())

    def description(self) -> dict[str, object]:
        """Return what `describe` says, by headings, and the identity, as plain values for JSON."""
        return describe.as_dict(self)

    def describe(self) -> str:
        """Return a plain text on what would run, as `agglom check` prints it."""
        return describe.text(self)
