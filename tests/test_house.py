"""The structure promised in ARCHITECTURE.md, held against the tree."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from importlinter.cli import lint_imports

from tests.house.references import stale_references

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("lmctl", "firmware_protocol", "simulators")
MODULES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def test_the_import_contracts_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    assert lint_imports(no_cache=True) == 0


def test_the_bench_is_imported_by_one_module_only() -> None:
    importers = {
        path.relative_to(ROOT).as_posix()
        for path in MODULES
        if path.is_relative_to(ROOT / "lmctl") and "simulators" in _imported_packages(path)
    }
    assert importers == {"lmctl/cli/bench.py"}


def test_help_imports_no_array_code() -> None:
    heavy = {"numpy", "numba", "scipy", "matplotlib", "pydantic", "asyncio", "pymodbus", "rich"}
    program = (
        "import sys; from lmctl.cli.__main__ import main; code = main(['--help']);"
        f"print(sorted(set(sys.modules) & {heavy!r}), file=sys.stderr); sys.exit(code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stderr.strip() == "[]"


def test_planning_a_small_part_loads_little(tmp_path: Path) -> None:
    """These take as long to load as such a part takes to plan."""
    heavy = {"scipy.ndimage", "scipy.spatial", "scipy.special", "scipy.linalg", "scipy.sparse",
             "scipy.optimize", "matplotlib", "rich", "asyncio", "multiprocessing", "distributed"}
    (tmp_path / "cube.toml").write_text(
        'name = "cube"\n[[material]]\nname = "316L"\n[[body]]\nkind = "box"\n'
        "low_mm = [0, 0, 0]\nhigh_mm = [10, 10, 1.6]\n", encoding="utf-8")
    program = (
        "import sys; from lmctl.cli.__main__ import main; code = main(['plan', 'cube.toml']);"
        f"print('loaded', sorted(set(sys.modules) & {heavy!r})); sys.exit(code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert done.stdout.splitlines()[-1] == "loaded []"


@pytest.mark.parametrize("package", PACKAGES)
def test_every_module_says_what_it_is_for(package: str) -> None:
    silent = [
        path.relative_to(ROOT).as_posix()
        for path in MODULES
        if path.is_relative_to(ROOT / package)
        and not ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert silent == []


def test_no_class_name_stands_twice() -> None:
    """One word for one thing: a class that has a namesake needs a qualifier."""
    homes: dict[str, list[str]] = {}
    for path in MODULES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, []).append(path.relative_to(ROOT).as_posix())
    assert {name: where for name, where in homes.items() if len(where) > 1} == {}


def test_every_package_shows_its_public_face() -> None:
    """`__all__` names what others may use, and each of those names is there."""
    wrong = []
    for path in MODULES:
        if path.name != "__init__.py":
            continue
        name = ".".join(path.parent.relative_to(ROOT).parts)
        package = import_module(name)
        if not hasattr(package, "__all__"):
            wrong.append(f"{name} has no __all__")
        wrong += [f"{name}.{one}" for one in getattr(package, "__all__", ())
                  if not hasattr(package, one)]
    assert wrong == []


@pytest.mark.parametrize(
    "package",
    ["lmctl.part", "lmctl.plan", "lmctl.job", "lmctl.run", "lmctl.report", "firmware_protocol",
     "simulators"],
)
def test_importing_a_package_loads_none_of_its_modules(package: str) -> None:
    program = (
        f"import sys, {package}; "
        f"print([m for m in sys.modules if m.startswith({package + '.'!r})])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout.strip() == "[]"


def test_the_first_line_of_a_docstring_says_alone_what_the_module_is() -> None:
    """Package listings show that line only, so it is a sentence of its own."""
    unfinished = []
    for path in MODULES:
        doc = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        first, _, rest = doc.partition("\n")
        if not first.endswith((".", ":", "?")) or (rest and rest[:1] != "\n"):
            unfinished.append(f"{path.relative_to(ROOT).as_posix()}: {first}")
    assert unfinished == []


def test_no_file_is_cited_that_the_tree_does_not_hold() -> None:
    cited = re.compile(r"(?<![\w/.-])((?:[\w-]+/)*[\w-]+\.md)\b")
    names = {path.name for path in ROOT.rglob("*.md") if ".venv" not in path.parts}
    missing = []
    for path in [*MODULES, *(ROOT / "docs").rglob("*.md"), ROOT / "README.md",
                 ROOT / "ARCHITECTURE.md"]:
        for name in cited.findall(path.read_text(encoding="utf-8")):
            there = (ROOT / name).exists() or (path.parent / name).exists()
            there = there or name.startswith("doc/markdown/")  # Grbl's own documents
            if not there and ("/" in name or name not in names):
                missing.append(f"{path.relative_to(ROOT).as_posix()}: {name}")
    assert missing == []


def test_documents_name_what_is_there() -> None:
    """Pages of keys are made from the models, and their paths are keys, not modules."""
    documents = [ROOT / "ARCHITECTURE.md", ROOT / "README.md",
                 *(path for path in (ROOT / "docs").rglob("*.md")
                   if not path.name.endswith("-keys.md"))]
    assert stale_references(ROOT, documents) == []


def test_asynchronous_code_uses_the_loops_clock_only() -> None:
    """time.time() and its like would not move with virtual time (ARCHITECTURE.md, time)."""
    watched = ("lmctl/run", "lmctl/machine", "simulators")
    offenders = []
    for path in MODULES:
        name = path.relative_to(ROOT).as_posix()
        if name.startswith(watched) and "time" in _imported_packages(path):
            calls = {
                node.attr
                for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
                if isinstance(node, ast.Attribute)
                and isinstance(node.value, ast.Name) and node.value.id == "time"
            }
            if calls & {"time", "sleep", "monotonic", "perf_counter"}:
                offenders.append((name, sorted(calls)))
    # The run's wall time is for the person who waits; the virtual clock itself may pace to it.
    allowed = {"lmctl/run/executor.py", "simulators/virtual_time.py"}
    assert [entry for entry in offenders if entry[0] not in allowed] == []


def _imported_packages(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found.add(node.module.split(".")[0])
    return found
