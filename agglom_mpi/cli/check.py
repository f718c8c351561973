"""`agglom check`: validate a campaign, or verify a campaign file."""

import click

from agglom_mpi.cli.common import examples, exit_with, say
from agglom_mpi.storage.signature import is_hdf5


@click.command(
    epilog=examples("agglom check jobs/quickstart.yaml", "agglom check accretion_2003.h5")
)
@click.argument("file")
@exit_with
def check(file: str) -> int:
    """Validate CAMPAIGN.yaml and print what would run, or verify the contents of FILE.h5.

    Verifies checksums, the agreement of all numbers, and that the stored samples lead to the stored
    decisions of the search; also while the file is being written. Exit codes: 0 valid or sound, 1
    damaged, 2 invalid, no campaign file, or a newer format version.
    """
    if is_hdf5(file):
        from agglom_mpi.analysis.replay import check_file

        text, code = check_file(file)
        say(text)
        return code
    from agglom_mpi.config.loading import check_campaign

    loaded = check_campaign(file)
    if loaded.plan is None:
        loaded.check_scales(loaded.parameters())
    else:
        loaded.check_searchable()
    say(loaded.describe())
    return 0
