"""The modules, files and functions that the READMEs name exist."""

import ast
import importlib.util
import re
from pathlib import Path

import pytest

from agglom_mpi.variables import TEN

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "agglom_mpi"
DOCUMENTS = [
    ROOT / "README.md",
    ROOT / "jobs" / "REFERENCE.md",
    *(ROOT / "agglom_mpi").rglob("*.md"),
    *(p for folder in ("jobs", "slurm") for p in (ROOT / folder).rglob("README.md")),
]
EXAMPLES = {
    "CAMPAIGN.yaml",
    "FILE.py",
    "sticking.py",
    "NAME.md.j2",
    "module.py",
    "report.html",
    "report.md",
}
"""Names that stand for a user's file, or for one that a command writes."""
FILE = re.compile(
    r"(?<![\w./*-])((?:[\w.-]+/)*[\w.-]+\.(?:py|md|yaml|j2|sbatch|toml|png|html))(?!\w)"
)
DOTTED = re.compile(r"((?:[a-z_]+\.)+[A-Za-z_]\w*)(?:\(.*\))?")


def spans(document):
    """Code within the lines of a document, without blocks."""
    text = re.sub(r"```.*?```", "", document.read_text(), flags=re.DOTALL)
    return re.findall(r"`([^`\n]+)`", text)


def places(document):
    """Folders that a document's paths may begin in."""
    return document.parent, ROOT, PACKAGE


def module_at(document, words):
    """Return the module or package that dotted words name, from the nearest place; None if none."""
    for folder in places(document):
        path = folder.joinpath(*words)
        if path.with_suffix(".py").is_file():
            return path.with_suffix(".py")
        if (path / "__init__.py").is_file():
            return path
    return None


def defined(module):
    """Names at the top of a module and of its classes."""
    names = set()
    for node in ast.walk(ast.parse(module.read_text())):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.alias):
            names.add(node.asname or node.name)
    return names


def is_importable(module, name):
    loaded = importlib.import_module(module)
    if hasattr(loaded, "__path__") and importlib.util.find_spec(f"{module}.{name}"):
        return True
    return hasattr(loaded, name)


def is_there(document, name):
    if any((folder / name).exists() for folder in places(document)):
        return True
    return "/" not in name and any((ROOT / "tests").rglob(name))


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_files_that_a_readme_names_exist(document):
    named = {name for span in spans(document) for name in FILE.findall(span)}
    written = {name for name in named if Path(name).name in EXAMPLES}
    assert [name for name in sorted(named - written) if not is_there(document, name)] == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_functions_that_a_readme_names_by_their_module_are_defined_there(document):
    missing = []
    for match in filter(None, map(DOTTED.fullmatch, spans(document))):
        *words, last = match[1].split(".")
        if FILE.fullmatch(match[1]) or last in (*TEN.names, "csv"):
            continue  # a file, or a key of a campaign
        beside = module_at(document, words)
        modules = [beside] if beside else sorted(PACKAGE.rglob("/".join(words) + ".py"))
        known = [defined(m / "__init__.py" if m.is_dir() else m) for m in modules]
        if words == ["campaign"]:  # what users have
            known.append(defined(PACKAGE / "campaign_runs.py"))
        is_module = module_at(document, [*words, last]) is not None
        if modules and not is_module and not any(last in names for names in known):
            missing.append(match[1])
    assert missing == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_tables_of_modules_name_modules(document):
    headings, missing = [], []
    for line in document.read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")] if line[:1] == "|" else []
        headings = (headings or cells) if cells else []
        for heading, cell in zip(headings, cells, strict=False):
            if heading in ("module", "file"):
                names = [
                    name.removesuffix(".py").strip("/") for name in re.findall(r"`(.+?)`", cell)
                ]
                missing += [n for n in names if module_at(document, n.split("/")) is None]
    assert missing == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_what_a_readme_imports_from_the_package_is_there(document):
    found = re.findall(r"from (agglom_mpi[\w.]*) import ([\w, ]+)", document.read_text())
    for module, names in found:
        for name in map(str.strip, names.split(",")):
            assert is_importable(module, name), f"from {module} import {name}"


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_how_long_compilation_takes_stands_in_one_place(document):
    """It depends on the machine: the root's README has the figure, and others link to it."""
    text = " ".join(document.read_text().split())
    figures = re.findall(r"compil[a-z]*[^.;|]* \d+ s\b|\d+ s of compil", text)
    assert bool(figures) == (document == ROOT / "README.md"), figures
