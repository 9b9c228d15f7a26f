"""The shape of the package: few arguments, small files, no import circles, kernels and private names by themselves,
and documents that name what is there."""

import ast
import inspect
import re
import tokenize
from collections import Counter
from graphlib import TopologicalSorter
from importlib.util import resolve_name
from pathlib import Path

import numpy as np
from importlinter import cli

import plenoptic as pl

ROOT = Path(pl.__file__).parent
FILES = sorted(ROOT.rglob("*.py"))
TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in FILES}
MOST_ARGUMENTS, MOST_FILES, MOST_LINES, MOST_IN_CIRCLE = 8, 16, 400, 12


def module_of(path):
    parts = path.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for path in FILES}


def public_names():
    """(module, name) of the functions and classes that users are offered, in the package or its public modules."""
    for name in pl.__all__:
        found = getattr(pl, name)
        offered = (
            [getattr(found, part) for part in getattr(found, "__all__", ())] if inspect.ismodule(found) else [found]
        )
        yield from ((part.__module__, part.__name__) for part in offered if inspect.isclass(part) or callable(part))


def functions(tree):
    """Functions with the class that they are a method of, or themselves."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            yield node, node.name
        elif isinstance(node, ast.ClassDef):
            yield from ((part, node.name) for part in ast.walk(node) if isinstance(part, ast.FunctionDef))


def test_more_than_eight_arguments_are_options_of_public_functions():
    public = set(public_names())
    allowed, many = set(), set()
    for path, tree in TREES.items():
        module = module_of(path)
        for node, owner in functions(tree):
            positional = {a.arg for a in [*node.args.posonlyargs, *node.args.args]} - {"self", "cls"}
            if len(positional) + len(node.args.kwonlyargs) > MOST_ARGUMENTS:
                many.add(f"{module}.{node.name} {node.lineno}")
                if len(positional) <= MOST_ARGUMENTS and (module, owner) in public:
                    allowed.add(f"{module}.{node.name} {node.lineno}")
    found = {name.partition(" ")[0] for name in many - allowed}
    assert found == set()


def test_folders_and_files_are_small():
    folders = Counter(path.parent for path in FILES)
    assert {str(folder.relative_to(ROOT.parent)): n for folder, n in folders.items() if n > MOST_FILES} == {}
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in FILES}
    assert {module_of(path) for path, n in lines.items() if n > MOST_LINES} == set()


def imports(node, later=False):
    """(module of the package, node, whether inside a function) of all imports but those for type checkers."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ImportFrom) and child.module and child.module.startswith("plenoptic"):
            for whole in (f"{child.module}.{alias.name}" for alias in child.names):
                yield (whole if whole in MODULES else child.module), child, later
        elif isinstance(child, ast.Import):
            yield from ((alias.name, child, later) for alias in child.names if alias.name in MODULES)
        elif isinstance(child, ast.If) and isinstance(child.test, ast.Name) and child.test.id == "TYPE_CHECKING":
            yield from imports(ast.Module(child.orelse, []), later)
        elif isinstance(child, ast.stmt | ast.excepthandler | ast.match_case):
            yield from imports(child, later or isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef))


def commented_lines(path):
    """Lines that end in a comment, other than one for a tool: why the import cannot stand at the top."""
    with tokenize.open(path) as file:
        tokens = list(tokenize.generate_tokens(file.readline))
    return {
        token.start[0]
        for token in tokens
        if token.type == tokenize.COMMENT and not token.string.startswith(("# noqa", "# type:"))
    }


def test_no_import_circles_but_inside_functions_that_say_why():
    edges = {module: set() for module in MODULES}
    for path, tree in TREES.items():
        found = list(imports(tree))
        justified = commented_lines(path) if any(later for *_, later in found) else set()
        for name, node, later in found:
            if name != module_of(path) and not (later and node.lineno in justified):
                edges[module_of(path)].add(name)
    assert sum(map(len, edges.values())) > len(MODULES)
    TopologicalSorter(edges).prepare()  # names a circle


def facade_names(module):
    """Modules that define the names of a package whose names are loaded on first use; empty for other modules."""
    stub = MODULES[module].with_suffix(".pyi")
    for node in ast.parse(stub.read_text(encoding="utf-8")).body if stub.is_file() else ():
        if isinstance(node, ast.ImportFrom):
            base = resolve_name("." * node.level + (node.module or ""), module)
            for alias in node.names:
                whole = f"{base}.{alias.name}"
                yield alias.name, whole if whole in MODULES else base


def circle_sizes(edges):
    """For each module, how many import it and are imported by it, through whichever others, itself among them."""
    names = list(edges)
    reached = np.array([[other == name or other in edges[name] for other in names] for name in names])
    for _ in range(len(names).bit_length()):  # each step doubles the length of the chains
        reached = reached.astype(np.float32) @ reached > 0
    return dict(zip(names, np.count_nonzero(reached & reached.T, axis=1), strict=True))


def test_circles_through_imports_inside_functions_are_small():
    """Names of packages that are loaded on first use count as imports of the modules that define them."""
    facades = {module: dict(facade_names(module)) for module in MODULES}
    edges = {module: set(facades[module].values()) for module in MODULES}
    for path, tree in TREES.items():
        for name, node, _ in imports(tree):
            named = {alias.name for alias in node.names} if isinstance(node, ast.ImportFrom) else None
            if facades[name] and named is not None:
                edges[module_of(path)].update(facades[name][part] for part in named & set(facades[name]))
            else:
                edges[module_of(path)].add(name)
    assert {name: size for name, size in circle_sizes(edges).items() if size > MOST_IN_CIRCLE} == {}


def test_figures_are_named_by_no_other_room():
    others = [path for path in FILES if path.relative_to(ROOT).parts[0] not in ("plots", "command")]
    assert [path for path in others for name, *_ in imports(TREES[path]) if name.startswith("plenoptic.plots")] == []


def test_imports_point_down(capsys):
    settings = Path(__file__).parents[1] / "setup.cfg"
    assert cli.lint_imports(config_filename=str(settings), no_cache=True) == 0, capsys.readouterr().out


def test_kernels_stand_in_folders_of_their_own():
    for path, tree in TREES.items():
        uses = {
            alias.name
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.module == "plenoptic.core.numba.jit"
            for alias in node.names
        }
        assert path.parent.name == "kernels" or not uses & {"kernel", "device"}, path


def test_private_names_stay_in_their_module():
    found = {
        f"{module_of(path)} < {node.module}.{alias.name}"
        for path, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("plenoptic")
        for alias in node.names
        if alias.name.startswith("_") and not alias.name.startswith("__")
    }
    assert found == set()


def test_ci_reads_all_files_with_a_marker():
    """It names their folders, since reading all tests takes half a minute."""
    tests = Path(__file__).parent
    script = (tests.parent / ".ci" / "run").read_text(encoding="utf-8")
    texts = {path: path.read_text(encoding="utf-8") for path in tests.rglob("test_*.py")}
    for marker in ("benchmark", "browser", "validation"):
        marked = {path.relative_to(tests).parts[0] for path, text in texts.items() if f"mark.{marker}" in text}
        (folders,) = re.findall(rf"pytest -m {marker} -n 0((?: tests/\w+)+)", script)
        assert {f"tests/{name}" for name in marked} == set(folders.split())


def test_what_the_validation_page_names_exists():
    tests = Path(__file__).parent
    page = (tests.parent / "docs" / "validation.md").read_text(encoding="utf-8")
    files = set(re.findall(r"`((?:\w+/)*test_\w+\.py)", page))
    assert len(files) > 20 and [name for name in sorted(files) if not (tests / name).is_file()] == []
    defined = set(
        re.findall(r"def (test_\w+)", "\n".join(path.read_text("utf-8") for path in tests.rglob("test_*.py")))
    )
    assert set(re.findall(r"\b(test_\w+)\b(?!\.py)", page)) <= defined


def test_files_that_the_table_of_questions_names_exist():
    page = (Path(__file__).parents[1] / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = page.partition("| question | file |")[2].partition("## ")[0]
    named = re.findall(r"`(\w+/[\w/]+\.py)`", table)
    assert len(named) >= 6 and [name for name in named if not (ROOT / name).is_file()] == []
