import pytest

from agglom_mpi.doctor import machine as nodes


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Return a function that installs a program that prints a line; how to find it alone."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(nodes, "local_networks", lambda: ["br-1f", "docker0"])

    def install(name, line):
        path = tmp_path / name
        path.write_text(f"#!/bin/sh\necho '{line}'\n")
        path.chmod(0o755)
        return {"PATH": str(tmp_path)}

    install("mpirun", "something else")
    return install


def found(environment):
    return {finding.topic: finding for finding in nodes.check_nodes(environment)}


def test_open_mpi_is_kept_from_networks_within_the_machine(installed):
    assert "networks" not in found(installed("mpirun", "HYDRA build details:"))
    environment = installed("mpirun", "mpirun (Open MPI) 4.1.4")
    finding = found(environment)["networks"]
    assert finding.found == "br-1f, docker0 in this machine alone"
    assert "OMPI_MCA_btl_tcp_if_include" in finding.advice
    chosen = environment | {"OMPI_MCA_btl_tcp_if_include": "eth0"}
    assert "networks" not in found(chosen)


def test_slurm_is_asked_when_it_gives_a_node_up(installed):
    environment = installed("scontrol", "SlurmdTimeout           = 300 sec")
    assert "300 sec" in found(environment)["lost node"].found


def test_an_unknown_launcher_and_no_slurm_say_nothing(installed):
    assert found(installed("mpirun", "something else")) == {}


def test_networks_within_a_machine_are_known_by_their_names(tmp_path):
    for name in ("lo", "eth0", "docker0", "br-0a1b", "bond0", "ib0", "virbr0"):
        (tmp_path / name).mkdir()
    assert nodes.local_networks(tmp_path) == ["br-0a1b", "docker0", "virbr0"]
    assert nodes.local_networks(tmp_path / "none") == []
