"""The messages in the package's README are those that the sources have."""

import ast
import re
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "agglom_mpi"


def texts(path):
    """Texts of a module, with … in place of what is formatted into them."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.JoinedStr):
            parts = (p.value if isinstance(p, ast.Constant) else "…" for p in node.values)
            yield "".join(map(str, parts))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def test_every_message_in_the_readme_is_one_of_the_sources():
    readme = (PACKAGE / "config" / "README.md").read_text()
    said = readme.partition("## What is said")[2].partition("## To add")[0]
    messages = re.findall(r"^\|.*\| `(.+)` \|$", said, re.MULTILINE)
    assert len(messages) > 50
    modules = [
        *(PACKAGE / "config").glob("*.py"),
        *(PACKAGE / "analysis" / f"{name}_warnings.py" for name in ("result", "run")),
    ]
    known = {text.strip() for m in modules for text in texts(m)}
    known |= {text.strip() for text in texts(PACKAGE / "runtime" / "file_setup.py")}
    assert [message for message in messages if message not in known] == []
