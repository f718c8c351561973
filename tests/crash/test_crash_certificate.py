"""A certificate that is killed in the middle: the same command ends it with the same verdicts."""

import os
import signal
import sys
from pathlib import Path

import pytest
from campaign_runs import environment, need_mpirun, samples_in, wait_until
from held_runs import allow, allow_all, held
from processes import descendants, end_group, output_of, program, start_group, wait_until_gone
from set_runs import three_variable_text

from agglom_mpi.inference.certificate import certificate_of, certificate_path
from agglom_mpi.storage.reader import read_campaign

BIN = Path(sys.executable).parent
CERTIFY = ["agglom", "certify", "three.h5", "--tolerance", "10%", "--strings", "31"]
CERTIFY += ["--max-samples", "160"]
INVERT = ["agglom-invert", "three.yaml"]
SECTION = "{tolerance: 10%, strings: 31, max_samples: 160}"
"""The same in a campaign."""


def command(ranks, words=CERTIFY):
    words = [str(BIN / words[0]), *words[1:]]
    return words if ranks == 1 else ["mpirun", "-n", str(ranks), *words]


def finish(folder, ranks, words=CERTIFY):
    with program(command(ranks, words), cwd=folder, env=environment()) as process:
        _, errors = output_of(process)
    assert process.returncode == 0, errors


def copy(three, folder):
    folder.mkdir()
    path = folder / "three.h5"
    path.write_bytes(three.path.read_bytes())
    return path


def found(path):
    """Return the verdict of a certificate and its results, string by string."""
    certificate = certificate_of(read_campaign(path))
    return certificate._replace(path=""), read_campaign(certificate.path).rows("results").tolist()


@pytest.mark.ranks(guard="runtime/test_certify.py")
@pytest.mark.parametrize("words", [CERTIFY, INVERT], ids=["command", "campaign"])
def test_a_killed_certificate_goes_on_to_the_same_verdicts(three, tmp_path, words):
    need_mpirun()
    whole, killed = copy(three, tmp_path / "whole"), copy(three, tmp_path / "killed")
    finish(whole.parent, 1)
    folder = killed.parent
    (folder / "three.yaml").write_text(three_variable_text(final="none", certify=SECTION))
    allow(folder, 600)
    env = environment(held(folder, 0.001))
    process = start_group(command(2, words), cwd=folder, env=env)
    try:
        wait_until(lambda: samples_in(certificate_path(killed)) >= 300, process)
        living = [each.pid for each in descendants(process)]
        os.kill(living[-1], signal.SIGKILL)
        output_of(process)
    finally:
        end_group(process)
    wait_until_gone(living)
    kept = samples_in(certificate_path(killed))
    assert not certificate_of(read_campaign(killed)).finished
    allow_all(folder)
    finish(folder, 2, words)
    assert found(killed) == found(whole)
    assert read_campaign(certificate_path(killed)).damaged == 0
    assert samples_in(certificate_path(killed)) > kept >= 300
