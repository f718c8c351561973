"""The emulator of a campaign, from its own file or from one that an export has written."""

import os
from collections.abc import Mapping
from io import BytesIO
from typing import Any

import numpy as np

from agglom_mpi.config.plan import read_robust
from agglom_mpi.declaration.units import to_si
from agglom_mpi.file_kinds import is_hdf5
from agglom_mpi.inference.emulator_file import NoEmulatorError, emulator_arrays
from agglom_mpi.inference.portable_emulator import PortableEmulator
from agglom_mpi.inference.wobble import even_places
from agglom_mpi.public_face import PublicFace
from agglom_mpi.storage.reader import read_inversion


class CampaignEmulator(PortableEmulator, metaclass=PublicFace):
    """Emulated means of any string of a campaign's box.

    `agglom_mpi.load_emulator(path)` returns it. Strings are values by name, in a mapping or a
    DataFrame: SI numbers or texts with units, one or an array of any shape. A string outside of the
    box is a ValueError, which names the variable, its value and its range.

    Attributes
    ----------
    box
        Lower and upper end in SI units, SI unit and scale of each searched variable by its name.
    quantities
        SI unit of each emulated quantity by its name: `mean_radius_ratio`, which is b/b0, and data.
    edges
        Diameters in m between the classes of each quantity that is a size curve.
    about
        Title and digest of the campaign, version of this package, and how well means are known.
    """

    def __repr__(self) -> str:
        known = f"{', '.join(self.quantities)} by {', '.join(self.box)}"
        return f"<CampaignEmulator of {self.about['title']!r}: {known[:150]}>"

    mean, deviation = PortableEmulator.mean, PortableEmulator.deviation

    def probability(self, strings: Any, robust: Mapping[str, float | str] | None = None) -> Any:
        """Return the probability that strings are members of the set, but for its constraints.

        Parameters
        ----------
        strings
            Each searched variable by its name.
        robust
            Deviations to average over, such as `{"relative_speed": "5%"}`, as of `feasible_set`.

        Raises
        ------
        ValueError
            If a string is outside of the box, the objective has no target, or a deviation is
            impossible.
        """
        own = super().probability(strings)
        if not robust:
            return own
        shares = read_robust(self.about["title"], robust, self.box)
        strings = {name: np.asarray(self._read(name, value)) for name, value in strings.items()}
        found = []
        for places in even_places(len(shares)):
            moved = dict(strings)
            for (name, share), place in zip(shares.items(), places, strict=True):
                lower, upper, *_ = self.box[name]
                moved[name] = np.clip(strings[name] * (1.0 + share * place), lower, upper)
            found.append(super().probability(moved))
        return np.mean(found, axis=0)

    def _at(self, strings: Any, quantity: str) -> Any:
        read = {str(name): self._read(str(name), value) for name, value in strings.items()}
        return super()._at(read, quantity)

    def _read(self, name: str, value: Any) -> Any:
        """Return a value or an array of them with texts in SI units."""
        given = np.asarray(value)
        if name not in self.box or given.dtype.kind in "iuf":
            return value
        try:
            numbers = [to_si(each, self.box[name][2]) for each in given.ravel().tolist()]
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
        return np.reshape(numbers, given.shape)


def load_emulator(
    path: str | os.PathLike[str], tolerance: float | str | None = None, allow_code: bool = False
) -> "CampaignEmulator":
    """Return the emulator of a campaign file, or one that `agglom export --emulator` has written.

    Parameters
    ----------
    path
        The HDF5 file of a campaign, which takes seconds, or the exported file `.npz`.
    tolerance
        Of the set of a campaign file whose objective has a target, by default `"5%"`; an exported
        file has its own.
    allow_code
        Whether components of one's own, whose code a campaign file has, may be executed.

    Returns
    -------
    CampaignEmulator
        Mean, deviation and probability at any string of the box.

    Raises
    ------
    NoEmulatorError, NoFeasibleSetError
        If the file is no emulator, or the strings of the campaign cannot be emulated.
    NotACampaign, OSError
        As from `open_campaign`.
    ValueError
        If the tolerance is impossible.

    Examples
    --------
    >>> import agglom_mpi
    >>> agglom_mpi.load_emulator("quickstart.h5")  # searches too few strings
    Traceback (most recent call last):
        ...
    agglom_mpi.inference.emulator_file.NoEmulatorError: quickstart.h5: results of ...
    """
    if is_hdf5(path):
        arrays = emulator_arrays(read_inversion(path, allow_code), tolerance)
        buffer = BytesIO()
        np.savez(buffer, **arrays)
        buffer.seek(0)
        return CampaignEmulator(buffer)
    if tolerance is not None:
        raise NoEmulatorError(
            f"{path}: tolerance: value {tolerance}; must be left out, as the file has its own"
        )
    try:
        return CampaignEmulator(path)
    except OSError:
        raise
    except Exception as error:  # whatever NumPy and zipfile raise of other files
        raise NoEmulatorError(
            f"{path}: no emulator that agglom export --emulator has written ({error})"
        ) from None
