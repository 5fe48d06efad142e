"""Mutation testing of the guard and the modes: does a test notice each small change?

    python -m tests.mutation [EVERY]

Changes one thing at a time (a comparison, an `and`, a number, a sign, a `not`, a mode, a returned
value) and runs the module's own tests, then the pipeline's, until one fails; what nobody noticed
is listed. The tests are collected once: each change is made in a forked copy of this process, in
the code of the functions that are already imported. With EVERY = 10 only each tenth change is
tried. Not collected by pytest.
"""

import ast
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import pytest
from rich.progress import track

ROOT = Path(__file__).parent.parent
TARGETS = {
    "followerd.control.guard": (
        "tests/test_guard.py",
        "tests/test_guard_bounds.py",
        "tests/test_pipeline.py",
    ),
    "followerd.control.transitions": ("tests/test_mode.py", "tests/test_mode_bounds.py"),
    "followerd.control.mode": (
        "tests/test_mode.py",
        "tests/test_mode_bounds.py",
        "tests/test_pipeline.py",
    ),
}
EQUIVALENT = ROOT / "tests" / "equivalent_mutants.txt"  # a line each: change, then why
COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
LONGEST = 60  # s, for the tests of one change: an endless loop is noticed too
TELLING = 240  # characters of a line that is shown whole
BEFORE = 0  # exit code of a child whose tests all pass


def changes(node: ast.AST) -> Iterator[ast.AST]:
    """The node as it could be wrong."""
    match node:
        case ast.Compare(left, [operator], right):
            for other in COMPARISONS[type(operator)]:
                yield ast.Compare(left, [other()], right)
        case ast.BoolOp(operator, values):
            yield ast.BoolOp(ast.Or() if isinstance(operator, ast.And) else ast.And(), values)
        case ast.UnaryOp(ast.Not() | ast.USub(), operand):
            yield operand
        case ast.BinOp(left, operator, right) if type(operator) in ARITHMETIC:
            yield ast.BinOp(left, ARITHMETIC[type(operator)](), right)
        case ast.Constant(bool() as value):
            yield ast.Constant(not value)
        case ast.Constant(int() | float() as value):
            yield ast.Constant(value + 1)
        case ast.Attribute(ast.Name("Mode"), name):
            mode = "FOLLOWING" if name == "DISARMED" else "DISARMED"
            yield ast.Attribute(ast.Name("Mode", ast.Load()), mode, ast.Load())
        case ast.Return(ast.expr()):
            yield ast.Return(ast.Constant(None))


def is_told(node: ast.AST) -> bool:
    """Texts for people and the settings' own bounds are not the logic."""
    return isinstance(node, ast.JoinedStr) or (
        isinstance(node, ast.ClassDef) and node.name.endswith("Settings")
    )


def places(tree: ast.AST) -> Iterator[tuple[ast.AST, str, int | None]]:
    """Each node's parent, and the field (and index) that holds it."""
    for name, value in ast.iter_fields(tree):
        if name in ("annotation", "returns"):
            continue
        for index, child in enumerate(value if isinstance(value, list) else [value]):
            if isinstance(child, ast.AST) and not is_told(child):
                yield tree, name, index if isinstance(value, list) else None
                yield from places(child)


def mutants(source: str) -> Iterator[tuple[str, str]]:
    """What was changed, named by its function, and the module with it."""
    tree = ast.parse(source)
    for parent, name, index in places(tree):
        holder = getattr(parent, name)
        node = holder if index is None else holder[index]
        for change in changes(node):
            ast.copy_location(change, node)
            before = ast.unparse(tree)
            _put(parent, name, index, change)
            after = ast.unparse(ast.fix_missing_locations(tree))
            _put(parent, name, index, node)
            if after != before:
                yield _difference(before, after, getattr(node, "lineno", 0)), after


def _difference(before: str, after: str, line: int) -> str:
    old, new = next(
        (a, b) for a, b in zip(before.splitlines(), after.splitlines(), strict=True) if a != b
    )
    old, new = old.strip(), new.strip()
    if len(old) > TELLING:  # a table
        same = next(k for k in range(len(old)) if old[k] != new[k : k + 1])
        start = max(0, same - TELLING // 4)
        old, new = old[start : start + TELLING // 2], new[start : start + TELLING // 2]
    return f"{line}: {old}  ->  {new}"


def _put(parent: ast.AST, name: str, index: int | None, node: ast.AST) -> None:
    if index is None:
        setattr(parent, name, node)
    else:
        getattr(parent, name)[index] = node


def put_in(module: ModuleType, source: str) -> None:
    """Make the imported `module` behave as `source`: its functions' code, its tables, its defaults.

    Its classes and enumerations stay the same objects, which tests hold.
    """
    fresh = ModuleType(module.__name__)
    fresh.__file__ = module.__file__
    sys.modules[module.__name__] = fresh
    exec(compile(source, str(module.__file__), "exec"), vars(fresh))
    sys.modules[module.__name__] = module
    _take_over(vars(module), vars(fresh), module.__name__)
    tables = {name: value for name, value in vars(fresh).items() if name.isupper()}
    for name in tables:
        old = getattr(module, name)
        new = eval(_assigned(source, name), vars(module))
        vars(module)[name] = new
        for other in list(sys.modules.values()):  # who has imported it by name
            if vars(other).get(name) is old:
                setattr(other, name, new)


def _assigned(source: str, name: str) -> str:
    """The expression that a module gives to `name`."""
    for node in ast.parse(source).body:
        match node:
            case ast.Assign([ast.Name(found)], value) if found == name:
                return ast.unparse(value)
            case ast.AnnAssign(ast.Name(found), _, ast.expr() as value) if found == name:
                return ast.unparse(value)
    return name  # it was imported


def _take_over(old: Any, new: Any, module: str) -> None:
    """Code of functions from one namespace to another, into classes too."""
    for name, was in list(old.items()):
        now = new.get(name)
        if isinstance(was, property) and isinstance(now, property):
            was, now = was.fget, now.fget
        if isinstance(was, FunctionType) and isinstance(now, FunctionType):
            if was.__module__ == module and isinstance(now.__code__, CodeType):
                was.__code__, was.__defaults__ = now.__code__, now.__defaults__
                was.__kwdefaults__ = now.__kwdefaults__
        elif isinstance(was, type) and was.__module__ == module and isinstance(now, type):
            _take_over(vars(was), vars(now), module)


class Mutation:
    """A pytest plugin: instead of running the tests once, once for each change."""

    def __init__(self, module: str, every: int) -> None:
        self.module, self.every = module, every
        self.tried = 0
        self.survived: list[str] = []

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Every change in turn; the unchanged module first."""
        source = (ROOT / (self.module.replace(".", "/") + ".py")).read_text()
        if is_noticed(self.module, source, session):
            raise pytest.UsageError(f"the tests of {self.module} fail without any change")
        tried = list(mutants(source))[:: self.every]
        self.tried = len(tried)
        for what, changed in track(tried, self.module.rpartition(".")[2]):
            if not is_noticed(self.module, changed, session):
                self.survived.append(f"{self.module.rpartition('.')[2]}:{what}")
        return True


def is_noticed(module: str, source: str, session: pytest.Session) -> bool:
    """Whether a test fails when `module` is `source`; in a process of its own."""
    child = os.fork()
    if child == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(1, 2)
        signal.alarm(LONGEST)
        try:
            put_in(sys.modules[module], source)
            code = _run(session)
        except BaseException:
            code = 1
        os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) != BEFORE


def _run(session: pytest.Session) -> int:
    """All tests until one fails."""
    items = session.items
    for item, following in zip(items, [*items[1:], None], strict=True):
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        if session.testsfailed:
            return 1
    return BEFORE


def main(every: int) -> int:
    """Print what survived, what is named in vain, and the share that was noticed."""
    known = {line.partition("  #")[0] for line in EQUIVALENT.read_text().splitlines()}
    tried, survived, equivalent = 0, 0, 0
    unseen: set[str] = set()
    for module, tests in TARGETS.items():
        plugin = Mutation(module, every)
        own: Sequence[str] = (
            "-o", "addopts=", "-m", "not slow",
            "-p", "no:randomly", "-p", "no:cacheprovider", "-p", "no:terminal",
        )  # fmt: skip
        pytest.main([*own, *(str(ROOT / test) for test in tests)], [plugin])
        for what in plugin.survived:
            named = what.partition(":")[0] + ":" + what.partition(": ")[2]
            unseen.add(named)
            equivalent += named in known
            survived += named not in known
            if named not in known:
                sys.stdout.write(what + "\n")
        tried += plugin.tried
    for named in sorted(known - unseen) if every == 1 else ():
        sys.stdout.write(f"named in {EQUIVALENT.name}, but noticed or gone: {named}\n")
    sys.stdout.write(
        f"{tried - survived - equivalent} of {tried} changes noticed; {equivalent} change nothing, "
        f"as {EQUIVALENT.name} says why\n"
    )
    return 0 if tried and survived <= 0.05 * (tried - equivalent) else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 1))
