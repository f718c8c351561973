"""The scene of a string: the section of the campaign with the string's own numbers in it."""

from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.scene_paths import with_numbers
from agglom_mpi.declaration.given_values import SIZES
from agglom_mpi.simulation.engines import Engine
from agglom_mpi.variables import VOLUME_FRACTION, VariableTable, size_ratio

if TYPE_CHECKING:
    from agglom_mpi.simulation.scene import Scene


class StringScene(NamedTuple):
    """The scene of one string.

    Attributes
    ----------
    section
        Section with the numbers that the string gives.
    values
        The variables in SI units, by name, with a size ratio also where the volume fraction is the
        variable.
    """

    section: SceneSection
    values: dict[str, float]

    def build(self, engine: Engine | None = None) -> "Scene":
        """Return the scene as kernels see it; raises ValueError if it cannot be simulated.

        Parameters
        ----------
        engine
            Engine to use instead of the scene's.
        """
        return self.section.build(self.values, engine)


class StringScenes:
    """The scenes of the strings of a campaign; whoever evaluates one for a string asks it here.

    Where the strings have no numbers of the scene, all of them have the campaign's own section.

    Parameters
    ----------
    section
        Section `scene` of the campaign.
    table
        Its variables.
    volume
        Control volume relative to that of the section: all scenes have as many times the grains in
        as many times the volume, with the same size of the grains and the same volume fraction.

    Attributes
    ----------
    section
        The section in the control volume.
    table
    """

    def __init__(self, section: SceneSection, table: VariableTable, volume: int = 1) -> None:
        self.section = section.in_volume(volume)
        self._own_section = section
        self._volume = volume
        self.table = table
        self._numbers = table.of_scene
        self._own_fraction = VOLUME_FRACTION.name in table
        self._last: tuple[bytes, StringScene] | None = None

    @property
    def lengths_differ(self) -> bool:
        """Whether lengths of the section, or the law of sizes, depend on the string."""
        return any(map(self.table.has_numbers_of, (*SIZES, "sizes")))

    @property
    def sizes_differ(self) -> bool:
        """Whether the law of sizes depends on the string."""
        return self.table.has_numbers_of("sizes")

    def at(self, string: npt.ArrayLike) -> StringScene:
        """Return the scene of a string, shape (k,); that of the last one is kept.

        Raises
        ------
        ValueError
            If a law refuses its numbers together.
        """
        if not self._numbers:
            return StringScene(self.section, self.table.values_by_name(string))
        key, last = np.asarray(string, np.float64).tobytes(), self._last
        if last is None or last[0] != key:
            last = key, self.of_values(self.table.values_by_name(string))
            self._last = last
        section, values = last[1]
        return StringScene(section, dict(values))

    def of_values(self, values: Mapping[str, float]) -> StringScene:
        """Return the scene of a string whose variables are given by name; errors as of `at`."""
        own = dict(values)
        if not self._numbers:
            return StringScene(self.section, own)
        numbers = {name: own[name] for name in self._numbers}
        section = with_numbers(self._own_section, numbers).in_volume(self._volume)
        if self._own_fraction:
            own["size_ratio"] = size_ratio(own[VOLUME_FRACTION.name], section.third_moment)
        return StringScene(section, own)

    def rows(self, columns: Mapping[str, Any]) -> list[StringScene | None]:
        """Return the scenes of n strings, whose variables are given by name, each (n,).

        None stands for a string that a law refuses.
        """
        strings = np.column_stack([np.asarray(columns[name], float) for name in self.table.names])
        found: list[StringScene | None] = [None] * len(strings)
        for i, string in enumerate(strings):
            with suppress(ValueError):
                found[i] = self.of_values(self.table.values_by_name(string))
        return found


class FirstExperimentScenes(StringScenes):
    """The scenes of the strings of a campaign with experiments: those of the first one.

    Parameters
    ----------
    table
        Variables of the campaign.
    first
        The `CampaignExperiment`.
    """

    def __init__(self, table: VariableTable, first: Any) -> None:
        self._first = first
        super().__init__(first.campaign.scene, first.campaign.variables)
        self.table = table

    def at(self, string: npt.ArrayLike) -> StringScene:
        """Return the first experiment's scene of a string, shape (k,)."""
        scenes: StringScenes = self._first.campaign.scenes
        return scenes.at(self._first.own(string))

    def of_values(self, values: Mapping[str, float]) -> StringScene:
        """Return the same of a string whose variables are given by name."""
        return self.at(np.array([values[name] for name in self.table.names]))
