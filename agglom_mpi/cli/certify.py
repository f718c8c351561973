"""`agglom certify`: prove by fresh runs how much of a feasible set is right."""

from typing import Any

import click

from agglom_mpi.cli.common import (
    ALLOW_CODE,
    DATABASE,
    MAX_WALLTIME,
    QUIET,
    accept_code_change,
    examples,
    exit_with,
    read_assignments,
    run_connected,
)


@click.command(
    epilog=examples(
        "mpirun -n 2 agglom certify doubling_in_three.h5 --claim 0.9 --confidence 0.95",
        "agglom certify doubling_in_three.h5 --robust relative_speed=5%",
    )
)
@click.argument("file")
@click.option(
    "--claim",
    default="0.9",
    show_default=True,
    metavar="SHARE",
    help="Share of the part, with --robust of its pairs, that is to be right.",
)
@click.option(
    "--confidence", default="0.95", show_default=True, metavar="SHARE", help="Confidence of it."
)
@click.option(
    "--tolerance",
    default="5%",
    show_default=True,
    metavar="SHARE",
    help="Tolerance of the set, as of agglom report --feasible-set.",
)
@click.option(
    "--robust",
    multiple=True,
    callback=read_assignments,
    metavar="NAME=SHARE",
    help="Claim pairs of a string and a deviation: each string is judged once, with this variable "
    "off by a drawn even share of itself, at most this one, and not beyond the box "
    "(relative_speed=5%); may be repeated.",
)
@click.option(
    "--strings",
    default=100,
    show_default=True,
    type=click.IntRange(1, 10**5),
    help="Number of strings to draw.",
)
@click.option(
    "--max-samples",
    default=2560,
    show_default=True,
    type=click.IntRange(40, 10**6),
    help="Maximum number of samples of a string; one that they do not decide counts as wrong.",
)
@click.option(
    "--seed",
    default=1,
    show_default=True,
    type=click.IntRange(0),
    help="Seed of the strings and of their samples.",
)
@MAX_WALLTIME
@QUIET
@DATABASE
@accept_code_change("a certificate")
@ALLOW_CODE
def certify(**options: Any) -> None:
    """Prove by fresh runs how much of the feasible set of FILE.h5 is right.

    The command chooses the largest part of the set, by the probability P of its strings, for which
    the claim is expected to hold. It draws strings evenly from that part, and simulates each until
    its mean is decided to be within the tolerance or not. It then states which share of the part is
    right at least, also if that is less than was claimed. Errors of all decisions are included.
    With --robust the share is that of pairs of a string and a deviation; which share of the strings
    is right for at least 80 % of their deviations follows, and is stated, too.

    The strings and their samples are written to FILE.certificate.h5. Where that lies beside
    FILE.h5, the set of reports, JSON and Python shows it. A set is tested once: another claim needs
    the file to be moved away.

    Started by mpirun, the command uses all ranks. A certificate that was stopped or killed is
    continued by the same command.

    Exit codes: 0 finished, whatever the verdict; 2 bad input; 75 stopped early; 1 any other
    failure.
    """

    def run(world: Any) -> int:
        from agglom_mpi.runtime.certify import CertifyOptions, certify

        return certify(CertifyOptions(**options), world)

    exit_with(run_connected)(run=run)
