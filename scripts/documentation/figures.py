"""Figures of README and docs: measured by a command, kept in one file, shown from it.

    scripts/figures list                        sources, the n of their figures, and how many commits they are behind
    scripts/figures measure NAME [--jobs N] [--seeds FIRST:COUNT]
                                                run a source of figures.yaml and keep its figures
    scripts/figures record NAME PATH...         keep the figures of a run: folders of a suite, results.json, rows of scripts/bench
    scripts/figures readme                      fill the tables of the README

docs/figures.json holds per source: value, interval, n, unit and seeds of each figure; command, commit, date and machine.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

if TYPE_CHECKING:
    from twin.suites.results import GroupKey
    from twin.suites.spec import Suite

ROOT = Path(__file__).parents[2]
FIGURES = ROOT / "docs" / "figures.json"
SOURCES = Path(__file__).with_name("figures.yaml")
OUT = Path("out/figures")
_COMMITS_SEARCHED = 100

Figure = dict[str, Any]
"""where, row, column, value, low, high, n, unit; of a reproduction: paper, paper_system and baseline too, None without one."""


def read_sources() -> dict[str, Any]:
    """Read figures.yaml; each source has its paths of code in one list."""
    content = yaml.safe_load(SOURCES.read_text(encoding="utf-8"))
    for source in content["sources"].values():
        source["code"] = list(_flat(source["code"]))
    return content


def read_figures() -> dict[str, Any]:
    """Read docs/figures.json; empty where there is none."""
    return json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.is_file() else {}


def _flat(items: Iterable[Any]) -> Iterator[str]:
    for item in items:
        if isinstance(item, str):
            yield item
        else:
            yield from _flat(item)


def measure(name: str, jobs: int | None, seeds: tuple[int, int] | None = None) -> None:
    """Run the suite, reproduction or benchmark of a source, and keep its figures.

    seeds: first, and number a scenario, in place of the source's own. Raises SystemExit for seeds of a benchmark, which has none.
    """
    source = read_sources()["sources"][name]
    if seeds is not None and source["kind"] == "bench":
        sys.exit(f"scripts/figures: --seeds: {name} is a benchmark, which draws none")
    code_commit(source["code"])  # refuses uncommitted code before hours are spent
    folder = OUT / name
    if "before" in source and not (ROOT / source["before"][-1]).is_file():  # a run that goes on has it
        _run([sys.executable, "-m", "twin", *source["before"]])
    match source["kind"]:
        case "suite":
            if seeds is not None:
                source["seeds"], folder = {"from": seeds[0], "count": seeds[1]}, folder / f"{seeds[0]}-{seeds[1]}"
            _run_suite(source, folder, jobs)
            record(name, folder, asked=seeds)
        case "reproduce":
            more = ["--jobs", str(jobs)] if jobs else []
            if seeds is not None:  # the last of an option counts
                more += ["--seed", str(seeds[0]), "--seeds", str(seeds[1])]
                folder = folder / f"{seeds[0]}-{seeds[1]}"
            _run([sys.executable, "-m", "twin", "reproduce", *source["arguments"], "--out", str(folder), *more])
            record(name, folder / "results.json", asked=seeds)
        case "bench":
            rows = OUT / f"{name}.json"
            OUT.mkdir(parents=True, exist_ok=True)
            only = [word for each in source["only"] for word in ("--only", each)]
            _run([sys.executable, "-m", "benchmarks", *only, "--json", str(rows)], check=False)  # 1: a target is missed
            record(name, rows)


def _run(command: list[str], check: bool = True) -> None:
    subprocess.run(command, check=check, cwd=ROOT)


def _run_suite(source: Mapping[str, Any], folder: Path, jobs: int | None) -> None:
    from twin.messages import printable
    from twin.models import cache_folder
    from twin.suites.cache import RecordingCache, cache_limit_bytes
    from twin.suites.cluster import Workers
    from twin.suites.dask_runner import suite_progress
    from twin.suites.run import run_suite
    from twin.suites.spec import load_suite

    suite, path = load_suite(source["suite"])
    if "seeds" in source:
        suite = _with_seeds(suite, source["seeds"]["from"], source["seeds"]["count"])
    cache = RecordingCache(cache_folder(), cache_limit_bytes())
    with suite_progress() as progress:
        print(printable(f"{suite.name}: {suite.n_case} cases"), file=sys.stderr)
        run_suite(suite, path, folder, cache, Workers(jobs), resume=True, progress=progress)


def _with_seeds(suite: Suite, first: int, count: int) -> Suite:
    """Return the suite with `count` seeds a scenario; where each has seeds of its own, so have they here, one after the other."""
    apart = all(entry.seeds for entry in suite.scenarios)
    starts = [first + apart * number * count for number in range(len(suite.scenarios))]
    entries = [
        entry.model_copy(update={"seeds": tuple(range(start, start + count))})
        for start, entry in zip(starts, suite.scenarios, strict=True)
    ]
    return suite.model_copy(update={"scenarios": entries})


def list_sources() -> None:
    """Print each source: kind, number and n of its figures, commits of the measured code since, date."""
    kept = read_figures()
    for name, source in read_sources()["sources"].items():
        if name not in kept:
            print(f"{name:36}{source['kind']:11}not measured")
            continue
        n = [each["n"] for each in kept[name]["figures"]]
        behind = commits_since(kept[name]["commit"], kept[name]["code"])
        print(
            f"{name:36}{source['kind']:11}{len(n)} figures, n {min(n)} to {max(n)}, "
            f"{'unknown' if behind is None else behind} commits behind, measured {kept[name]['measured']}"
        )


def seeds_of(text: str) -> tuple[int, int]:
    """Read FIRST:COUNT. Raises ArgumentTypeError for any other text."""
    first, _, count = text.partition(":")
    if not (first.isdecimal() and count.isdecimal() and int(count)):
        raise argparse.ArgumentTypeError(f"{text!r}: FIRST:COUNT is expected, for example 5900:5")
    return int(first), int(count)


def record(name: str, *paths: Path, machine: str | None = None, asked: tuple[int, int] | None = None) -> None:
    """Keep the figures of runs under the name of their source; several folders of a suite are parts of one run.

    machine: the one that made them (default: this one); what drew their pictures is read from them. asked: `measure`'s seeds;
    without, those after which `measure` named the folders.
    Raises SystemExit for an unknown source, and for runs by code that no commit holds.
    """
    sources = read_sources()["sources"]
    if name not in sources:
        sys.exit(f"scripts/figures: there is no source {name!r}; valid are {', '.join(sources)}")
    source = sources[name]
    figures = list(_READERS[source["kind"]](paths, source))
    commit, date = code_commit(source["code"], _commit_of_runs(paths))
    kept = read_figures()
    named = [re.fullmatch(r"(\d+)-(\d+)", path.name) for path in paths]
    parts = [asked] if asked else [(int(each[1]), int(each[2])) for each in named if each is not None]
    kept[name] = {
        "kind": source["kind"],
        "command": f"scripts/figures measure {name}" + " and".join(f" --seeds {first}:{n}" for first, n in parts),
        "commit": commit,
        "committed": date,
        "measured": datetime.now(UTC).date().isoformat(),
        "machine": ", ".join([_machine() if machine is None else machine, *_renderers(paths)]),
        "seeds": _seeds(source, paths) or (f"{asked[0]}–{sum(asked) - 1}" if asked else ""),
        "code": source["code"],
        "figures": figures,
    }
    lines = ["{"]
    for number, (key, value) in enumerate(sorted(kept.items())):
        about = {field: content for field, content in value.items() if field != "figures"}
        rows = ",\n".join(f"      {json.dumps(row, ensure_ascii=False)}" for row in value["figures"])
        opened = json.dumps(about, ensure_ascii=False)[:-1]
        lines.append(
            f'  "{key}": {opened},\n    "figures": [\n{rows}\n    ]}}' + ("," if number + 1 < len(kept) else "")
        )
    FIGURES.write_text("\n".join([*lines, "}"]) + "\n", encoding="utf-8")
    print(f"{FIGURES.relative_to(ROOT)}: {name}: {len(figures)} figures, of commit {commit[:10]}")


def _machine() -> str:
    return f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"


def _facts(paths: Sequence[Path]) -> Iterator[Mapping[str, Any]]:
    """Read what the runs of a suite or a reproduction say of themselves."""
    from twin.suites.result_files import RESULTS_FILE, read_store

    for folder in [each for path in paths for each in (path, path.parent / "suite")]:
        if (folder / RESULTS_FILE).is_file():
            with read_store(folder) as store:
                yield store.facts()


def _renderers(paths: Sequence[Path]) -> list[str]:
    """Return what drew the pictures of the runs."""
    return sorted({name for facts in _facts(paths) for name in facts.get("renderers", ()) if name != "none"})


def _commit_of_runs(paths: Sequence[Path]) -> str:
    """Find the newest commit whose packages made the runs of a suite or a reproduction; HEAD where no run says which code."""
    digests = {facts["code"] for facts in _facts(paths)}
    if not digests:
        return "HEAD"
    for commit in _git("log", f"-{_COMMITS_SEARCHED}", "--format=%H", "--", "twin", "trackers").split():
        if digests == {_digest_of_code(commit)}:
            return commit
    sys.exit(
        "scripts/figures: the runs were made by code that no commit of late holds, or by several; land it and run again"
    )


def _digest_of_code(commit: str) -> str:
    """Digest both packages of a commit as `twin.suites.cache_keys.whole_code` digests those on disk."""
    digest = hashlib.sha256()
    for package in ("twin", "trackers"):
        listed = _git("ls-tree", "-r", "-z", commit, "--", package).split("\0")
        blobs = {
            Path(path).relative_to(package): about.split()[2]
            for about, _, path in (each.partition("\t") for each in listed if each)
        }
        for path in sorted(each for each in blobs if each.suffix in (".py", ".npz")):
            for content in (path.as_posix().encode(), _blob(blobs[path])):
                digest.update(len(content).to_bytes(8, "little"))
                digest.update(content)
    return digest.hexdigest()[:16]


@cache
def _blob(name: str) -> bytes:
    return subprocess.run(["git", "cat-file", "blob", name], cwd=ROOT, capture_output=True, check=True).stdout


def code_commit(code: list[str], at: str = "HEAD") -> tuple[str, str]:
    """Return hash and date of the last commit up to `at` that changed the measured code.

    Raises SystemExit for changes that are not committed.
    """
    changed = _git("status", "--porcelain", "--", *code) if at == "HEAD" else ""
    if changed:
        sys.exit(f"scripts/figures: the measured code has changes that are not committed:\n{changed}")
    commit, date = _git("log", "-1", "--format=%H %cs", at, "--", *code).split()
    return commit, date


def commits_since(commit: str, code: list[str]) -> int | None:
    """Count commits that changed the measured code since; None where the history does not hold the commit."""
    try:
        return int(_git("rev-list", "--count", f"{commit}..HEAD", "--", *code))
    except subprocess.CalledProcessError:
        return None


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def _groups(paths: Sequence[Path]) -> dict[GroupKey, tuple[str, dict[int, Mapping[str, float | None]]]]:
    """Read the metrics of each seed, by group, over all parts of a run."""
    from twin.suites.result_files import read_results

    found: dict[GroupKey, tuple[str, dict[int, Mapping[str, float | None]]]] = {}
    for path in paths:
        for key, group in read_results(path).groups.items():
            found.setdefault(key, (group.variant, {}))[1].update(group.seeds)
    return found


def _seeds(source: Mapping[str, Any], paths: Sequence[Path]) -> str:
    if source["kind"] != "suite":
        return str(source.get("seeds", ""))
    seeds = sorted({seed for _, of_group in _groups(paths).values() for seed in of_group})
    return f"{seeds[0]}–{seeds[-1]}" if len(seeds) > 1 else str(seeds[0])


def _suite_figures(paths: Sequence[Path], source: Mapping[str, Any]) -> Iterator[Figure]:
    from twin.suites.metrics import METRICS, mean_over_seeds

    for key, (variant, by_seed) in _groups(paths).items():
        where = f"{key.scenario}, {variant}" if variant else key.scenario
        for metric in source["metrics"]:
            values = (metrics.get(metric) for metrics in by_seed.values())
            found = mean_over_seeds([value for value in values if value is not None])
            if found is not None:
                yield {
                    "where": where, "row": key.tracker, "column": metric, "value": _short(found.mean), "low": _short(found.low),
                    "high": _short(found.high), "n": found.n, "unit": METRICS[metric].unit,
                }  # fmt: skip


def _reproduction_figures(paths: Sequence[Path], source: Mapping[str, Any]) -> Iterator[Figure]:
    for row in json.loads(paths[0].read_text(encoding="utf-8")):
        if any(row["where"].startswith(each) for each in source.get("where", [""])):
            low, high = row["ci95"]
            yield {
                "where": row["where"], "row": row["row"], "column": row["column"], "value": _short(row["ours"]),
                "low": _short(low), "high": _short(high), "n": row["runs"], "unit": row["unit"], "paper": row["paper"],
                **{system: _short((row.get(system) or {}).get("value")) for system in ("paper_system", "baseline")},
            }  # fmt: skip


def _bench_figures(paths: Sequence[Path], source: Mapping[str, Any]) -> Iterator[Figure]:
    for row in json.loads(paths[0].read_text(encoding="utf-8")):
        yield {
            "where": source["kind"], "row": row["name"], "column": "value", "value": _short(row["value"]), "low": None,
            "high": None, "n": 1, "unit": row["unit"], "target": row["target"],
        }  # fmt: skip


_READERS = {"suite": _suite_figures, "reproduce": _reproduction_figures, "bench": _bench_figures}


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.5g}")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        prog="scripts/figures", description="Measure and keep the figures of README and docs."
    )
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("measure", help="run a source and keep its figures")
    run.add_argument("name", choices=list(read_sources()["sources"]))
    run.add_argument("--jobs", type=int, help="processes; default: one a core")
    run.add_argument("--seeds", type=seeds_of, metavar="FIRST:COUNT", help="seeds in place of the source's own")
    keep = commands.add_parser("record", help="keep the figures of a run that has been made")
    keep.add_argument("name", choices=list(read_sources()["sources"]))
    keep.add_argument(
        "paths", nargs="+", type=Path, help="folders of a suite, a results.json, or rows of scripts/bench --json"
    )
    keep.add_argument("--machine", help="the machine that made the run, in words; default: this one")
    commands.add_parser("readme", help="fill the tables of the README")
    commands.add_parser("list", help="list the sources, the n of their figures and their age")
    arguments = parser.parse_args()
    if arguments.command == "measure":
        measure(arguments.name, arguments.jobs, arguments.seeds)
    elif arguments.command == "list":
        list_sources()
    elif arguments.command == "record":
        record(arguments.name, *arguments.paths, machine=arguments.machine)
    else:
        from documentation.tables import fill_readme

        fill_readme()


if __name__ == "__main__":
    main()
