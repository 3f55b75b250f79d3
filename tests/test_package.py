"""The package polices itself: what it imports, how it is documented, how it is layered."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import switchctl
import switchctl.certificates
import switchctl.methods
import switchctl.moments
import switchctl.plotting
import switchctl.stability

PACKAGE = Path(switchctl.__file__).parent
# From left to right, as data flows; a module may import those before it.
ORDER = [
    "moments gramians tables files mat_reader switches",
    "validation",
    "mode_checks",
    "gaussian modes rules",
    "predicted",
    "limits",
    "memory",
    "contradiction",
    "graph",
    "values",
    "continuation tail_costs plain",
    "optimum",
    "sampling inactive estimation",
    "controllers",
    "feedback",
    "closed_loop methods",
    "result result_text",
    "scheduling blocks",
    "stability",
    "certificates",
    "comparison sweeping trade_offs",
    "simulation",
    "plotting",
    "load_model",
    "cli",
]


def public():
    modules = [switchctl, switchctl.methods, switchctl.plotting, switchctl.stability, switchctl.certificates]
    named = {getattr(module, name) for module in modules for name in module.__all__}
    for module in (switchctl.moments, switchctl.gramians):
        named |= {
            f
            for f in vars(module).values()
            if inspect.isfunction(f) and f.__module__ == module.__name__ and f.__name__[0] != "_"
        }
    return sorted((thing for thing in named if callable(thing)), key=lambda thing: thing.__qualname__)


def documented(thing):
    """A public callable and, of a class, its public methods."""
    yield thing.__qualname__, thing
    if inspect.isclass(thing):
        for name, member in vars(thing).items():
            function = member.__func__ if isinstance(member, classmethod) else member
            if inspect.isfunction(function) and not name.startswith("_"):
                yield f"{thing.__qualname__}.{name}", function


EVERYTHING = dict(item for thing in public() for item in documented(thing))


@pytest.mark.parametrize("name", EVERYTHING)
def test_every_parameter_is_documented(name):
    thing = EVERYTHING[name]
    text = inspect.getdoc(thing)
    assert text, name
    try:
        parameters = [
            p for p in inspect.signature(thing).parameters.values() if p.name not in ("self", "cls", "keywords", "args")
        ]
    except ValueError:
        return
    if inspect.isclass(thing) and issubclass(thing, (Exception, tuple)):
        return
    for parameter in parameters:
        assert parameter.name in text, f"{name}: {parameter.name} is not documented"
    if inspect.isfunction(thing) and inspect.signature(thing).return_annotation not in (None, inspect.Parameter.empty):
        inherited = any(name.split(".")[-1] == m for m in ("start", "decide"))
        assert "Returns" in text or len(parameters) == 0 or inherited, f"{name}: what it returns is not documented"


@pytest.mark.parametrize("name", [n for n, t in EVERYTHING.items() if inspect.isfunction(t) and "plot" not in n])
def test_an_unknown_keyword_is_refused(name):
    assert all(p.kind != p.VAR_KEYWORD for p in inspect.signature(EVERYTHING[name]).parameters.values())


def test_what_stands_left_never_imports_what_stands_right():
    place = {name: rank for rank, names in enumerate(ORDER) for name in names.split()}
    for path in PACKAGE.rglob("*.py"):
        module = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if module == "__init__":
            continue
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("switchctl."):
                imported = node.module.split(".")[1]
                assert imported == module or place[imported] <= place[module], f"{path.name} imports {imported}"


def test_the_kernel_knows_only_numpy():
    for name in ("moments", "gramians"):
        imported = {
            (node.module if isinstance(node, ast.ImportFrom) else node.names[0].name).split(".")[0]
            for node in ast.walk(ast.parse((PACKAGE / f"{name}.py").read_text()))
            if isinstance(node, ast.Import | ast.ImportFrom)
        }
        assert imported <= {"numpy", "switchctl", "functools", "collections", "typing"}


def test_importing_the_package_imports_no_pictures_no_pandas_and_changes_nothing():
    code = """
import sys, warnings, control, numpy, matplotlib
warnings.simplefilter("error")
before, errors = dict(matplotlib.rcParams), numpy.geterr()
import switchctl
assert not [m for m in sys.modules if m.split(".")[0] in ("pandas", "clarabel") or m.startswith("switchctl.plotting")]
assert dict(matplotlib.rcParams) == before and numpy.geterr() == errors
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_models_are_installed_as_part_of_the_package(tmp_path):
    code = "import switchctl.models.quadrotor as q; assert q.__name__ == 'switchctl.models.quadrotor'"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)


def test_everything_public_is_exported():
    for name in switchctl.__all__:
        assert getattr(switchctl, name) is not None
    assert switchctl.__all__ == sorted(switchctl.__all__)
