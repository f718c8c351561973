"""The campaign file of a run: its name, and how it is created, or checked and reopened."""

import json
import os
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.census_layout import uncounted, with_census_of
from agglom_mpi.config.own_components import recorded_texts
from agglom_mpi.config.yaml_source import parse
from agglom_mpi.declaration.reading import SOURCE_SHA256, SOURCE_VALUES
from agglom_mpi.errors import UserError
from agglom_mpi.formatting import pluralise, shortened, value_with_prefix
from agglom_mpi.runtime.experiment import Experiment
from agglom_mpi.runtime.provenance import sources_digest
from agglom_mpi.search.methods.method import SearchMethod
from agglom_mpi.storage.access import DamagedCampaign
from agglom_mpi.storage.columns import layouts_of
from agglom_mpi.storage.create import create_campaign_file, enlarge_campaign_file, replace_data
from agglom_mpi.storage.reader import CampaignData, read_campaign
from agglom_mpi.storage.room import check_room
from agglom_mpi.version import __version__

_DATA: Final = re.compile(r"(experiments\.[^.]+\.)?data\.")
"""Begin of the entries of an identity on data."""


class OutputError(UserError, ValueError):
    """The output file cannot be used for this campaign; one message, exit code 2."""


def output_path(campaign: Campaign, output: str | None, seed: int | None = None) -> Path:
    """Return the file that a run writes: the option, else the campaign's own, else its stem.

    Parameters
    ----------
    campaign
    output
        Name of the file; None: that of the campaign.
    seed
        Seed that replaces the campaign's, and is then part of the name; None: none does.

    Raises
    ------
    OutputError
        If the file or its directory cannot be written.
    """
    path = Path(output or campaign.file_name)
    if seed is not None and path.name and not path.is_dir() and not _names_seed(path, seed):
        path = path.with_stem(f"{path.stem}_seed{seed}")
    check_writable(path)
    return path


def as_recorded(campaign: Campaign, path: Path) -> Campaign:
    """Return a campaign with the censuses of its existing file, and the search if it names none.

    The default method differs by version, and a file is continued by the one it was made with.
    """
    plan = campaign.plan
    if plan is None or not path.exists():
        return campaign
    if campaign.data or campaign.experiments:
        campaign = with_census_of(campaign, read_campaign(path).sizes.census)
    section = parse(campaign.text, campaign.name).data.get("search") or {}
    if section.keys() - {"start"}:
        return campaign
    method = str(read_campaign(path).identity.get("search.method"))
    stored = SearchMethod.components().get(method)
    if stored is None or stored is type(plan.search):
        return campaign
    return replace(campaign, plan=plan._replace(search=stored(start=plan.search.start)))


def _names_seed(path: Path, seed: object) -> bool:
    return path.stem.endswith(f"_seed{seed}")


def check_writable(path: Path) -> None:
    """Raise an OutputError unless a file can be written there."""
    if path.is_dir():
        raise OutputError(f"{path}: is a directory; give the name of a file")
    if not path.parent.is_dir():
        raise OutputError(f"{path}: the directory {path.parent} does not exist")
    if not os.access(path.parent, os.W_OK):
        raise OutputError(f"{path}: the directory {path.parent} cannot be written")
    if path.exists() and not os.access(path, os.W_OK):
        raise OutputError(f"{path}: is read-only; --output names another file")


def prepare(
    path: Path,
    experiment: Experiment,
    accept_code_change: bool = False,
    accept_new_data: bool = False,
) -> CampaignData:
    """Open the campaign's file for a resume, or create it.

    With `accept_new_data` a file that differs in its data alone gets those of the campaign.

    Raises
    ------
    NotACampaign
        If something else lies there.
    OutputError
        If it belongs to other work or to other simulation sources.
    CampaignError
        If it would be too large.
    """
    sizes, campaign = experiment.table_sizes, experiment.campaign
    if not path.exists():
        check_room(campaign, sizes)
        description = {
            **_texts(experiment),
            "seed": campaign.seed,
            "code_version": __version__,
            "sources_sha256": sources_digest(),
            "purpose": experiment.purpose,
            **recorded_texts(campaign),
        }
        box = campaign.variables.lower, campaign.variables.upper
        rows, learned = None, experiment.learned
        if learned is not None:
            rows = learned.rows
            description.update(learned.attributes)
        create_campaign_file(path, description, box, sizes, rows)
        return read_campaign(path, allow_code=True)  # the campaign has leave already
    stored = read_campaign(path, allow_code=True)
    if stored.altered:
        altered = f"a damaged campaign file ({', '.join(stored.altered)} altered)"
        raise DamagedCampaign(f"{path}: {altered}; restore a copy, or start afresh with --output")
    renewed = accept_new_data and other_data(stored.identity, experiment.identity())
    if renewed:
        check_new_data(path, stored, campaign)
    else:
        check_same_campaign(path, stored.identity, experiment.identity())
    if stored.fresh_from != sizes.max_samples:  # or decisions would see other samples
        raise DamagedCampaign(f"{path}: a damaged campaign file (attribute fresh_from is altered)")
    if stored.last_sources != sources_digest() and not accept_code_change:
        raise OutputError(
            f"{path}: was computed by other simulation sources (version "
            f"{stored.attributes['code_version']}, this is {__version__}); samples would not be "
            "comparable. --accept-code-change continues all the same, --output starts afresh"
        )
    check_room(campaign, sizes, path.stat().st_size)
    if renewed:
        replace_data(path, _texts(experiment), _data_of(stored.identity))
        stored = read_campaign(path, allow_code=True)
    return read_campaign(path, True) if enlarge_campaign_file(path, sizes) else stored


def _texts(experiment: Experiment) -> dict[str, str]:
    """Return the attributes on what is asked."""
    return {
        "campaign": experiment.campaign.text,
        "identity": json.dumps(experiment.identity(), sort_keys=True),
        "campaign_sha256": experiment.sha256(),
        "title": experiment.campaign.title,
    }


def _data_of(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of an identity on data, of all experiments."""
    return {key: value for key, value in identity.items() if _DATA.match(key)}


def other_data(stored: Mapping[str, Any], wanted: Mapping[str, Any]) -> bool:
    """Return whether two identities have different data, and differ in nothing else."""
    data, others = _data_of(wanted), wanted.keys() - _data_of(wanted).keys()
    same = stored.keys() - _data_of(stored).keys() == others
    same = same and all(stored[key] == wanted[key] for key in others)
    return bool(data) and same and data != _data_of(stored)


def check_new_data(path: Path, stored: CampaignData, campaign: Campaign) -> None:
    """Raise an OutputError if the samples of a file do not have what new data need."""
    layout = stored.sizes.census
    if layout is None:
        raise OutputError(f"{path}: its samples have no sizes to compare with new data")
    if absent := uncounted(campaign, layout):
        raise OutputError(
            f"{path}: cannot be read with the new data, because {absent}; --output names another "
            "file, whose samples are simulated anew"
        )
    if campaign.search.added_samples is not None:
        raise OutputError(
            f"{path}: cannot be read with new data, because search.more_samples added samples to "
            "strings that the former data chose; --output names another file"
        )


def kept_as_it_was(path: Path, file: CampaignData, experiment: Experiment) -> list[str]:
    """Return lines on requests of a campaign that its existing file does not follow."""
    lines = []
    held, asked = len(file.generation_rows()), experiment.table_sizes.generations
    if held > asked:
        lines.append(
            f"{path}: holds {pluralise(held, 'generation')} already, more than the {asked} asked "
            "for; they stay, and none is added"
        )
    if before := file.strings_of_earlier_data:
        lines.append(f"{path}: {pluralise(before, 'string')} of it were chosen by earlier data")
    counted = file.sizes.census
    layouts = {} if counted is None else layouts_of(counted)
    times = {time for each in layouts.values() for time in each.times}
    if absent := sorted(set(experiment.campaign.output.census) - times):
        shown = ", ".join(value_with_prefix(time, "s") for time in absent)
        lines.append(f"{path}: has no censuses at {shown}, and gets none (--output)")
    if experiment.campaign.title != file.attributes["title"]:
        lines.append(
            f"{path}: keeps the title {file.title!r} that it was made with; it is now "
            f"{shortened(experiment.campaign.title)!r}, which a file of another name would get "
            "(--output)"
        )
    return lines


def check_same_campaign(path: Path, stored: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Raise an OutputError that names every difference between two campaigns.

    Values of own code that the file does not record are none: earlier versions left some out.
    """
    unknown = {key for key in wanted.keys() - stored.keys() if f".{SOURCE_VALUES}." in key}
    keys = sorted((stored.keys() | wanted.keys()) - unknown)
    different = [key for key in keys if stored.get(key) != wanted.get(key)]
    if different == ["seed"]:
        held, asked = stored["seed"], wanted["seed"]
        option = f"--seed {held}" if _names_seed(path, held) else f"'seed: {held}' in the campaign"
        raise OutputError(
            f"{path}: was made with seed {held}, not {asked}; {option} continues it, --output "
            "names another file"
        )
    if different:
        remedy = "--output names another file"
        if other_data(stored, wanted):
            accepts = "--accept-new-data reads its samples with these data, if these suffice"
            remedy = f"{accepts}; {remedy}"
        raise OutputError(
            f"{path}: belongs to another campaign; {remedy}. Different are:\n"
            + "\n".join(
                f"  {key}: {_brief(stored.get(key, 'absent'))} in the file, "
                f"{_brief(wanted.get(key, 'absent'))} now{_edited(key, wanted)}"
                for key in different
            )
        )


def _edited(key: str, wanted: dict[str, Any]) -> str:
    """Return a remark on the module of one's own whose digest is different, if it is one."""
    section, _, name = key.rpartition(".")
    keys = (f"{section}.{named_by}" for named_by in ("law", "method", "rule", "call"))
    names = [str(wanted[each]) for each in keys if name == SOURCE_SHA256 and each in wanted]
    file = next((each.partition(":")[0] for each in names if ":" in each), "")
    return f": {file.removesuffix('.py')}.py was edited" if file else ""


def _brief(value: object) -> str:
    """Return a value of an identity as text, the middle of a long one left out."""
    text = str(value)
    return text if len(text) <= 80 else f"{text[:50]} ... {text[-20:]}"
