"""`agglom check`: validate a campaign, or verify a campaign file."""

import json
from math import isfinite
from pathlib import Path

import click

from agglom_mpi.cli.common import ALLOW_CODE, JSON, STRICT, examples, exit_with, say
from agglom_mpi.file_kinds import is_hdf5
from agglom_mpi.formatting import in_unit


@click.command(
    epilog=examples("agglom check jobs/quickstart.yaml", "agglom check accretion_2003.h5")
)
@click.argument("file")
@ALLOW_CODE
@STRICT
@JSON
@exit_with
def check(file: str, allow_code: bool, strict: bool, as_json: bool) -> int:
    """Validate CAMPAIGN.yaml and print what would run, or verify the contents of FILE.h5.

    For CAMPAIGN.yaml, the output includes the size of the file that a run would write. Warnings
    about unlikely values go to standard error. With --allow-code, your own components are tested,
    and the function of the objective is called with one sample from the middle of the search box.

    For FILE.h5, the command verifies the checksums, the agreement of all numbers, and that the
    stored samples lead to the stored decisions of the search. The run may still be writing.

    Exit codes: 0 valid or sound; 1 damaged; 2 invalid, not a campaign file, or of a newer format
    version.
    """
    if is_hdf5(file):
        if strict:
            raise click.UsageError("--strict is for CAMPAIGN.yaml")
        from agglom_mpi.analysis.file_check import check_file

        text, code = check_file(file, allow_code)
        sound = {"file": file, "sound": code == 0, "lines": text.splitlines()}
        say(json.dumps(sound, indent=2) if as_json else text)
        return code
    from agglom_mpi.config.loading import check_campaign
    from agglom_mpi.config.searchable import check_searchable
    from agglom_mpi.config.yaml_source import warn
    from agglom_mpi.contracts.promises import promises_of
    from agglom_mpi.storage.room import check_room, size_text, table_sizes

    loaded, narrow = check_campaign(file, allow_code), []
    if loaded.plan is None:
        loaded.check_scales(loaded.parameters())
        size = None
    else:
        narrow = check_searchable(loaded)
        sizes = table_sizes(loaded)
        if loaded.search.earlier is not None or loaded.search.learns_from is not None:
            from agglom_mpi.analysis.warm_start import warm_start

            start = warm_start(loaded, Path(loaded.file_name))  # as a run reads it
            narrow = [*narrow, *start.warnings]
            sizes = sizes._replace(learned=len(start.learned.rows) if start.learned else 0)
        check_room(loaded, sizes)
        size = sizes.file_bytes()
    warnings = [*loaded.warnings(), *narrow]
    warn(warnings, strict, lambda line: say(line, error=True))
    promises = promises_of(loaded, allow_code)
    tried = None
    if allow_code:
        from agglom_mpi.verbs.simulate import try_function  # loads the kernels

        tried = try_function(loaded)
    if as_json:
        found = loaded.description() | {"warnings": [str(warning) for warning in warnings]}
        found |= {} if size is None else {"file_bytes": size}
        found |= {"properties": promises} if promises else {}
        if tried is not None:
            found |= {"function_value": tried.objective if isfinite(tried.objective) else None}
            found |= {"function_quantities": tried.quantities} if tried.quantities else {}
        say(json.dumps(found, indent=2))
        return 0
    say(loaded.describe())
    if size is not None:
        say(f"File\n  size: {size_text(size)} at most; on the disk, as much as has been written")
    if promises:
        say("\n".join(["Properties", *(f"  {line}" for line in promises)]))
    if tried is not None:
        say(f"Function\n  a sample in the middle of the box is worth {tried.objective:.6g}")
        for name, value in tried.quantities.items():
            say(in_unit(f"    {name} {value:.6g}", loaded.objective.quantity_units[name]))
    return 0
