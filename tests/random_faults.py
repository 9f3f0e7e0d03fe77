"""One-line faults drawn at random from the packages, and how many of them the tests notice.

    python -m tests.random_faults 100          # with the seed 29, half a minute each
    python -m tests.random_faults 40 --seed 7

Drawn are operators, comparisons, numbers, truth values and dropped statements inside functions,
each as likely as any other in the code. The default tests run once under coverage; a fault is then
put into a copy of the tree, where the tests that pass its line run, quickest first, until one
fails. Each fault that is not caught is shown, to be judged: a hole in the tests, or equivalent.
"""

import argparse
import ast
import random
import re
import subprocess
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from coverage import CoverageData

from tests.faults import ROOT, copy_tree, run_pytest

PACKAGES = ("identification", "tune", "datasets_synthetic")
_LONGEST = 240  # s, of the tests of one fault
_OPERATORS: dict[type[ast.AST], tuple[str, str]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.Is: ("is", "is not"),
    ast.IsNot: ("is not", "is"),
    ast.And: ("and", "or"),
    ast.Or: ("or", "and"),
}
_DROPPED = (ast.Assign, ast.AugAssign, ast.Expr, ast.Raise, ast.Continue)


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """Columns of one line and what takes their place."""

    file: str
    line: int
    start: int
    stop: int
    new: str

    def apply(self, text: str) -> str:
        """The file's text with the fault in it."""
        lines = text.splitlines(keepends=True)
        raw = lines[self.line - 1].encode()
        lines[self.line - 1] = (raw[: self.start] + self.new.encode() + raw[self.stop :]).decode()
        return "".join(lines)


def sites(file: str, text: str) -> Iterator[Change]:
    """Every one-line fault of a file."""
    lines = [line.encode() for line in text.splitlines()]

    def between(left: ast.expr, right: ast.expr, operator: ast.AST) -> Iterator[Change]:
        old, new = _OPERATORS.get(type(operator), ("", ""))
        if not old or left.end_lineno != right.lineno or left.end_col_offset is None:
            return
        row = lines[right.lineno - 1]
        place = row.find(old.encode(), left.end_col_offset, right.col_offset)
        if place >= 0:
            yield change(right.lineno, place, place + len(old), new)

    def change(line: int, start: int, stop: int, new: str) -> Change:
        return Change(file=file, line=line, start=start, stop=stop, new=new)

    def whole(node: ast.stmt | ast.expr, new: str) -> Iterator[Change]:
        if node.lineno == node.end_lineno and node.end_col_offset is not None:
            yield change(node.lineno, node.col_offset, node.end_col_offset, new)

    for node in _inside_functions(ast.parse(text)):
        if isinstance(node, ast.BinOp):
            yield from between(node.left, node.right, node.op)
        elif isinstance(node, ast.Compare):
            for left, right, operator in zip(
                (node.left, *node.comparators), node.comparators, node.ops, strict=False
            ):
                yield from between(left, right, operator)
        elif isinstance(node, ast.BoolOp):
            for left, right in zip(node.values, node.values[1:], strict=False):
                yield from between(left, right, node.op)
        elif isinstance(node, ast.Constant):
            if isinstance(node.value, bool):
                yield from whole(node, str(not node.value))
            elif isinstance(node.value, int | float):
                yield from whole(node, repr(node.value * 2 + (node.value == 0)))
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            yield change(node.lineno, node.col_offset, node.col_offset + 4, "")
        elif isinstance(node, _DROPPED):
            text_of_it = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            yield from () if text_of_it else whole(node, "pass")


def _inside_functions(tree: ast.Module) -> Iterator[ast.AST]:
    """What functions do, without their annotations and without functions within them twice."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef):
            yield from (part for each in node.body for part in _walk(each))
        else:
            waiting.extend(ast.iter_child_nodes(node))


def _walk(node: ast.AST) -> Iterator[ast.AST]:
    yield node
    for name, value in ast.iter_fields(node):
        if name in {"annotation", "returns", "decorator_list"}:
            continue
        for each in value if isinstance(value, list) else [value]:
            # What zip is told to be strict about never happens.
            if isinstance(each, ast.keyword) and each.arg == "strict":
                continue
            if isinstance(each, ast.AST):
                yield from _walk(each)


def draw(count: int, seed: int, root: Path) -> list[Change]:
    """Faults of the packages under a folder."""
    found = [
        each
        for package in PACKAGES
        for path in sorted((root / package).rglob("*.py"))
        if "templates" not in path.parts
        for each in sites(path.relative_to(root).as_posix(), path.read_text(encoding="utf-8"))
    ]
    return random.Random(seed).sample(found, count)  # noqa: S311


def measure(folder: Path) -> Callable[[str, int], list[str]]:
    """What finds the tests that pass a line of the packages, the quickest first.

    Those that pass its file where the line is passed in fixtures and threads only.
    """
    timed = folder / "times.xml"
    done = run_pytest(
        folder, "--cov", "--cov-context=test", "--cov-report=", f"--junitxml={timed}", longest=7200
    )
    if done.returncode:
        raise SystemExit(f"tests fail without any fault:\n{done.stdout[-2000:]}")
    seconds: dict[str, float] = defaultdict(float)
    for case in ElementTree.parse(timed).iter("testcase"):  # noqa: S314 - our own
        name = re.sub(r"\[.*", "", case.get("name", ""), flags=re.DOTALL)
        seconds[f"{case.get('classname', '').replace('.', '/')}.py::{name}"] += float(
            case.get("time", 0)
        )
    data = CoverageData(str(folder / ".coverage"))
    data.read()
    passing: dict[tuple[str, int], set[str]] = defaultdict(set)
    for path in data.measured_files():
        file = Path(path).resolve().relative_to(folder.resolve()).as_posix()
        for line, contexts in data.contexts_by_lineno(path).items():
            tests = {re.sub(r"(\[.*)?(\|\w+)?$", "", each, flags=re.DOTALL) for each in contexts}
            passing[file, line] = tests - {""}

    def found(file: str, line: int) -> list[str]:
        tests = passing.get((file, line))
        if tests is None:
            return []
        if not tests:
            tests = set[str]().union(*(each for place, each in passing.items() if place[0] == file))
        return sorted(tests, key=lambda name: (seconds[name], name))

    return found


def outcome_of(change: Change, tests: list[str], folder: Path) -> str:
    """How the tests of a fault end in a copy: caught, missed, or why they could not be asked."""
    if not tests:
        return "no test there"
    file = folder / change.file
    text = file.read_text(encoding="utf-8")
    file.write_text(change.apply(text), encoding="utf-8")
    try:
        done = run_pytest(folder, "-n0", "-x", *tests, longest=_LONGEST)
    except subprocess.TimeoutExpired:
        return f"NOT CAUGHT within {_LONGEST} s"
    finally:
        file.write_text(text, encoding="utf-8")
    return "caught" if done.returncode else "NOT CAUGHT"


def main() -> None:
    """Draw, run, count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=29)
    given = parser.parse_args()
    caught = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        copy_tree(folder)
        passing = measure(folder)
        for change in draw(given.count, given.seed, ROOT):
            line = (folder / change.file).read_text(encoding="utf-8").splitlines()[change.line - 1]
            outcome = outcome_of(change, passing(change.file, change.line), folder)
            caught += outcome == "caught"
            print(f"{outcome:13} {change.file}:{change.line}: {line.strip()}")
            old = line.encode()[change.start : change.stop].decode()
            print(f"{'':13} {old or 'nothing'} -> {change.new or 'nothing'}", flush=True)
    print(f"{caught} of {given.count} faults caught, seed {given.seed}")


if __name__ == "__main__":
    main()
