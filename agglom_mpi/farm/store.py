"""The campaign file of a run: made, found again and checked before anything is simulated."""

import os
import platform
import socket
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import h5py

from agglom_mpi import __version__
from agglom_mpi.campaign import Campaign
from agglom_mpi.compilation import sources_digest
from agglom_mpi.database.create import create_campaign_file, grow_campaign_file
from agglom_mpi.database.reader import CampaignFile, open_campaign
from agglom_mpi.farm.revision import git_revision
from agglom_mpi.farm.work import Work


class StoreError(ValueError):
    """The output file cannot be used for this campaign; one message, exit code 2."""


def output_path(campaign: Campaign, output: str | None) -> Path:
    """File that a run of this campaign writes: the option, the campaign's own, or its stem.

    Raises
    ------
    StoreError
        If the file or its directory cannot be written.
    """
    path = Path(output or campaign.output.file or f"{Path(campaign.name).stem}.h5")
    check_writable(path)
    return path


def check_writable(path: Path) -> None:
    """Raise a StoreError unless a file can be written there."""
    if path.is_dir():
        raise StoreError(f"{path}: is a directory; give the name of a file")
    if not path.parent.is_dir():
        raise StoreError(f"{path}: the directory {path.parent} does not exist")
    if not os.access(path.parent, os.W_OK):
        raise StoreError(f"{path}: the directory {path.parent} cannot be written")
    if path.exists() and not os.access(path, os.W_OK):
        raise StoreError(f"{path}: is read-only; --output names another file")


def prepare(path: Path, work: Work, accept_code_change: bool) -> CampaignFile:
    """Open the campaign's file for a resume, or make it.

    Raises
    ------
    NotACampaign
        If something else lies there.
    StoreError
        If it belongs to other work or to other simulation sources.
    """
    room, campaign = work.room, work.campaign
    if not path.exists():
        create_campaign_file(
            path,
            campaign_text=campaign.text,
            campaign_sha256=work.sha256(),
            identity=work.identity(),
            seed=campaign.seed,
            title=campaign.title,
            purpose=work.purpose,
            code_version=__version__,
            sources_sha256=deciding_sources(),
            lower=campaign.variables.lower,
            upper=campaign.variables.upper,
            **room._asdict(),
        )
        return open_campaign(path)
    stored = open_campaign(path)
    check_same_campaign(path, stored.identity, work.identity())
    if last_sources(stored) != deciding_sources() and not accept_code_change:
        raise StoreError(
            f"{path}: was computed by other simulation sources (version "
            f"{stored.attributes['code_version']}, this is {__version__}); samples would not be "
            "comparable. --accept-code-change continues all the same, --output starts afresh"
        )
    grow_campaign_file(
        path,
        room.strings,
        room.generations,
        grains=room.grains,
        final_particles=room.final_particles,
        frames=room.frames,
    )
    return stored


def lacking_room(path: Path, file: CampaignFile, work: Work) -> str:
    """Say that there is less room for fresh samples than asked for; nothing if there is enough."""
    room, wanted = file.max_samples - file.fresh_from, work.room.fresh
    if room >= wanted:
        return ""
    return (
        f"{path}: has room for {room} of the {wanted} fresh samples of a string that final asks "
        "for; it was made for no more"
    )


def deciding_sources() -> str:
    """Hash of the sources that decide a campaign: those of samples, search and variables."""
    return sources_digest("search/*.py", "variables.py")


def last_sources(stored: CampaignFile) -> str:
    """Hash of the sources that the last leg of a campaign, or its creation, ran with."""
    legs = stored.legs()
    if len(legs):
        return str(legs[-1]["sources_sha256"].decode())
    return str(stored.attributes["sources_sha256"])


def check_same_campaign(path: Path, stored: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Raise a StoreError that names every difference between two campaigns."""
    different = [
        f"  {key}: {stored.get(key, 'absent')} in the file, {wanted.get(key, 'absent')} now"
        for key in sorted(stored.keys() | wanted.keys())
        if stored.get(key) != wanted.get(key)
    ]
    if different:
        raise StoreError(
            f"{path}: belongs to another campaign; --output names another file. Different are:\n"
            + "\n".join(different)
        )


def versions() -> dict[str, str]:
    """Versions of what a leg ran with."""
    found = {"python": platform.python_version(), "hdf5": h5py.version.hdf5_version}
    for package in ("numpy", "numba", "h5py", "mpi4py"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = ""
    return found


def leg_fields(
    ranks: int, mpi: str, *, nodes: int = 1, database: str = "gathered"
) -> dict[str, Any]:
    """Collect what is recorded of a start of the program."""
    return {
        "started": time.time(),
        "ranks": ranks,
        "nodes": nodes,
        "database": database,
        "host": socket.gethostname(),
        "processor": processor(),
        "code_version": __version__,
        "sources_sha256": deciding_sources(),
        "git_revision": git_revision(),
        "versions": versions() | {"mpi": mpi},
    }


def processor() -> str:
    """Kind of processor that this is, as far as the system says."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def in_words(error: Exception) -> str:
    """Text of a mistake of the user's; of one with a file, the file first."""
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return str(error)
