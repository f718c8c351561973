"""`agglom check`: is a campaign valid, or a campaign file sound?"""

import click

from agglom_mpi.cli.launch import exits
from agglom_mpi.cli.options import examples
from agglom_mpi.storage.signature import is_hdf5


@click.command(
    epilog=examples("agglom check jobs/quickstart.yaml", "agglom check accretion_2003.h5")
)
@click.argument("file")
@exits
def check(file: str) -> int:
    """Validate CAMPAIGN.yaml and print what would run, or verify what FILE.h5 holds.

    Of a campaign file, also while it is being written: whether every final row is whole, the
    numbers agree, and the search decides again from the samples what it decided. Exit codes of
    that: 0 sound, 1 damaged, 2 no campaign file or one of a newer version.
    """
    if is_hdf5(file):
        from agglom_mpi.analysis.replay import check_file

        text, code = check_file(file)
        click.echo(text)
        return code
    from agglom_mpi.config.campaign import check_campaign

    loaded = check_campaign(file)
    if loaded.plan is None:
        loaded.check_scales(loaded.parameters())
    else:
        loaded.check_searchable()
    click.echo(loaded.describe())
    return 0
