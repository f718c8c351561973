"""The commit of a checkout, read as git stores it, and what a leg records."""

import pytest

from agglom_mpi.runtime.provenance import git_revision, leg_start, versions

COMMIT = "0123456789abcdef0123456789abcdef01234567"


@pytest.fixture
def checkout(tmp_path):
    git = tmp_path / ".git"
    (git / "refs" / "heads" / "deep").mkdir(parents=True)
    (git / "HEAD").write_text("ref: refs/heads/deep/main\n")
    return tmp_path


def test_a_branch_is_followed_to_its_commit(checkout):
    (checkout / ".git/refs/heads/deep/main").write_text(COMMIT + "\n")
    assert git_revision(checkout) == COMMIT


def test_a_packed_branch_is_found(checkout):
    (checkout / ".git/packed-refs").write_text(
        f"# pack-refs with: peeled\n{'f' * 40} refs/heads/deep/mainly\n{COMMIT} "
        f"refs/heads/deep/main\n^{'e' * 40}\n"
    )
    assert git_revision(checkout) == COMMIT


def test_a_detached_head_is_its_own_commit(checkout):
    (checkout / ".git/HEAD").write_text(COMMIT + "\n")
    assert git_revision(checkout) == COMMIT


def test_a_second_working_tree_is_followed_to_the_repository(checkout, tmp_path):
    (checkout / ".git/refs/heads/deep/side").write_text(COMMIT + "\n")
    own = checkout / ".git/worktrees/second"
    own.mkdir(parents=True)
    (own / "HEAD").write_text("ref: refs/heads/deep/side\n")
    (own / "commondir").write_text("../..\n")
    second = tmp_path / "second"
    second.mkdir()
    (second / ".git").write_text(f"gitdir: {own}\n")
    assert git_revision(second) == COMMIT


@pytest.mark.parametrize("head", ["", "ref: refs/heads/none", "nonsense", "\xff"])
def test_what_cannot_be_resolved_is_empty(checkout, head):
    (checkout / ".git/HEAD").write_text(head, encoding="latin-1")
    assert git_revision(checkout) == ""


def test_what_is_no_checkout_has_no_revision(tmp_path):
    assert git_revision(tmp_path) == ""


def test_a_leg_records_the_revision_of_these_sources():
    assert leg_start(1, "")["git_revision"] == git_revision()


def test_a_leg_records_what_it_ran_with():
    start = leg_start(3, "MPICH 4.3")
    assert start["ranks"] == 3
    assert start["mpi"] == "MPICH 4.3"
    assert all(versions()[name] for name in ("python", "numpy", "numba", "h5py", "hdf5"))
