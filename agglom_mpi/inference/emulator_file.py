"""The emulator of a campaign as a file that NumPy alone evaluates, and as an object of Python.

The file is an archive of plain arrays. A block of arrays, whose names begin with its number, holds
the Gaussian processes of numbers with the same points; `place NAME` is the block and the values of
a quantity in it. `portable_emulator.py` evaluates them, and is written beside the file.
"""

import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from agglom_mpi.config.arguments import mistaken_argument
from agglom_mpi.config.plan import DEFAULT_TOLERANCE, read_robust
from agglom_mpi.declaration.units import to_si
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.emulation.emulator import Emulator
from agglom_mpi.errors import UserError
from agglom_mpi.file_kinds import is_hdf5
from agglom_mpi.formatting import pluralise
from agglom_mpi.inference import portable_emulator
from agglom_mpi.inference.calibration import MIN_COVERAGE, region_of
from agglom_mpi.inference.data_emulator import EmulatedData
from agglom_mpi.inference.emulated_set import mean_over_deviations, settled_numbers, tolerance_of
from agglom_mpi.inference.feasible_set import feasible_set
from agglom_mpi.inference.portable_emulator import FORMAT, GROWTH, PortableEmulator
from agglom_mpi.inference.searched_box import EmulatedBox, SearchedBox
from agglom_mpi.inference.stored_samples import (
    StoredSamples,
    favours_low_objectives,
    require_emulated,
    require_strings,
    stored_samples,
    string_values,
)
from agglom_mpi.public_face import PublicFace
from agglom_mpi.random_streams import FEASIBLE_SET
from agglom_mpi.search.criteria import Criterion, NoCriterionError
from agglom_mpi.statistics import Floats
from agglom_mpi.storage.files import atomic_file, require_absent, require_writable_folder
from agglom_mpi.storage.reader import read_inversion
from agglom_mpi.storage.recorded_campaign import recorded_campaign, recorded_objective
from agglom_mpi.version import __version__

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

Arrays = dict[str, Any]


class NoEmulatorError(UserError, ValueError):
    """A campaign without an emulator, or a file that holds none, with the reason."""


class EmulatorRequest(NamedTuple):
    """An emulator to be written: its path, and the tolerance of the set, None for the default."""

    path: Path
    tolerance: float | str | None = None

    @property
    def module(self) -> Path:
        """Path of the module beside the file."""
        return self.path.with_suffix(".py")

    def check(self) -> None:
        """Raise a NoEmulatorError or an OSError if there are files, or they cannot be written."""
        if self.path.suffix != ".npz":
            raise NoEmulatorError(f"{self.path}: --emulator: a file name; must end with .npz")
        for path in (self.path, self.module):
            require_absent(path)
        require_writable_folder(self.path)

    def write(self, arrays: Arrays) -> Iterator[str]:
        """Write the file and its module, each whole or not at all, and yield lines on them.

        Raises
        ------
        OSError
            If they cannot be written.
        """
        with ExitStack() as files:
            module = files.enter_context(atomic_file(self.module))
            module.write_bytes(Path(portable_emulator.__file__).read_bytes())
            temporary = files.enter_context(atomic_file(self.path))
            with temporary.open("wb") as file:
                np.savez_compressed(file, **arrays)
        names = ", ".join(arrays["quantities"][:, 0])
        size = pluralise(self.path.stat().st_size, "byte")
        yield f"{self.path}: {names} by {', '.join(arrays['names'])}, {size}"
        yield f"{self.module}: evaluates it with NumPy alone"
        for key, text in arrays["about"].tolist():
            if key not in ("title", "digest", "version"):
                yield f"{self.path}: {key}: {text}"


@single_threaded
def emulator_arrays(data: "CampaignData", tolerance: float | str | None = None) -> Arrays:
    """Return the arrays of the file by name.

    Growth is always emulated, and so are all measured data that need samples. Where the objective
    has a target for a number of a sample, that is emulated, too, with the bounds of its set.

    Raises
    ------
    NoEmulatorError, NoFeasibleSetError
        If the strings cannot be emulated, with the reason.
    CampaignError
        If the tolerance is impossible, or there is no set that it could be of.
    """
    campaign = recorded_campaign(data)
    require_emulated(data, NoEmulatorError)
    band, stored, box = _band(data, tolerance), stored_samples(data), SearchedBox(campaign)
    require_strings(data, stored.strings, "an emulator", NoEmulatorError)
    arrays, about = _box_arrays(box), {"title": data.title, "digest": campaign.sha256()}
    about["version"] = __version__
    name = GROWTH if band is None else band.quantities[0]
    if band is not None:
        found = feasible_set(data, DEFAULT_TOLERANCE if tolerance is None else tolerance)
        about |= {"set": band.text, "calibration": found.calibration.text}
        arrays |= {"target": np.array(name), "band": np.array(band.bounds())}
        arrays |= _block(0, found.emulated, found.emulated.emulator.processes)
        arrays |= {f"place {name}": np.array([0, 0, 1])}
        if (failures := found.emulated.failures) is not None:
            arrays |= _block(1, found.emulated, [failures]) | {"place failing": np.array([1, 0, 1])}
    if band is None or name != GROWTH:
        growth = settled_numbers(np.asarray(stored.rows[GROWTH], np.float64)[:, None])
        of = EmulatedBox(box, stored.strings, growth, stored, FEASIBLE_SET, of_ratios=True)
        arrays |= _block(2, of, of.emulator.processes) | {f"place {GROWTH}": np.array([2, 0, 1])}
        about["growth"] = _held_out(of)
    arrays["quantities"] = np.array([[each, "1"] for each in dict.fromkeys([GROWTH, name])])
    if data.sizes.census is not None:
        about |= _add_data(arrays, box, data, stored)
    if favours_low_objectives(data):
        about["samples"] = "a search for the best chose some by the results of others: a bias"
    if campaign.relations.constraints:
        texts = "; ".join(each.text for each in campaign.relations.constraints)
        about["constraints"] = f"not evaluated, nor in the probability: {texts}"
    return arrays | {"about": np.array([*about.items()])}


def _band(data: "CampaignData", tolerance: float | str | None) -> Criterion | None:
    """Return the criterion of an objective with a target for a number of a sample, or None."""
    criterion = None
    with suppress(NoCriterionError):
        wanted = tolerance_of(data, DEFAULT_TOLERANCE if tolerance is None else tolerance)
        criterion = recorded_objective(data).criterion(wanted)
    if criterion is not None and criterion.is_band and np.isfinite(criterion.bounds()).any():
        return criterion
    if tolerance is not None:
        message = f"is {tolerance}; must be left out, as no set of the objective is exported"
        raise mistaken_argument(data.path, "tolerance", message)
    return None


def _box_arrays(box: SearchedBox) -> Arrays:
    """Return names, ends, units and scales, and what makes components of strings of the values."""
    own = box.own
    arrays = {name: np.array([getattr(v, name) for v in own]) for name in ("lower", "upper")}
    return arrays | {
        "format": np.array(FORMAT),
        "names": np.array(box.names),
        "units": np.array([v.unit for v in own]),
        "scales": np.array([v.scale or "linear" for v in own]),
        "factors": np.array([1.0 if v.cubes is None else 6.0 / (np.pi * v.cubes) for v in own]),
        "exponents": np.array([1.0 / v.power for v in own]),
    }


def _block(number: int, of: EmulatedBox, emulators: list[Emulator], **linear: Floats) -> Arrays:
    """Return k emulators with the same points, in the coordinates of `of`.

    The values are `offset`, (q,), plus `mixing`, (q, k), times the k numbers; `rest`, (q,), is the
    variance of what is not emulated. By default they are the numbers.
    """
    zero, parts = np.zeros(len(emulators)), [emulator.process.arrays() for emulator in emulators]
    block = {"mixing": np.eye(len(emulators)), "offset": zero, "rest": zero} | linear
    block |= {name: np.array([part[name] for part in parts]) for name in parts[0]}
    points: Arrays = {"points": emulators[0].data.points, "kept": of.coordinates.kept}
    named = {f"{number} {name}": values for name, values in (block | points).items()}
    return named | of.coordinates.arrays()


def _held_out(of: EmulatedBox) -> str:
    """Return how many held-out means the 90 % intervals hold."""
    scores = np.array([(means - m) / d for means, m, d in of.emulator.held_out])
    region = region_of("the box", scores)
    held = f"90 % intervals hold {100.0 * region.coverage:.3g} % of {region.strings} held-out means"
    return held if region.coverage >= MIN_COVERAGE else f"not calibrated: {held}"


def _add_data(
    arrays: Arrays, box: SearchedBox, file: "CampaignData", stored: StoredSamples
) -> dict[str, str]:
    """Add all measured data that need samples; return a note on how well they are emulated."""
    data = box.campaign.data
    if all(datum.kind.is_exact for datum in data):
        return {}
    values = string_values(file, data, stored)
    require_strings(file, values.strings, "an emulator", NoEmulatorError)
    of = EmulatedData(box, data, values, stored)
    back = np.linalg.pinv(of.frame.basis)
    linear = {
        "mixing": back.T @ of.components @ of.emulator.mixing,
        "offset": of.values_of(np.zeros(len(of.measured)), np.zeros(len(of.left_out_variance))),
        "rest": of.left_out_variance @ (of.left_out.T @ back) ** 2,
    }
    arrays |= _block(3, of, of.emulator.processes, **linear)
    names, units = [datum.name for datum in data], []
    for i, (datum, rows) in enumerate(zip(data, of.frame.rows, strict=True), 1):
        if datum.kind.is_exact:
            continue
        name = datum.name if names.count(datum.name) == 1 else f"{datum.name} ({i})"
        units.append([name, datum.kind.unit])
        arrays[f"place {name}"] = np.array([3, rows.start, rows.stop])
        if datum.edges is not None:
            arrays[f"edges {name}"] = datum.edges
    arrays["quantities"] = np.vstack((arrays["quantities"], units))
    return {"data": _held_out(of)}


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
        known = super().probability
        if not robust:
            return known(strings)
        shares = read_robust(self.about["title"], robust, self.box)
        at = {name: np.asarray(self._read(name, value)) for name, value in strings.items()}

        def moved(places: Any) -> dict[str, Any]:
            factors = {n: 1.0 + s * p for (n, s), p in zip(shares.items(), places, strict=True)}
            return {n: np.clip(at[n] * factor, *self.box[n][:2]) for n, factor in factors.items()}

        return mean_over_deviations(lambda places: known(at | moved(places)), len(shares))

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
