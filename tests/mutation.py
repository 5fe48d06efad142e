"""Mutation testing of the guard and the modes: does a test notice each small change?

    python -m tests.mutation [EVERY]

Changes one thing at a time (a comparison, an `and`, a number, a sign, a `not`, a returned value),
runs the tests of the module in a forked process, and lists what nobody noticed. With EVERY = 10
only each tenth change is tried. Not collected by pytest.
"""

import ast
import os
import signal
import sys
from collections.abc import Iterator
from importlib.machinery import ModuleSpec
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
TARGETS = {
    "followerd.control.guard": ("tests/test_guard.py", "tests/test_pipeline.py"),
    "followerd.control.transitions": ("tests/test_mode.py",),
    "followerd.control.mode": ("tests/test_mode.py", "tests/test_pipeline.py"),
}
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
    """What was changed, and the module with it."""
    tree = ast.parse(source)
    for parent, name, index in places(tree):
        holder = getattr(parent, name)
        node = holder if index is None else holder[index]
        for change in changes(node):
            ast.copy_location(change, node)
            _put(parent, name, index, change)
            line = getattr(node, "lineno", 0)
            yield (
                f"{line}: {ast.unparse(node)}  ->  {ast.unparse(change)}",
                ast.unparse(ast.fix_missing_locations(tree)),
            )
            _put(parent, name, index, node)


def _put(parent: ast.AST, name: str, index: int | None, node: ast.AST) -> None:
    if index is None:
        setattr(parent, name, node)
    else:
        getattr(parent, name)[index] = node


def is_noticed(module: str, source: str, tests: tuple[str, ...]) -> bool:
    """Whether a test fails when `module` is `source`; in a process of its own."""
    child = os.fork()
    if child == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(1, 2)
        os._exit(_run(module, source, tests))
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) != 0


def _run(name: str, source: str, tests: tuple[str, ...]) -> int:
    signal.alarm(LONGEST)
    path = ROOT / (name.replace(".", "/") + ".py")
    spec = spec_from_file_location(name, path)
    assert isinstance(spec, ModuleSpec)
    module = module_from_spec(spec)
    sys.modules[name] = module
    exec(compile(source, str(path), "exec"), vars(module))
    own = ["-x", "-q", "-n0", "-p", "no:randomly", "-p", "no:cacheprovider", "-m", "not slow"]
    return int(pytest.main([*own, *(str(ROOT / test) for test in tests)]))


def main(every: int) -> int:
    """Print what survived and the share that did not."""
    tried = survived = 0
    for name, tests in TARGETS.items():
        source = (ROOT / (name.replace(".", "/") + ".py")).read_text()
        if is_noticed(name, source, tests):
            sys.stdout.write(f"{name}: the tests fail without any change\n")
            return 1
        for number, (what, changed) in enumerate(mutants(source)):
            if number % every:
                continue
            tried += 1
            if not is_noticed(name, changed, tests):
                survived += 1
                sys.stdout.write(f"{name.rpartition('.')[2]}:{what}\n")
                sys.stdout.flush()
    sys.stdout.write(f"{tried - survived} of {tried} changes noticed\n")
    return 0 if survived <= 0.05 * tried else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 1))
