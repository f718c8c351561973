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
from agglom_mpi.config.plan import CertificatePlan
from agglom_mpi.declaration.declared import meaning_of


def plan_options(command: Any) -> Any:
    """Add an option for each key of the section `certify`."""
    for name, field in reversed([*CertificatePlan.model_fields.items()]):
        settings: dict[str, Any] = {"type": int}
        if name == "robust":
            settings = {"multiple": True, "callback": read_assignments, "metavar": "NAME=SHARE"}
        elif field.annotation is float:
            settings = {"metavar": "SHARE"}
        default = "may be repeated" if name == "robust" else f"default: {field.default}"
        meaning = f"{meaning_of(CertificatePlan, name).replace('`', '')}  [{default}]"
        command = click.option(f"--{name.replace('_', '-')}", help=meaning, **settings)(command)
    return command


@click.command(
    epilog=examples(
        "mpirun -n 2 agglom certify doubling_in_three.h5 --claim 0.9 --confidence 0.95",
        "agglom certify doubling_in_three.h5 --robust relative_speed=5%",
    )
)
@click.argument("file")
@plan_options
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

    Where the campaign has a section certify, it has the defaults of these options, and
    agglom-invert makes the certificate itself.

    Started by mpirun, the command uses all ranks. A certificate that was stopped or killed is
    continued by the same command.

    Exit codes: 0 finished, whatever the verdict; 2 bad input; 75 stopped early; 1 any other
    failure.
    """
    plan = {name: options.pop(name) for name in CertificatePlan.model_fields}
    given = {name: value for name, value in plan.items() if value not in (None, {})}

    def run(world: Any) -> int:
        from agglom_mpi.runtime.certify import CertifyOptions, certify

        return certify(CertifyOptions(plan=given, **options), world)

    exit_with(run_connected)(run=run)
