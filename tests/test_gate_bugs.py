"""The bugs that the gate is tested by: how they are made, and that all parts of the code have some."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest
from benchmarks.bugs import BUGS
from benchmarks.mutation import Bug, NoTargetError

ROOT = Path(__file__).parents[1]
MODULE = '''
STEP = 2.0
class Walker:
    """Walks."""
    def ahead(self, x, y):
        # towards the door
        heading = np.arctan2(y - self.y, x - self.x)
        if not self.awake:
            return None
        return heading / (2 * self.step), heading / (2 * self.turn)
def ahead(x, y):
    return np.arctan2(y, x)
'''


def changed(target: str, old: str, new: str, occurrence: int = 0) -> str:
    return Bug("", f"m.py:{target}", old, new, occurrence).mutated(MODULE)


def test_only_the_named_definition_changes_whatever_its_variables_are_called() -> None:
    after = changed("Walker.ahead", "np.arctan2(_A, _B)", "np.arctan2(_B, _A)")
    assert "np.arctan2(x - self.x, y - self.y)" in after
    assert "return np.arctan2(y, x)" in after
    renamed = MODULE.replace("self.y", "self._north").replace("heading", "towards")
    assert "arctan2(x - self.x, y - self._north)" in Bug(
        "", "m.py:Walker.ahead", "np.arctan2(_A, _B)", "np.arctan2(_B, _A)"
    ).mutated(renamed)


def test_the_same_name_stands_for_equal_expressions() -> None:
    after = changed("Walker.ahead", "(_A / _B, _A / _C)", "(_A / _C, _A / _B)")
    assert "heading / (2 * self.turn), heading / (2 * self.step)" in after
    with pytest.raises(NoTargetError):
        changed("Walker.ahead", "np.arctan2(_A, _A)", "0")


def test_one_of_several_matches_is_chosen_and_a_statement_can_go() -> None:
    assert "heading / (2 * self.step), heading / self.turn" in changed("Walker.ahead", "2 * _A", "_A", 1)
    assert "return None" not in changed("Walker.ahead", "if not _A:\n    return None", "")
    assert "STEP = 4.0" in changed("", "2.0", "4.0")


@pytest.mark.parametrize("target", ["Walker.back", "Runner.ahead"])
def test_a_definition_that_is_gone_is_named(target: str) -> None:
    with pytest.raises(NoTargetError, match=f"m.py:{target}: there is no definition"):
        changed(target, "2 * _A", "_A")


def test_a_replacement_out_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="_C stands in the replacement"):
        changed("ahead", "np.arctan2(_A, _B)", "_C")


@pytest.mark.parametrize("bug", BUGS[:: len(BUGS) // 12], ids=lambda bug: f"{bug.target}: {bug.name}")
def test_a_sample_of_the_bugs_is_made_or_its_target_is_gone(bug: Bug, tmp_path: Path) -> None:
    (tmp_path / bug.file).parent.mkdir(parents=True)
    before = (ROOT / bug.file).read_text(encoding="utf-8") if (ROOT / bug.file).exists() else ""
    (tmp_path / bug.file).write_text(before, encoding="utf-8")
    try:
        bug.write(tmp_path)
    except NoTargetError as gone:
        pytest.skip(f"reported by the nightly run: {gone}")
    after = (tmp_path / bug.file).read_text(encoding="utf-8")
    assert ast.dump(ast.parse(after)) != ast.dump(ast.parse(before))
    compile(after, bug.file, "exec")


@cache
def parsed(file: str) -> ast.Module:
    return ast.parse((ROOT / file).read_text(encoding="utf-8"))


def test_nearly_every_bug_has_its_target_and_every_part_of_the_code_has_bugs() -> None:
    assert len({(bug.target, bug.name) for bug in BUGS}) == len(BUGS) >= 100
    gone = []
    for bug in BUGS:
        try:
            bug.change_of(parsed(bug.file))
        except (NoTargetError, FileNotFoundError) as missing:
            gone.append(f"{bug.name}: {missing}")
    assert len(gone) <= len(BUGS) / 10, "\n".join(gone)
    packages = {
        path.parent for folder in ("trackers", "twin/sensors", "twin/truth") for path in (ROOT / folder).glob("**/*.py")
    }
    with_bugs = {(ROOT / bug.file).parent for bug in BUGS}
    assert len(with_bugs & packages) >= 10
