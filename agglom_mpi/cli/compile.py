"""`agglom compile`: compile the kernels of campaigns ahead of their runs."""

import click

from agglom_mpi.cli.common import ALLOW_CODE, examples, exit_with, say


@click.command(epilog=examples("agglom compile jobs/accretion_2003.yaml jobs/quickstart.yaml"))
@click.argument("campaigns", nargs=-1, required=True, metavar="CAMPAIGN.yaml...")
@ALLOW_CODE
@exit_with
def compile(campaigns: tuple[str, ...], allow_code: bool) -> int:
    """Compile the kernels that CAMPAIGN.yaml needs, unless they are in the cache.

    A run then starts without waiting for the compiler. Kernels are valid for one installation and
    one kind of processor. The cache may be read-only afterwards.
    """
    from agglom_mpi.compilation.kernels import cache_folder
    from agglom_mpi.config.loading import check_campaign
    from agglom_mpi.formatting import format_duration
    from agglom_mpi.judge import compile_loop
    from agglom_mpi.simulation.compilation import compile_kernels

    loaded = [check_campaign(path, allow_code) for path in campaigns]
    compile_loop()  # of rank 0, in a moment
    for path, campaign in zip(campaigns, loaded, strict=True):
        counts, seconds = campaign.census is not None, 0.0
        for each in [own.campaign for own in campaign.experiments] or [campaign]:
            scene = each.at(each.parameters()).build()
            seconds += compile_kernels(scene, True, lambda line: say(line, error=True), counts)
        done = f"compiled in {format_duration(seconds)}" if seconds else "compiled before"
        say(f"{path}: {done}")
    files = [path.stat().st_size for path in cache_folder().rglob("*") if path.is_file()]
    say(f"{sum(files) / 2**20:.1f} MiB of kernels in {cache_folder()}")
    return 0
