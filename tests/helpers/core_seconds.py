"""A pytest plugin: the processor time that the tests of each file and folder take.

Seconds of a clock say little on a busy machine. Processor time of a test is that of the process
that runs it, with all its threads, and of the processes that it started and waited for. The parts:

- `processes`: programs and ranks that tests start;
- `compiling`: Numba's compilation in the process of the tests;
- `fitting`: emulators, sets and posteriors there, which are all that limit the linear algebra;
- `campaigns`: runs of campaigns there (`campaign_runs.invert`);
- `fixtures`: the rest of the set-up and the teardown of tests;
- `tests`: the rest of tests;
- `importing`: from the start of a process until the tests are collected, once a process.

`--core-seconds TABLE` writes a table of all files. `--budgets TIER` shows what each folder took,
compares it with the budgets of that tier in `tests/budget.toml`, if it has any, and fails the run
if a folder takes more than twice its budget, or compiles a kind of scene that is not listed.
"""

import re
import resource
import threading
import tomllib
from collections import Counter, defaultdict
from contextlib import contextmanager
from pathlib import Path

import pytest
from numba.core import event
from numba.core.dispatcher import Dispatcher

INNER = ("compiling", "fitting", "campaigns")
"""Parts that name themselves. Where one runs inside another, the first named counts."""
PARTS = ("processes", *INNER, "fixtures", "tests", "importing")
TOLERANCE = 2.0
"""Machines differ and are noisy; no folder may take more than so many times its budget."""
_BUDGETS = Path(__file__).parents[1] / "budget.toml"


def _used(who):
    usage = resource.getrusage(who)
    return usage.ru_utime + usage.ru_stime


class Account:
    """Processor seconds of this process since the last `settle`, by part."""

    def __init__(self):
        self._lock = threading.RLock()
        self._active = Counter()
        self._seconds = Counter()
        self._own = self._children = 0.0

    def _note(self, outer):
        """Book what was used since the last note on the innermost active part."""
        own, children = _used(resource.RUSAGE_SELF), _used(resource.RUSAGE_CHILDREN)
        part = next((name for name in INNER if self._active[name]), outer)
        self._seconds[part] += own - self._own
        self._seconds["processes"] += children - self._children
        self._own, self._children = own, children

    def begin(self, part):
        """Book on a part from now on."""
        with self._lock:
            self._note("rest")
            self._active[part] += 1

    def end(self, part):
        """Stop what `begin` has begun."""
        with self._lock:
            self._note("rest")
            self._active[part] -= 1

    def settle(self, rest):
        """Return the seconds of each part since the last call; what is in none is `rest`."""
        with self._lock:
            self._note("rest")
            seconds, self._seconds = self._seconds, Counter()
        seconds[rest] += seconds.pop("rest", 0.0)
        return {part: spent for part, spent in seconds.items() if spent}


ACCOUNT = Account()


@contextmanager
def spent_on(part):
    """Book a block on a part."""
    ACCOUNT.begin(part)
    try:
        yield
    finally:
        ACCOUNT.end(part)


class _Compiling(event.Listener):
    def on_start(self, event):
        ACCOUNT.begin("compiling")

    def on_end(self, event):
        ACCOUNT.end("compiling")


class _Fitting:
    """The lock of `blas_threads`, which every fit holds, and whose time is booked."""

    def __init__(self, lock):
        self._lock = lock

    def __enter__(self):
        self._lock.acquire()
        ACCOUNT.begin("fitting")

    def __exit__(self, *_):
        ACCOUNT.end("fitting")
        self._lock.release()


def kind_of(types):
    """Return the laws of a scene that a kernel is compiled for or loaded for; "" without a scene.

    Text like "Periodic UniformX PressureRestitution … EventDriven", and "sizes" if they differ.
    """
    scene = str(types[0]) if types else ""
    if not scene.startswith("Scene("):
        return ""
    laws = [name for name in re.findall(r"([A-Za-z]\w*)\(", scene) if name not in _NO_LAWS]
    return " ".join([*laws, *([] if scene.endswith(", none)") else ["sizes"])])


_NO_LAWS = ("Scene", "ImpactLaws", "UniTuple", "Tuple")


class Measurement:
    """In a process that runs tests: adds what each phase of a test took to its report."""

    def __init__(self):
        self._kinds = set()

    def pytest_collection_finish(self):
        from agglom_mpi.emulation import blas_threads

        compile_kernel = Dispatcher.compile

        def noted(dispatcher, signature):
            if isinstance(signature, tuple) and (kind := kind_of(signature)):
                self._kinds.add(kind)
            return compile_kernel(dispatcher, signature)

        Dispatcher.compile = noted
        event.register("numba:compile", _Compiling())
        blas_threads.BLAS_LIMIT_LOCK = _Fitting(blas_threads.BLAS_LIMIT_LOCK)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtestloop(self, session):
        spent = ACCOUNT.settle("importing")
        session.config.core_seconds = spent
        if hasattr(session.config, "workeroutput"):
            session.config.workeroutput["core_seconds"] = spent
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, call):
        report = yield
        report.core_seconds = ACCOUNT.settle("tests" if call.when == "call" else "fixtures")
        report.scenes, self._kinds = sorted(self._kinds), set()
        return report


class Bookkeeping:
    """In the process that reports: sums the seconds by file, shows them and compares them."""

    def __init__(self, table, tier):
        self._table, self._tier = table, tier
        self.files, self._scenes = defaultdict(Counter), set()

    def pytest_runtest_logreport(self, report):
        self._scenes.update(getattr(report, "scenes", ()))  # a crashed worker has none
        self.files[report.nodeid.partition("::")[0]].update(getattr(report, "core_seconds", {}))

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node):
        self.files["importing"].update(getattr(node, "workeroutput", {}).get("core_seconds", {}))

    def folders(self):
        """Return the core-seconds of each folder, the largest first."""
        spent = Counter()
        for name, parts in self.files.items():
            spent[folder_of(name)] += sum(parts.values())
        return dict(spent.most_common())

    def pytest_sessionfinish(self, session):
        self.files["importing"].update(getattr(session.config, "core_seconds", {}))
        if self._table:
            Path(self._table).write_text(table_of(self.files))
        if self._tier and session.exitstatus == pytest.ExitCode.OK and self._faults():
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def _faults(self):
        """Return a line for each folder above its budget and each scene that is not listed."""
        listed = budgets("compiled").get(self._tier)
        unlisted = [] if listed is None else sorted(self._scenes - set(listed))
        return [
            *excesses(self.folders(), budgets(self._tier)),
            *(f"a kind of scene that tests/budget.toml does not list: {kind}" for kind in unlisted),
        ]

    def pytest_terminal_summary(self, terminalreporter):
        if not self._tier:
            return
        allowed, spent = budgets(self._tier), self.folders()
        terminalreporter.section(f"core-seconds of folders, and their budgets: {self._tier}")
        for folder, seconds in spent.items():
            terminalreporter.line(f"{seconds:8.1f} {allowed.get(folder, 0):6} {folder}")
        terminalreporter.line(f"{sum(spent.values()):8.1f} {sum(allowed.values()):6} in all")
        terminalreporter.line(f"{len(self._scenes)} kinds of scene compiled or loaded:")
        for kind in sorted(self._scenes):
            terminalreporter.line(f"  {kind}")
        for line in self._faults():
            terminalreporter.line(f"ERROR {line}", red=True)


def budgets(tier):
    """Return the core-seconds that each folder may take in a tier, or another table."""
    return tomllib.loads(_BUDGETS.read_text()).get(tier, {})


def folder_of(name):
    """Return the folder of `tests` in which a file is; "tests" for a file of none."""
    parts = Path(name).parts
    return parts[1] if len(parts) > 2 else parts[0]


def excesses(spent, allowed):
    """Return a line for each folder that took more than `TOLERANCE` times its budget."""
    return [
        f"{folder}: {seconds:.0f} core-seconds, more than {TOLERANCE:g} times {allowed[folder]}"
        if folder in allowed
        else f"{folder}: no budget in tests/budget.toml"
        for folder, seconds in spent.items()
        if allowed and seconds > TOLERANCE * allowed.get(folder, 0)
    ]


def table_of(files):
    """Return a text with a line for each file, the largest first, and one for their sum."""
    total = Counter()
    for parts in files.values():
        total.update(parts)
    rows = sorted(files.items(), key=lambda row: -sum(row[1].values()))
    lines = ["".join(f"{word:>10}" for word in ("sum", *PARTS)) + "  file"]
    for name, parts in [*rows, ("in all", total)]:
        numbers = [sum(parts.values()), *(parts[part] for part in PARTS)]
        lines.append("".join(f"{number:10.2f}" for number in numbers) + f"  {name}")
    return "\n".join(lines) + "\n"
