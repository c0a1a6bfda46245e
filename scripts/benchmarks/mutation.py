"""Mistakes made in a definition found by its qualified name, as changes of its syntax tree.

A pattern is a Python expression or statement in which names that begin with an underscore and a capital letter (`_A`) stand
for any expression, the same name for equal ones: `np.arctan2(_A, _B)`. It is looked for in one function, method, class or
module, whatever its variables are called and however its lines are laid out; formatting and comments of the file change,
its meaning only there. After Comby and Semgrep, which match metavariables likewise.
"""

from __future__ import annotations

import ast
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path


class NoTargetError(LookupError):
    """The definition, or what the pattern stands for in it, is not there (any more)."""


@dataclass(frozen=True)
class Bug:
    """A mistake that somebody could make.

    name: what they got wrong. target: `path/of/module.py:Class.method`, or the path alone for the whole module. old, new: the
    pattern and what takes its place; an empty `new` removes a statement. occurrence: which of several matches, from 0.
    """

    name: str
    target: str
    old: str
    new: str
    occurrence: int = 0

    @property
    def file(self) -> str:
        """Path of the module below the root."""
        return self.target.partition(":")[0]

    def write(self, root: Path) -> None:
        """Make this mistake in the tree at `root`. Raises NoTargetError where there is nothing to make it in."""
        path = root / self.file
        if not path.exists():
            raise NoTargetError(f"{self.target}: there is no such file")
        path.write_text(self.mutated(path.read_text(encoding="utf-8")), encoding="utf-8")

    def mutated(self, source: str) -> str:
        """Return the module's source with the mistake.

        Raises NoTargetError, and ValueError where `new` has names that `old` lacks.
        """
        module = ast.parse(source)
        node, replacement = self.change_of(module)
        changed = _Replace(node, replacement).visit(module)
        return ast.unparse(ast.fix_missing_locations(changed)) + "\n"

    def change_of(self, module: ast.Module) -> tuple[ast.AST, ast.AST]:
        """Return the node of a module that the mistake is made in, and what takes its place. Raises as `mutated` does."""
        definition = _definition(module, self.target)
        pattern = _pattern(self.old)
        found = [(node, bound) for node in ast.walk(definition) if (bound := match(pattern, node)) is not None]
        if len(found) <= self.occurrence:
            raise NoTargetError(
                f"{self.target}: holds {self.old!r} {len(found)} times; more than {self.occurrence} expected"
            )
        node, bound = found[self.occurrence]
        return node, _Fill(bound).visit(_pattern(self.new)) if self.new else ast.Pass()


def match(pattern: ast.AST, node: ast.AST) -> dict[str, ast.AST] | None:
    """Bind a pattern's names to the expressions that they stand for in `node`; None where it does not match."""
    bound: dict[str, ast.AST] = {}
    return bound if _matches(pattern, node, bound) else None


def is_wildcard(name: str) -> bool:
    """Tell whether a name in a pattern stands for any expression."""
    return len(name) > 1 and name[0] == "_" and name[1].isupper()


def _matches(pattern: object, node: object, bound: dict[str, ast.AST]) -> bool:
    if isinstance(pattern, ast.Name) and is_wildcard(pattern.id):
        if not isinstance(node, ast.expr):
            return False
        known = bound.setdefault(pattern.id, node)
        return known is node or _dump(known) == _dump(node)
    if isinstance(pattern, ast.AST):
        return type(pattern) is type(node) and all(
            _matches(getattr(pattern, field, None), getattr(node, field, None), bound)
            for field in pattern._fields
            if field not in ("ctx", "type_comment", "kind")
        )
    if isinstance(pattern, list):
        return (
            isinstance(node, list)
            and len(pattern) == len(node)
            and all(_matches(each, theirs, bound) for each, theirs in zip(pattern, node, strict=True))
        )
    return type(pattern) is type(node) and pattern == node


def _dump(node: ast.AST) -> str:
    """The tree as text, whether a name is read or written."""
    return ast.dump(node).replace("Store()", "Load()")


def _pattern(text: str) -> ast.AST:
    statement = ast.parse(text).body[0]
    return statement.value if isinstance(statement, ast.Expr) else statement


def _definition(module: ast.Module, target: str) -> ast.AST:
    """The function, method or class that a target names."""
    place: ast.AST = module
    for name in filter(None, target.partition(":")[2].split(".")):
        inside = [
            node
            for node in ast.walk(place)
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) and node.name == name
        ]
        if not inside:
            raise NoTargetError(f"{target}: there is no definition {name!r}")
        place = inside[0]
    return place


class _Fill(ast.NodeTransformer):
    """Puts what the pattern's names stand for into the replacement."""

    def __init__(self, bound: dict[str, ast.AST]) -> None:
        self._bound = bound

    def visit_Name(self, node: ast.Name) -> ast.AST:
        if not is_wildcard(node.id):
            return node
        if node.id not in self._bound:
            raise ValueError(f"{node.id} stands in the replacement, but not in the pattern")
        return deepcopy(self._bound[node.id])


class _Replace(ast.NodeTransformer):
    """Exchanges one node."""

    def __init__(self, node: ast.AST, replacement: ast.AST) -> None:
        self._node, self._replacement = node, replacement

    def visit(self, node: ast.AST) -> ast.AST:
        return self._replacement if node is self._node else super().visit(node)
