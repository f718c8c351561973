"""Which revision of the sources runs, where they are a checkout of a git repository."""

import re
from pathlib import Path

_SOURCES = Path(__file__).parents[2]


def git_revision(folder: Path = _SOURCES) -> str:
    """Commit that is checked out in a folder; empty if the folder is no checkout.

    Read from the repository's files: a process that speaks MPI had better not start another.
    Edits since are not seen; the digest of the sources, stored beside, shows them.
    """
    try:
        found = _resolve(folder / ".git")
    except (OSError, UnicodeDecodeError):
        return ""
    return found if re.fullmatch(r"[0-9a-f]{40}|[0-9a-f]{64}", found) else ""


def _resolve(git: Path) -> str:
    if git.is_file():  # of a second working tree
        git = git.parent / git.read_text().removeprefix("gitdir:").strip()
    head = (git / "HEAD").read_text().strip()
    if not head.startswith("ref:"):
        return head
    name = head.removeprefix("ref:").strip()
    common = git / "commondir"
    shared = git / common.read_text().strip() if common.is_file() else git
    if (shared / name).is_file():
        return (shared / name).read_text().strip()
    packed = (line.partition(" ") for line in (shared / "packed-refs").read_text().splitlines())
    return next((commit for commit, _, reference in packed if reference == name), "")
