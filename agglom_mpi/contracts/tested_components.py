"""Test the components of one's own that a campaign names, in its scene and over its box."""

import math
import os
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final

from agglom_mpi.compilation.kernels import runs_compiled
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.contracts.cases import PropertyFinding, component_label
from agglom_mpi.contracts.grains import SIZE_PROPERTIES, sizes_failures
from agglom_mpi.contracts.searches import (
    OBJECTIVE_PROPERTIES,
    RULE_PROPERTIES,
    SEARCH_PROPERTIES,
    objective_failures,
    rule_failures,
    search_failures,
)
from agglom_mpi.contracts.subject import CASES_SEED, Case, Subject
from agglom_mpi.contracts.tested_laws import law_findings, properties_of
from agglom_mpi.declaration.components import Component
from agglom_mpi.declaration.laws import Law
from agglom_mpi.declaration.users_code import users_code
from agglom_mpi.errors import BAD_INPUT, UserError
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.simulation.own_laws import compiled_formulas

MAX_TEST_SECONDS: Final = 300.0
"""Maximum processor time of the tests of a component, s; some seconds are usual."""


class BrokenComponentError(UserError, ValueError):
    """A component of one's own lacks properties of its kind, one line each."""


def tested_components(campaign: Campaign, components: Iterable[Component]) -> list[PropertyFinding]:
    """Test those of a campaign's components that are of one's own.

    Raises
    ------
    BrokenComponentError
        If one fails; with a line on each property that it lacks.
    UncompiledLawError
        If a formula of one cannot be compiled.
    """
    findings = list[PropertyFinding]()
    for own in [each for each in components if each.own]:
        with _ended_if_endless(component_label(type(own))):
            findings += _of(campaign, own)
    if failed := [str(each) for each in findings if each.fails]:
        raise BrokenComponentError("\n".join(failed))
    return findings


@contextmanager
def _ended_if_endless(label: str) -> Iterator[None]:
    """End the process if tests of a component take too long, and at once on Ctrl-C.

    Compiled code looks for neither.
    """
    tested, begin = threading.Event(), time.process_time()

    def watch() -> None:
        while not tested.wait(0.1):
            if time.process_time() - begin > MAX_TEST_SECONDS:
                limit = f"{MAX_TEST_SECONDS:g} s of processor time"
                print(f"{label}: a formula or method does not end: {limit}", file=sys.stderr)
                os._exit(BAD_INPUT)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler = signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        tested.set()
        signal.signal(signal.SIGINT, handler)


def _of(campaign: Campaign, component: Component) -> list[PropertyFinding]:
    if isinstance(component, Law):
        return _of_law(campaign, component)
    sizes, plan = campaign.at(campaign.parameters()).section.sizes, campaign.plan
    if component is sizes and sizes is not None:
        return _listed(component, SIZE_PROPERTIES, sizes_failures(sizes, CASES_SEED))
    if plan is not None and component is plan.search:
        failures = search_failures(plan.search, campaign.space(), campaign.seed)
        return _listed(component, SEARCH_PROPERTIES, failures)
    if plan is not None and component is plan.ensemble:
        return _listed(component, RULE_PROPERTIES, rule_failures(plan.ensemble, CASES_SEED))
    failures = objective_failures(campaign.objective, CASES_SEED)
    return _listed(component, OBJECTIVE_PROPERTIES, failures)


def _listed(
    component: Component, known: Sequence[str], failures: Iterator[tuple[str, str]]
) -> list[PropertyFinding]:
    """Return a finding for each property, the first failure of each, in the order of testing."""
    kind, texts = type(component), dict[str, str]()
    unknown = _unknown_breaks(kind, known)
    try:
        with users_code(component_label(kind)):
            for name, text in failures:
                texts.setdefault(name, text)
    except Exception as error:  # a component of the user's may raise any
        return [*unknown, PropertyFinding(kind, "raises", f"{type(error).__name__}: {error}")]
    return [*unknown, *(PropertyFinding(kind, name, texts.get(name, "")) for name in known)]


def _of_law(campaign: Campaign, law: Law) -> list[PropertyFinding]:
    """Return the findings on a law of one's own: in the campaign's scene, over its box."""
    section = campaign.at(campaign.parameters()).section
    laws = {each.key: each.law for each in section.laws()}
    key = next(key for key, each in laws.items() if each is law)
    laws[key.partition(".")[0]] = law  # a law within another is tested by itself
    space = SearchSpace.of(campaign.variables)
    ends = zip(space.lower.tolist(), space.upper.tolist(), strict=True)
    named = zip(campaign.variables.names, ends, strict=True)
    ranges = {name: limits for name, limits in named if not math.isnan(limits[0])}
    prefix = f"{key}."
    own = {k.removeprefix(prefix): each for k, each in ranges.items() if k.startswith(prefix)}
    subject = Subject(law, laws, ranges, own)
    known = [name for name, _ in properties_of(subject)]
    if runs_compiled():
        case = Case(subject, 0)
        subject = subject.but(compiled=compiled_formulas(case.built, case.laws))
    return [*_unknown_breaks(type(law), known), *law_findings(subject)]


def _unknown_breaks(kind: type[Component], known: Iterable[str]) -> list[PropertyFinding]:
    """Return the names in `breaks` of a class that are no properties of its kind."""
    allowed = f"no property of its kind; allowed: {', '.join(sorted({*known}))}"
    unknown = [name for name in kind.breaks if name not in {*known}]
    return [PropertyFinding(kind, "breaks", f"{name!r} is {allowed}") for name in unknown]


def lines_on(findings: Iterable[PropertyFinding]) -> list[str]:
    """Return a line on each component that was tested, with the names of what holds."""
    held: dict[type[Component], list[str]] = {}
    for each in findings:
        names = held.setdefault(each.component, [])
        if not each.fault:
            names.append(each.name)
    return [f"{component_label(kind)} satisfies {', '.join(names)}" for kind, names in held.items()]
