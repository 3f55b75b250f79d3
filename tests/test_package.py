"""The package polices itself: what it imports, how it is documented, how it is layered."""

import ast
import inspect
import re
import subprocess
import sys
import textwrap
from importlib import import_module
from pathlib import Path

import pytest

import switchctl
import switchctl.certificates
import switchctl.gramians
import switchctl.methods
import switchctl.models
import switchctl.moments
import switchctl.plotting
import switchctl.simulation
import switchctl.stability

PACKAGE = Path(switchctl.__file__).parent
# From left to right, as data flows; a module may import those before it.
ORDER = [
    "storage moments schur gramians tables files mat_reader switches edges",
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
    "result_checks result result_text",
    "scheduling blocks",
    "stability",
    "certificates",
    "comparison sweeping trade_offs",
    "simulation",
    "plotting",
    "load_model",
    "cli",
]


MODULES = [
    switchctl,
    switchctl.methods,
    switchctl.simulation,
    switchctl.plotting,
    switchctl.stability,
    switchctl.certificates,
]
KERNEL = [switchctl.moments, switchctl.gramians]
MODELS = [import_module(f"switchctl.models.{name}") for name in switchctl.models.NAMES]


def public():
    """Every public callable."""
    named = {getattr(module, name) for module in MODULES for name in module.__all__}
    for module in (*KERNEL, *MODELS):
        mine = (f for f in vars(module).values() if inspect.isfunction(f) and f.__module__ == module.__name__)
        named |= {f for f in mine if not f.__name__.startswith("_")}
    return sorted(named, key=lambda thing: (thing.__module__, thing.__qualname__))


def with_methods(thing):
    """A public callable and, of a class, its public methods."""
    yield f"{thing.__module__}.{thing.__qualname__}", thing
    if inspect.isclass(thing):
        for name, member in vars(thing).items():
            function = member.__func__ if isinstance(member, classmethod | staticmethod) else member
            if inspect.isfunction(function) and not name.startswith("_"):
                yield f"{thing.__module__}.{thing.__qualname__}.{name}", function


EVERYTHING = dict(item for thing in public() for item in with_methods(thing))
CALLABLE = {n: t for n, t in EVERYTHING.items() if not (inspect.isclass(t) and issubclass(t, Exception))}
each = pytest.mark.parametrize("name", CALLABLE)


def sections(thing):
    """A docstring in the sections of numpydoc."""
    parts = re.split(r"^([A-Z][A-Za-z ]+)\n-{3,}\n", inspect.getdoc(thing) or "", flags=re.MULTILINE)
    return {"": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


def told(section):
    """The names of a section with their types."""
    lines = [line.partition(" : ") for line in section.split("\n") if line and not line[0].isspace()]
    return {name.strip().lstrip("*"): kind for names, _, kind in lines for name in names.split(",")}


def parameters(thing):
    return {name: p for name, p in inspect.signature(thing).parameters.items() if name not in ("self", "cls")}


@each
def test_every_parameter_is_documented_with_its_type_and_no_other(name):
    thing = CALLABLE[name]
    documented = sections(thing)
    assert documented[""].strip()
    described = told(documented.get("Parameters", ""))
    assert described.keys() == parameters(thing).keys()
    assert all(described.values()), described


@each
def test_what_is_returned_and_raised_is_documented(name):
    thing = CALLABLE[name]
    documented = sections(thing)
    if inspect.isclass(thing):
        makers = [vars(thing)[maker] for maker in ("__init__", "__post_init__") if maker in vars(thing)]
    else:
        makers = [thing]
        nothing = inspect.signature(thing).return_annotation in (None, "None", inspect.Parameter.empty)
        if not nothing and not (thing.__module__.startswith("switchctl.models") and not parameters(thing)):
            assert documented.keys() & {"Returns", "Yields"}  # a model's functions say it in their summary
    assert "Raises" in documented or not any(map(raises, makers))


def raises(function):
    """Whether a function itself raises something."""
    if not function.__code__.co_filename.startswith(str(PACKAGE.parent)):
        return False  # generated
    nodes = list(ast.parse(textwrap.dedent(inspect.getsource(function))).body[0].body)
    while nodes:
        node = nodes.pop()
        if isinstance(node, ast.Raise) and node.exc is not None:
            return True
        if not isinstance(node, ast.FunctionDef | ast.Lambda | ast.ClassDef):
            nodes += ast.iter_child_nodes(node)
    return False


ANSWERS = "the function that makes it has the example"
NO_EXAMPLE = {
    "ClosedLoops": "`close_loops` has it",
    "ContradictionError": "an exception",
    "FormatError": "an exception",
    "Method": "abstract: CONTRIBUTING.md writes one, in code that is run",
    "Scheduler": "abstract: CONTRIBUTING.md writes one, in code that is run",
    "Comparison": ANSWERS,
    "CostParts": ANSWERS,
    "Edge": ANSWERS,
    "MonteCarlo": ANSWERS,
    "Run": ANSWERS,
    "Rung": ANSWERS,
    "Sweep": ANSWERS,
    "Switch": ANSWERS,
    "TradeOff": ANSWERS,
    "AverageDwellTime": ANSWERS,
    "DwellTime": ANSWERS,
    "DwellTimes": ANSWERS,
    "Fall": ANSWERS,
    "JointSpectralRadius": ANSWERS,
    "Move": ANSWERS,
    "PairGrowth": ANSWERS,
    "Stationary": ANSWERS,
    "SwitchingHelp": ANSWERS,
    "TransientGrowth": ANSWERS,
}


def test_everything_has_an_example_or_a_reason():
    library = [thing for thing in public() if not thing.__module__.startswith("switchctl.models")]
    without = {thing.__name__ for thing in library if ">>>" not in inspect.getdoc(thing)}
    assert without == NO_EXAMPLE.keys()


@each
def test_an_unknown_keyword_is_refused(name):
    thing = CALLABLE[name]
    if inspect.isabstract(thing):
        thing = type(thing.__name__, (thing,), dict.fromkeys(thing.__abstractmethods__))
    needed = {}
    if any(p.kind == p.VAR_KEYWORD for p in inspect.signature(thing).parameters.values()):  # passed on
        needed = {n: None for n, p in inspect.signature(thing).parameters.items() if p.default is p.empty}
        del needed["keywords"]
    with pytest.raises(TypeError, match=r"no_such_keyword|Method\(\) takes no arguments"):
        thing(**needed, no_such_keyword=1)


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
    for name in ("moments", "schur", "gramians"):
        imported = {
            (node.module if isinstance(node, ast.ImportFrom) else node.names[0].name).split(".")[0]
            for node in ast.walk(ast.parse((PACKAGE / f"{name}.py").read_text()))
            if isinstance(node, ast.Import | ast.ImportFrom)
        }
        assert imported <= {"numpy", "switchctl", "functools", "collections", "itertools", "typing"}


def test_importing_the_package_adds_little_to_python_control_and_changes_nothing():
    code = """
import sys, warnings, control, matplotlib, numpy, os
warnings.simplefilter("error")
def state():
    looks = dict(matplotlib.rcParams), dict(control.config.defaults)
    return *looks, numpy.geterr(), list(warnings.filters), dict(os.environ)
before, loaded = state(), set(sys.modules)
import switchctl
assert state() == before
added = {name for name in set(sys.modules) - loaded}
print(*sorted({name.split(".")[0] for name in added} - set(sys.stdlib_module_names)))
print(*sorted(name for name in added if name.startswith(("tqdm", "switchctl.plotting"))))
"""
    told = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    packages, modules = (line.split() for line in told.split("\n")[:2])
    assert packages == ["switchctl", "tqdm"]
    assert not any(name.startswith(("switchctl.plotting", "tqdm.notebook")) for name in modules)


@pytest.mark.slow
def test_using_the_package_changes_nothing_outside_it():
    subprocess.run([sys.executable, Path(__file__).parent / "tour.py"], check=True, capture_output=True)


def test_modules_are_documented_and_short_and_do_not_print():
    checker = PACKAGE / "certificates" / "check.py"  # a program of one file, to be read and run alone
    for path in (path for folder in (PACKAGE, Path(switchctl.models.__file__).parent) for path in folder.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text)
        assert ast.get_docstring(tree), f"{path.name} says nothing of itself"
        assert path == checker or text.count("\n") <= 400, f"{path.name} is too long"
        if path not in (checker, PACKAGE / "cli.py", PACKAGE / "mat_reader.py"):
            names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
            assert not names & {"print", "input", "breakpoint"}, f"{path.name} talks"


# By the headings of docs/reference.md; what is in no other place is in the parts before "Pictures".
PLACES = {
    "Pictures": set(switchctl.plotting.__all__),
    "Guarantees": set(switchctl.stability.__all__),
    "Certificates": set(switchctl.certificates.__all__),
    "Models": set(switchctl.models.NAMES),
    "Runs beyond the modes": set(switchctl.simulation.__all__),
    "Methods": {n for n in switchctl.__all__ if getattr(switchctl, n).__module__.startswith("switchctl.methods")},
}


def test_the_reference_has_everything_where_it_belongs_with_its_summary():
    text = (PACKAGE.parent / "docs" / "reference.md").read_text(encoding="utf-8")
    _, *parts = re.split(r"^## ", text, flags=re.MULTILINE)
    rows = {
        part.split("\n")[0].split(" (")[0]: dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", part, re.M)) for part in parts
    }
    for heading, names in PLACES.items():
        assert rows[heading].keys() == names, heading
    assert {n for part in rows.values() for n in part} == set(switchctl.__all__).union(*PLACES.values())
    for summaries in rows.values():
        for name, summary in summaries.items():
            holder = next(m for m in (switchctl.models, *MODULES) if hasattr(m, name))
            assert inspect.getdoc(getattr(holder, name)).split("\n")[0].replace("|", "\\|") == summary
    apart = set(switchctl.methods.__all__) - set(switchctl.__all__)  # for methods of one's own
    assert all(f"`{n}`" in text or n in (PACKAGE.parent / "CONTRIBUTING.md").read_text(encoding="utf-8") for n in apart)


def test_models_are_installed_as_part_of_the_package(tmp_path):
    code = "import switchctl.models.quadrotor as q; assert q.__name__ == 'switchctl.models.quadrotor'"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)


def test_everything_public_is_exported():
    for name in switchctl.__all__:
        assert getattr(switchctl, name) is not None
    assert switchctl.__all__ == sorted(switchctl.__all__)
